"""An impulse that was decided: its time, its weights, and how sure they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from obsdesign.runtime.base import Vector
from obsdesign.runtime.time_stamps import time_tolerance

MISFIT = "does not fit one impulse in the window"
_CERTAIN = 3.0  # deviations by which a dwell time must be too short


@dataclass(frozen=True, slots=True)
class Event:
    """An impulse that was decided: time, weights (q,), standard deviations, status.

    The deviations are None where the problem states no noise; status: "ok", or what is doubtful.
    """

    t: float
    weights: Vector
    t_std: float | None
    weights_std: Vector | None
    status: str = "ok"

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


def short_dwell(last: float, t: float, dwell: float, *deviations: float) -> str:
    """Status of an impulse that comes too soon, beyond the deviations of both times; or ""."""
    gap = t - last
    if gap >= dwell - time_tolerance(dwell, t) - _CERTAIN * math.hypot(*deviations):
        return ""
    return f"dwell time {gap:.9g} below {dwell:.9g}"
