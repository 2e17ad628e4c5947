"""Rows of a record around a search for impulses: how they come in, what is known of each, the tail.

Rows wait in a `Track`; rows after the last measurement wait beside it, since a missing sample is
interpolated once the next one is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Estimate, Vector
from obsdesign.runtime.impulse_estimate import Event
from obsdesign.runtime.impulse_search import Position, Rule, Search
from obsdesign.runtime.impulse_track import FreeRun, Track
from obsdesign.runtime.luenberger import responses

Array = NDArray[Any]

_MISSING, _OPEN = "missing sample", "unresolved"


@dataclass(frozen=True, slots=True)
class IntegralLive:
    """t, x, u: last row and the estimate there. track: rows that are open, None before the first
    measurement. norms: |R| of the first of them. waiting: rows after the last measurement.
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
    first: float | None = None  # time of the first row: the phase of periodic samples
    last_event: float = -math.inf
    doubt: tuple[float, float, str] = (math.inf, -math.inf, "")  # rows that a flagged event covers


@dataclass(frozen=True)
class Rows:
    """The free run, and the period of samples (None: continuous), which tells what is missing."""

    run: FreeRun
    period: float | None

    def appended(self, live: IntegralLive, t: Array, y: Array, u: Array, seen: Any) -> IntegralLive:
        """Rows up to the last measurement join the track; y is interpolated where it is missing."""
        assert live.track is not None
        known = int(np.flatnonzero(seen)[-1]) + 1 if seen.any() else 0
        late = tuple((float(t[k]), u[k]) for k in range(known, len(t)))
        if known:
            wait_t = np.array([row[0] for row in live.waiting])
            wait_u = np.array([row[1] for row in live.waiting]).reshape(len(wait_t), u.shape[1])
            times = np.concatenate([wait_t, t[:known]])
            there = np.concatenate([np.zeros(len(wait_t), bool), seen[:known]])
            values = np.concatenate([np.full((len(wait_t), y.shape[1]), np.nan), y[:known]])
            nodes = np.concatenate([live.track.t[-1:], times[there]])
            for j in range(y.shape[1]):
                at_nodes = np.concatenate([live.track.y[-1:, j], values[there, j]])
                values[:, j] = np.where(there, values[:, j], np.interp(times, nodes, at_nodes))
            inputs = np.concatenate([wait_u, u[:known]])
            track = self.run.extended(live.track, times, values, inputs, there)
            live = replace(live, track=track, waiting=())
        return replace(live, waiting=live.waiting + late)

    def prediction(self, live: IntegralLive) -> Vector:
        """The free run at the last row; without measurement there, the plant from the last one."""
        if live.track is None:
            return live.x
        t, x, u = float(live.track.t[-1]), live.track.x[-1], live.track.u[-1]
        for time, following in live.waiting:
            x, t, u = self.predicted(t, x, u, time), time, following
        return np.asarray(x)

    def predicted(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        """The plant from x at t, input u held, no impulse."""
        if until <= t:
            return x
        flow, once, _ = responses(self.run.A, until - t)
        return np.asarray(flow @ x + once @ (self.run.B @ u + self.run.drift))

    # --- rows out -----------------------------------------------------------------------------

    def tail(self, live: IntegralLive) -> tuple[Estimate, ...]:
        """Rows of the last window: an impulse in them may not have been seen yet."""
        if live.track is None:
            return ()
        rows = self.given(live, len(live.track.t), _OPEN)
        t, x, u = float(live.track.t[-1]), live.track.x[-1], live.track.u[-1]
        for time, following in live.waiting:
            x, t, u = self.predicted(t, x, u, time), time, following
            missing = self.status(live, time, False)
            status = _OPEN if missing == "ok" else f"{missing}; {_OPEN}"
            rows.append(Estimate(time, x=x, status=status))
        return tuple(rows)

    def given(
        self, live: IntegralLive, count: int, more: str = "", event: Event | None = None
    ) -> list[Estimate]:
        """Estimates for the first rows of the track; `event` goes with the first row after it."""
        track = live.track
        assert track is not None
        found = []
        times, seen, x = (
            track.t[:count].tolist(),
            track.seen[:count].tolist(),
            list(track.x[:count]),
        )
        for k, t in enumerate(times):
            status = more or "ok"
            if not seen[k] or live.doubt[0] <= t <= live.doubt[1]:
                words = [self.status(live, t, seen[k])]
                words += [live.doubt[2]] if live.doubt[0] <= t <= live.doubt[1] else []
                status = "; ".join(w for w in (*words, more) if w and w != "ok") or "ok"
            events: tuple[Event, ...] = ()
            if event is not None and (t >= event.t or k == count - 1):
                events, event = (event,), None
            found.append(Estimate(t, x=x[k], events=events, status=status))
        return found

    def status(self, live: IntegralLive, t: float, seen: bool) -> str:
        """ok, or that a sample is missing at t."""
        if seen:
            return "ok"
        if self.period is not None and live.first is not None:
            count = (t - live.first) / self.period
            if abs(count - round(count)) > 1e-6:
                return "ok"  # a row between two samples misses none
        return _MISSING
