"""Rows of a record around a search for impulses: from samples to estimates.

Measured rows wait in a `Track`. A row without measurement is no part of it: samples joined across
it show an impulse otherwise than a sample there would. It waits beside the track, and is given out
as the plant's prediction from the last measured row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lmi.arithmetic.exponential import expm
from obsdesign.equations.gains import Array
from obsdesign.equations.impulsive_input.requirements import LARGEST
from obsdesign.runtime.base import Estimate, Vector
from obsdesign.runtime.flow_response import responses
from obsdesign.runtime.impulsive_input.event import DoubtfulSpan, Event
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.search import Position, Rule, Search
from obsdesign.runtime.impulsive_input.residuals import Residuals
from obsdesign.runtime.time_stamps import time_tolerance

MISSING, _OPEN = "missing sample", "unresolved"
_BEYOND = "beyond what floats can follow: samples are too far apart for A - K C"


@dataclass(frozen=True, slots=True)
class IntegralLive:
    """State of operator `integral` along a record.

    t, x, u: last row and the estimate there. track: rows that are open, None before the first
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
    doubt: DoubtfulSpan = field(default_factory=DoubtfulSpan)
    residuals: Residuals = field(default_factory=Residuals)  # of the windows of impulses


@dataclass(frozen=True)
class Rows:
    """The free run, and the period by which samples are missing; None: measured continuously."""

    run: FreeRun
    period: float | None

    def forcing(self, u: Array) -> Array:
        """B u + b_mid for inputs u (..., m)."""
        return np.asarray(u @ self.run.B.T + self.run.drift)

    def appended(
        self, live: IntegralLive, t: Array, y: Array, u: Array, measured: Any
    ) -> IntegralLive:
        """Measured rows join the track; the others wait, and are bridged by the next one."""
        assert live.track is not None
        track, absent, forced = live.track, list(live.absent), self.forcing(u)
        forcing = np.concatenate([track.forcing[-1:], forced[measured]])
        gap, at = [(time, self.forcing(v)) for time, v in live.waiting], 0
        for k in np.flatnonzero(
            ~measured | np.append(False, ~measured[:-1]) | (np.arange(len(t)) == 0)
        ):
            if not measured[k]:
                gap.append((float(t[k]), forced[k]))
                continue
            at = int(measured[:k].sum())  # the measured row before
            since = float(t[measured][at - 1]) if at else float(track.t[-1])
            if gap:
                displacements, forcing[at] = self._bridged(since, forcing[at], gap, float(t[k]))
                absent += displacements
                gap = []
        joined = replace(track, forcing=np.concatenate([track.forcing[:-1], forcing[:1]]))
        if measured.any():
            joined = self.run.extended(joined, t[measured], y[measured], forcing[1:])
        known = int(np.flatnonzero(measured)[-1]) + 1 if measured.any() else 0
        late = tuple((float(t[k]), u[k]) for k in range(known, len(t)))
        waiting = late if known else live.waiting + late
        return replace(live, track=joined, absent=tuple(absent), waiting=waiting)

    def _bridged(
        self, since: float, before: Vector, gap: list[tuple[float, Vector]], until: float
    ) -> tuple[list[tuple[float, Vector]], Vector]:
        """(rows of the gap with what the forcing did until then, a constant that does it all)."""
        at, value, displacement, rows = since, before, np.zeros(len(before)), []
        for t, following in [*gap, (until, before)]:
            flow, once = self.run.plant_step(at, t)
            displacement = flow @ displacement + once @ value
            rows.append((t, displacement))
            at, value = t, following
        if all(np.array_equal(following, before) for _, following in gap):
            return rows[:-1], before
        once = responses(self.run.A, until - since)[1]
        return rows[:-1], np.asarray(np.linalg.lstsq(once, displacement, rcond=None)[0], np.float64)

    def prediction(self, live: IntegralLive) -> Vector:
        """The free run at the last row; without measurement there, the plant from the last one."""
        if live.track is None:
            return live.x
        t, x, forcing = float(live.track.t[-1]), live.track.x[-1], live.track.forcing[-1]
        for time, following in live.waiting:
            x, t, forcing = self._propagated(t, x, forcing, time), time, self.forcing(following)
        return np.asarray(x)

    def predicted(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        """The plant from x at t, input u held, no impulse."""
        return self._propagated(t, x, self.forcing(u), until)

    def _propagated(self, t: float, x: Vector, forcing: Vector, until: float) -> Vector:
        if until <= t:
            return x
        flow, once, _ = responses(self.run.A, until - t)
        return np.asarray(flow @ x + once @ forcing)

    # --- rows out -----------------------------------------------------------------------------

    def tail(self, live: IntegralLive) -> tuple[Estimate, ...]:
        """Rows of the last window, where a later sample could still show an impulse."""
        if live.track is None:
            return ()
        rows = self.decided_rows(live, len(live.track.t), (_OPEN,))
        t, x, forcing = float(live.track.t[-1]), live.track.x[-1], live.track.forcing[-1]
        for time, following in live.waiting:
            x, t, forcing = self._propagated(t, x, forcing, time), time, self.forcing(following)
            missing = [MISSING] if self.is_missing(live, time) else []
            rows.append(Estimate(time, x=x, status="; ".join([*missing, _OPEN])))
        return tuple(rows)

    def decided_rows(
        self,
        live: IntegralLive,
        count: int,
        remarks: tuple[str, ...] = (),
        event: Event | None = None,
        jump: Vector | None = None,
    ) -> list[Estimate]:
        """Estimates for the first `count` rows of the track, and rows without measurement between.

        `event`, which moves the plant by `jump`, goes with the first row after it.
        """
        track = live.track
        assert track is not None
        end = float(track.t[count]) if count < len(track.t) else math.inf
        between = [row for row in live.absent if row[0] < end]
        rows = [(float(t), x, False) for t, x in zip(track.t[:count], track.x[:count], strict=True)]
        for t, displacement in between:
            k = int(np.searchsorted(track.t, t)) - 1
            x = self.run.plant_step(float(track.t[k]), t)[0] @ track.x[k] + displacement
            if event is not None and jump is not None and float(track.t[k]) < event.t <= t:
                x = x + expm(self.run.A * (t - event.t)) @ jump
            rows.append((t, x, True))
        if between:
            rows.sort(key=lambda row: row[0])
        estimates = []
        for k, (t, x, absent) in enumerate(rows):
            reasons = [MISSING] if absent and self.is_missing(live, t) else []
            reasons += [] if np.abs(x).max() < LARGEST else [_BEYOND]
            reasons += [*live.doubt.doubts_at(t), *remarks]
            status = "; ".join(reasons) or "ok"
            events: tuple[Event, ...] = ()
            if event is not None and (t >= event.t or k == len(rows) - 1):
                events, event = (event,), None
            estimates.append(Estimate(t, x=x, events=events, status=status))
        return estimates

    @staticmethod
    def absent_from(live: IntegralLive, until: float) -> tuple[tuple[float, Vector], ...]:
        """Rows without measurement from time `until` on."""
        return tuple(row for row in live.absent if row[0] >= until)

    def is_missing(self, live: IntegralLive, t: float) -> bool:
        """Whether a row at t without measurement lacks a sample, and does not lie between two."""
        if self.period is not None and live.first is not None:
            count = round((t - live.first) / self.period)
            apart = abs(t - live.first - count * self.period)
            if apart > time_tolerance(t - live.first, t):
                return False
        return True
