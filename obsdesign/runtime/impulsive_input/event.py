"""An impulse that was decided: its time, its weights, their deviations and doubts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from obsdesign.runtime.base import Vector
from obsdesign.runtime.time_stamps import time_tolerance

MISFIT = "does not fit one impulse in the window"
_DEVIATIONS = 3.0  # deviations by which a dwell time must be too short


@dataclass(frozen=True, slots=True)
class Event:
    """An impulse that was decided: time, weights (q,), standard deviations, doubts.

    The deviations are None where the problem states no noise; doubts: sentences, none where nothing
    is doubtful.
    """

    t: float
    weights: Vector
    t_std: float | None
    weights_std: Vector | None
    doubts: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """`ok`, or what is doubtful."""
        return "; ".join(self.doubts) or "ok"

    def row(self) -> tuple[float | str, ...]:
        """The cells of an event file: t, weights, t_std, deviations of the weights, status."""
        unknown = np.full(len(self.weights), np.nan)
        spread = unknown if self.weights_std is None else self.weights_std
        t_std = np.nan if self.t_std is None else self.t_std
        return (
            float(self.t),
            *map(float, self.weights),
            float(t_std),
            *map(float, spread),
            self.status,
        )


@dataclass(frozen=True, slots=True)
class DoubtfulSpan:
    """Times whose rows rest on an impulse with doubts; at first none."""

    since: float = math.inf
    until: float = -math.inf
    doubts: tuple[str, ...] = ()

    def doubts_at(self, t: float) -> tuple[str, ...]:
        """Doubts of a row at time t."""
        return self.doubts if self.since <= t <= self.until else ()


def short_dwell(last: float, t: float, dwell: float, *deviations: float) -> str:
    """Sentence about a dwell time below the range by more than both deviations allow, or empty."""
    gap = t - last
    if gap >= dwell - time_tolerance(dwell, t) - _DEVIATIONS * math.hypot(*deviations):
        return ""
    return f"dwell time {gap:.9g} below {dwell:.9g}"
