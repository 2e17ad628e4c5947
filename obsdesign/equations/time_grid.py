"""Times of a plant in discrete time: whole numbers of its steps."""

from __future__ import annotations

import math

# decimal times that agree to this part of their length are equal
_EQUAL = 1e-9


def steps_of(time: float, dt: float) -> int | None:
    """Number of steps dt in a finite time >= 0; None where it is no whole number of them."""
    ratio = time / dt
    if not math.isfinite(ratio):
        return None
    count = round(ratio)
    return count if abs(time - count * dt) <= _EQUAL * max(time, dt) else None
