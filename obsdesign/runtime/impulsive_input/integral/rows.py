"""Rows of a record around a search for impulses: from samples to estimates.

Measured rows wait in a `Track`. A row without measurement is no part of it: samples joined across
it show an impulse otherwise than a sample there would. It waits beside the track, and is given out
as the plant's prediction from the last measured row.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.gains import LARGEST
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.impulsive_input.event import (
    CONFUSED,
    OPEN,
    Event,
    missing_sample,
    with_event,
)
from obsdesign.runtime.impulsive_input.initial import Initial
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.live import AbsentRow, HeldInput, IntegralLive
from obsdesign.runtime.status import status_of

_BEYOND = "beyond what floats can follow: samples are too far apart for A - K C"


@dataclass(frozen=True)
class Rows:
    """Rows of a record along a free run."""

    run: FreeRun

    # --- rows in ------------------------------------------------------------------------------

    def begun(self, initial: Initial, t: float, y: Matrix, u: Matrix) -> IntegralLive:
        """The state at the first measured row."""
        plant, P = self.run.plant, initial.covariance
        x = plant.free(initial.t, initial.x, plant.forcing(initial.u), t)
        if P is not None and t > initial.since:  # no measurement corrects it until here
            flow = plant.step(t - initial.since)[0]
            P = flow @ P @ flow.T
        track = self.run.begin(t, y, plant.forcing(u), x)
        first = t if initial.first is None else initial.first
        return IntegralLive(track=track, covariance=P, since=t, first=first)

    def unmeasured(self, initial: Initial, t: Matrix, u: Matrix) -> tuple[Initial, list[Estimate]]:
        """The state after rows before the first measurement, which the plant predicts."""
        plant, rows = self.run.plant, []
        for time, following in zip(t.tolist(), u, strict=True):
            x = plant.free(initial.t, initial.x, plant.forcing(initial.u), time)
            first = time if initial.first is None else initial.first
            initial = replace(initial, t=time, x=x, u=following, first=first)
            rows.append(Estimate(time, x=x, status=status_of(self._missing(first, time), x)))
        return initial, rows

    def appended(
        self, live: IntegralLive, t: Matrix, y: Matrix, u: Matrix, measured: Array
    ) -> IntegralLive:
        """Measured rows join the track; the others wait, and are bridged by the next one."""
        track, absent, forced = live.track, list(live.absent), self.run.plant.forcing(u)
        forcing = np.concatenate([track.forcing[-1:], forced[measured]])
        gap = [(row.t, self.run.plant.forcing(row.u)) for row in live.waiting]
        before = np.append(True, measured[:-1])
        for k in np.flatnonzero(~measured | ~before | (np.arange(len(t)) == 0)):
            if not measured[k]:
                gap.append((float(t[k]), forced[k]))
            elif gap:
                at = int(measured[:k].sum())  # the measured row before
                since = float(t[measured][at - 1]) if at else float(track.t[-1])
                displacements, forcing[at] = self._bridged(since, forcing[at], gap, float(t[k]))
                absent += displacements
                gap = []
        joined = replace(track, forcing=np.concatenate([track.forcing[:-1], forcing[:1]]))
        if measured.any():
            joined = self.run.extended(joined, t[measured], y[measured], forcing[1:])
        known = int(np.flatnonzero(measured)[-1]) + 1 if measured.any() else 0
        late = tuple(HeldInput(float(t[k]), u[k]) for k in range(known, len(t)))
        waiting = late if known else live.waiting + late
        return replace(live, track=joined, absent=tuple(absent), waiting=waiting)

    def _bridged(
        self, since: float, before: Matrix, gap: list[tuple[float, Matrix]], until: float
    ) -> tuple[list[AbsentRow], Matrix]:
        """(rows of the gap with what the forcing did until then, a constant that does it all)."""
        at, value, displacement, rows = since, before, np.zeros(len(before)), []
        for t, following in [*gap, (until, before)]:
            flow, once, _ = self.run.plant.step(t - at)
            displacement = flow @ displacement + once @ value
            rows.append(AbsentRow(t, displacement))
            at, value = t, following
        if all(np.array_equal(following, before) for _, following in gap):
            return rows[:-1], before
        once = self.run.plant.step(until - since)[1]
        return rows[:-1], np.asarray(np.linalg.lstsq(once, displacement, rcond=None)[0], np.float64)

    # --- rows out -----------------------------------------------------------------------------

    def predictions(self, live: IntegralLive) -> Iterator[tuple[float, Matrix]]:
        """Yield (t, x) at the last measured row, and as the plant goes on from it at later rows."""
        plant, track = self.run.plant, live.track
        t, x, forcing = float(track.t[-1]), track.x[-1], track.forcing[-1]
        yield t, x
        for row in live.waiting:
            x = plant.free(t, x, forcing, row.t)
            t, forcing = row.t, plant.forcing(row.u)
            yield t, x

    def tail(self, live: IntegralLive) -> tuple[Estimate, ...]:
        """Rows of the last window, where a later sample could still show an impulse."""
        rows = self.decided_rows(live, len(live.track.t), remarks=(OPEN,))
        waiting = list(self.predictions(live))[1:]
        rows += [
            Estimate(t, x=x, status=status_of([*self._missing(live.first, t), OPEN]))
            for t, x in waiting
        ]
        return tuple(rows)

    def decided_rows(
        self,
        live: IntegralLive,
        count: int,
        *,
        event: Event | None = None,
        remarks: tuple[str, ...] = (),
    ) -> list[Estimate]:
        """Estimates for the first `count` rows of the track, and rows without measurement between.

        `event` goes with the first row after it.
        """
        track = live.track
        end = float(track.t[count]) if count < len(track.t) else math.inf
        rows = [
            self._estimate(live, float(t), x, remarks)
            for t, x in zip(track.t[:count], track.x[:count], strict=True)
        ]
        between = [absent for absent in live.absent if absent.t < end]
        for t, displacement in between:
            k = int(np.searchsorted(track.t, t)) - 1
            since = float(track.t[k])
            x = self.run.plant.step(t - since)[0] @ track.x[k] + displacement
            if event is not None and since < event.t <= t:
                x = x + expm(self.run.gains.A * (t - event.t)) @ (self.run.gains.H @ event.weights)
            rows.append(self._estimate(live, t, x, remarks, self._missing(live.first, t)))
        if between:
            rows.sort(key=lambda row: row.t)
        return rows if event is None else with_event(rows, event)

    def _estimate(
        self,
        live: IntegralLive,
        t: float,
        x: Matrix,
        remarks: tuple[str, ...],
        missing: tuple[str, ...] = (),
    ) -> Estimate:
        beyond = () if np.abs(x).max() < LARGEST else (_BEYOND,)
        confused = (CONFUSED,) if t <= live.confused_until else ()
        reasons = (*missing, *beyond, *confused, *live.history.doubts_at(t), *remarks)
        return Estimate(t, x=x, status=status_of(tuple(dict.fromkeys(reasons))))

    def _missing(self, first: float, t: float) -> tuple[str, ...]:
        return missing_sample(self.run.gains.period, first, t)
