"""Rows of a record around a search for impulses: how they come in, what is known of each, the tail.

Measured rows wait in a `Track`. A row without measurement is no part of it: samples joined across
it show an impulse otherwise than a sample there would. It waits beside the track, and is given out
as the plant's prediction from the last measured row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.features import LARGEST
from obsdesign.runtime.base import Estimate, Vector
from obsdesign.runtime.flow_response import responses
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.search import Position, Rule, Search
from obsdesign.runtime.impulsive_input.residuals import Residuals
from obsdesign.runtime.time_stamps import time_tolerance

Array = NDArray[Any]

_MISSING, _OPEN = "missing sample", "unresolved"
_BEYOND = "beyond what floats can follow: samples are too far apart for A - K C"


@dataclass(frozen=True, slots=True)
class IntegralLive:
    """t, x, u: last row and the estimate there. track: rows that are open, None before the first
    measurement. norms: |R| of the first of them. waiting: rows after the last measurement.
    absent: rows without measurement between rows of the track: time, and how far the forcing moves
    the plant since the measured row before.
    """

    t: float
    x: Vector
    u: Vector
    covariance: Array | None
    since: float  # time of the covariance
    track: Track | None = None
    norms: Array = field(default_factory=lambda: np.zeros(0))
    search: Search = field(default_factory=Search)
    rule: Rule | None = None
    position: Position | None = None
    waiting: tuple[tuple[float, Vector], ...] = ()
    absent: tuple[tuple[float, Vector], ...] = ()
    first: float | None = None  # time of the first row: the phase of periodic samples
    last_event: float = -math.inf
    last_std: float = 0.0  # its deviation
    largest: float = 0.0  # value of the search at which an impulse was evaluated
    doubt: tuple[float, float, str] = (math.inf, -math.inf, "")  # rows that a flagged event covers
    residuals: Residuals = field(default_factory=Residuals)  # of the windows of impulses


@dataclass(frozen=True)
class Rows:
    """The free run, and the period of samples (None: continuous), which tells what is missing."""

    run: FreeRun
    period: float | None

    def forcing(self, u: Array) -> Array:
        """B u + b_mid for inputs u (..., m)."""
        return np.asarray(u @ self.run.B.T + self.run.drift)

    def appended(self, live: IntegralLive, t: Array, y: Array, u: Array, seen: Any) -> IntegralLive:
        """Measured rows join the track; the others wait, and are bridged by the next one."""
        assert live.track is not None
        track, absent, forced = live.track, list(live.absent), self.forcing(u)
        forcing = np.concatenate([track.forcing[-1:], forced[seen]])
        gap, at = [(time, self.forcing(v)) for time, v in live.waiting], 0
        for k in np.flatnonzero(~seen | np.append(False, ~seen[:-1]) | (np.arange(len(t)) == 0)):
            if not seen[k]:
                gap.append((float(t[k]), forced[k]))
                continue
            at = int(seen[:k].sum())  # the measured row before
            since = float(t[seen][at - 1]) if at else float(track.t[-1])
            if gap:
                moved, forcing[at] = self._bridged(since, forcing[at], gap, float(t[k]))
                absent += moved
                gap = []
        joined = replace(track, forcing=np.concatenate([track.forcing[:-1], forcing[:1]]))
        if seen.any():
            joined = self.run.extended(joined, t[seen], y[seen], forcing[1:])
        known = int(np.flatnonzero(seen)[-1]) + 1 if seen.any() else 0
        late = tuple((float(t[k]), u[k]) for k in range(known, len(t)))
        waiting = late if known else live.waiting + late
        return replace(live, track=joined, absent=tuple(absent), waiting=waiting)

    def _bridged(
        self, since: float, before: Vector, gap: list[tuple[float, Vector]], until: float
    ) -> tuple[list[tuple[float, Vector]], Vector]:
        """(rows of the gap with what the forcing did until then, a constant that does it all)."""
        at, value, moved, rows = since, before, np.zeros(len(before)), []
        for t, following in [*gap, (until, before)]:
            flow, once = self.run.plant_step(at, t)
            moved = flow @ moved + once @ value
            rows.append((t, moved))
            at, value = t, following
        if all(np.array_equal(following, before) for _, following in gap):
            return rows[:-1], before
        once = responses(self.run.A, until - since)[1]
        return rows[:-1], np.asarray(np.linalg.lstsq(once, moved, rcond=None)[0], np.float64)

    def prediction(self, live: IntegralLive) -> Vector:
        """The free run at the last row; without measurement there, the plant from the last one."""
        if live.track is None:
            return live.x
        t, x, forcing = float(live.track.t[-1]), live.track.x[-1], live.track.forcing[-1]
        for time, following in live.waiting:
            x, t, forcing = self._moved(t, x, forcing, time), time, self.forcing(following)
        return np.asarray(x)

    def predicted(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        """The plant from x at t, input u held, no impulse."""
        return self._moved(t, x, self.forcing(u), until)

    def _moved(self, t: float, x: Vector, forcing: Vector, until: float) -> Vector:
        if until <= t:
            return x
        flow, once, _ = responses(self.run.A, until - t)
        return np.asarray(flow @ x + once @ forcing)

    # --- rows out -----------------------------------------------------------------------------

    def tail(self, live: IntegralLive) -> tuple[Estimate, ...]:
        """Rows of the last window: an impulse in them may not have been seen yet."""
        if live.track is None:
            return ()
        rows = self.given(live, len(live.track.t), _OPEN)
        t, x, forcing = float(live.track.t[-1]), live.track.x[-1], live.track.forcing[-1]
        for time, following in live.waiting:
            x, t, forcing = self._moved(t, x, forcing, time), time, self.forcing(following)
            missing = self.status(live, time)
            status = _OPEN if missing == "ok" else f"{missing}; {_OPEN}"
            rows.append(Estimate(time, x=x, status=status))
        return tuple(rows)

    def given(
        self, live: IntegralLive, count: int, more: str = "", event: Event | None = None,
        jump: Vector | None = None,
    ) -> list[Estimate]:  # fmt: skip
        """Estimates for the first `count` rows of the track, and rows without measurement between.

        `event`, which moves the plant by `jump`, goes with the first row after it.
        """
        track = live.track
        assert track is not None
        end = float(track.t[count]) if count < len(track.t) else math.inf
        between = [row for row in live.absent if row[0] < end]
        rows = [(float(t), x, False) for t, x in zip(track.t[:count], track.x[:count], strict=True)]
        for t, moved in between:
            k = int(np.searchsorted(track.t, t)) - 1
            x = self.run.plant_step(float(track.t[k]), t)[0] @ track.x[k] + moved
            if event is not None and jump is not None and float(track.t[k]) < event.t <= t:
                x = x + expm(self.run.A * (t - event.t)) @ jump
            rows.append((t, x, True))
        if between:
            rows.sort(key=lambda row: row[0])
        found = []
        for k, (t, x, absent) in enumerate(rows):
            doubtful = live.doubt[0] <= t <= live.doubt[1]
            words = [
                self.status(live, t) if absent else "",
                "" if np.abs(x).max() < LARGEST else _BEYOND,
                live.doubt[2] if doubtful else "",
                more,
            ]
            status = "; ".join(w for w in words if w and w != "ok") or "ok"
            events: tuple[Event, ...] = ()
            if event is not None and (t >= event.t or k == len(rows) - 1):
                events, event = (event,), None
            found.append(Estimate(t, x=x, events=events, status=status))
        return found

    @staticmethod
    def left(live: IntegralLive, until: float) -> tuple[tuple[float, Vector], ...]:
        """Rows without measurement from time `until` on."""
        return tuple(row for row in live.absent if row[0] >= until)

    def status(self, live: IntegralLive, t: float) -> str:
        """ok, or that a sample is missing at t, where a row has no measurement."""
        if self.period is not None and live.first is not None:
            count = round((t - live.first) / self.period)
            apart = abs(t - live.first - count * self.period)
            if apart > time_tolerance(t - live.first, t):
                return "ok"  # a row between two samples misses none
        return _MISSING
