"""Boxes of states as kinds with bounds read and report them."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import numbered, pairs
from obsdesign.errors import InputError
from obsdesign.runtime.base import vector

# the event of a jump, beside those of objections
JUMP = "jump"


class BoundsFault(StrEnum):
    """Bounds that a step cannot report as they are; each is a reason in the status."""

    OVERFLOWED = "bounds overflowed"
    CROSSED = "bounds crossed"  # which refutes the bounds of the step before
    APART = "state box refuted"  # the bounds without it do not cross


def bound_names(n: int) -> tuple[str, ...]:
    """Columns of the bounds of n states: x1_lo, x1_hi, ..."""
    return pairs(numbered("x", n))


def midpoint(lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """Centre and radius of a box; the radius is rounded up so that the box is contained."""
    centre = lower + (0.5 * upper - 0.5 * lower)
    radius = np.maximum(upper - centre, centre - lower)
    return centre, np.where(lower == upper, 0.0, np.nextafter(radius, np.inf))


def initial_bounds(n: int, lower: ArrayLike, upper: ArrayLike) -> tuple[Matrix, Matrix]:
    """Bounds of x as two vectors (n,); ValueError unless they are finite and not crossed."""
    low, high = vector(lower, n, "lower"), vector(upper, n, "upper")
    for i in np.flatnonzero(~(np.isfinite(low) & np.isfinite(high))):
        raise ValueError(
            f"initial bounds of x{i + 1} must be finite numbers; got {low[i]:g}, {high[i]:g}."
        )
    for i in np.flatnonzero(low > high):
        raise ValueError(f"initial bounds of x{i + 1}: lower {low[i]:g} exceeds upper {high[i]:g}.")
    return low, high


def stated_bounds(n: int, initial: Sequence[float] | None) -> tuple[Matrix, Matrix]:
    """Bounds of x from the numbers x1_lo, x1_hi, x2_lo, ...; InputError if they are none."""
    if initial is None or len(initial) != 2 * n:
        arrived = "nothing" if initial is None else f"{len(initial)} numbers"
        names = ",".join(bound_names(n))
        raise InputError(f"--initial must be the {2 * n} numbers {names}; got {arrived}.")
    try:
        return initial_bounds(n, initial[0::2], initial[1::2])
    except ValueError as error:
        raise InputError(f"--initial: {error}") from None
