"""Times of a plant in discrete time: whole numbers of its steps."""

from __future__ import annotations

import math

# decimal times that agree to this part of their length are equal
_RELATIVE_TOLERANCE = 1e-9


def rounded_steps(time: float, dt: float) -> int:
    """Number of steps dt in a time that is known to be one of whole steps, up to rounding."""
    return round(time / dt)


def steps_of(time: float, dt: float) -> int | None:
    """Number of steps dt in a finite time >= 0; None where it is no whole number of them."""
    ratio = time / dt
    if not math.isfinite(ratio):
        return None
    count = round(ratio)
    return count if abs(time - count * dt) <= _RELATIVE_TOLERANCE * max(time, dt) else None
