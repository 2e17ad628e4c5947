"""The state of an interval observer between two samples, and what bounds it begins with."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.runtime.base import DwellGuard, Vector, vector
from obsdesign.runtime.interval.model import Model, midpoint


class Course(NamedTuple):
    """Bounds since a sample on the period or a jump, beside those of the rows that came between.

    since: its time; now: that of the last row; radius: (n,) at the first; path: (2n,), the centre
    carried along to the second, after a bound of what rounding has added to it.
    """

    since: float
    now: float
    radius: Vector
    path: Vector


class IntervalState(NamedTuple):
    """Everything the next step needs, just after time t.

    box: (2n,), radius and centre in the observer's coordinates; u: input that holds; y: measurement
    that the next step may start from; sampled: time of the last one used; lost: since when, and
    why, the bounds are refuted; phase: time of the last sample that was a period after another
    one, or began anew (periodic samples only), NaN before the first; moderate: all numbers of the
    last step were below `MODERATE`; course: None where the box is just after a sample on the
    period or a jump (periodic samples only).
    """

    t: float
    box: Vector
    u: Vector
    y: Vector | None
    guard: DwellGuard
    started: bool
    sampled: float
    lost: str = ""
    phase: float = math.nan
    moderate: bool = False
    course: Course | None = None


def first_box(model: Model, n: int, lower: ArrayLike, upper: ArrayLike) -> Vector:
    """[r; m] in the observer's coordinates from bounds of x; ValueError if they are none."""
    low, high = vector(lower, n, "lower"), vector(upper, n, "upper")
    for i in np.flatnonzero(~(np.isfinite(low) & np.isfinite(high))):
        raise ValueError(
            f"initial bounds of x{i + 1} must be finite numbers; got {low[i]:g}, {high[i]:g}."
        )
    for i in np.flatnonzero(low > high):
        raise ValueError(f"initial bounds of x{i + 1}: lower {low[i]:g} exceeds upper {high[i]:g}.")
    with np.errstate(over="ignore", invalid="ignore"):  # the next step reports what overflowed
        return model.from_plant(*midpoint(low, high))


def shared_box(one: Vector, other: Vector, n: int) -> Vector:
    """A box around what two boxes [r; m] share, or the first if they share nothing."""
    with np.errstate(invalid="ignore"):
        lower = np.maximum(one[n:] - one[:n], other[n:] - other[:n])
        upper = np.minimum(one[n:] + one[:n], other[n:] + other[:n])
        lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
        if not (lower <= upper).all() or not np.isfinite(upper - lower).all():
            return one
    centre, radius = midpoint(lower, upper)
    return np.concatenate([np.minimum(radius, np.inf), centre])
