"""Steps of discrete time: their number between two stamps, and their maps."""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised
from obsdesign.errors import InputError
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.step_cache import cached_step

# part of a step that the spacing of floats at a stamp may be
_COARSEST = 2.0**-10


def require_fine(t: float, dt: float) -> None:
    """InputError unless floats near a stamp are far closer to each other than a step."""
    if math.ulp(t) > _COARSEST * dt:
        raise InputError(f"time {t!r} is too coarse to count steps of flow.dt = {dt:g}.")


def steps_to_row(start: float, end: float, dt: float, *, started: bool) -> int:
    """Number of steps from the row before to a row; InputError if it is in the same step.

    started: was there a row at `start`?
    """
    count = steps_between(start, end, dt)
    if started and count == 0:
        raise InputError(
            f"time {end!r} is in the step of the row before, {start!r}: in discrete time all "
            "samples and events of a step stand in one row."
        )
    return count


def steps_between(start: float, end: float, dt: float) -> int:
    """Number of steps between two stamps, start <= end; InputError unless it is whole.

    Two stamps are compared with the tolerance of periods (`runtime.clocks.time_stamps`).
    """
    require_fine(end, dt)
    h = end - start
    slack = time_tolerance(h, end)
    if not slack < dt / 4:
        raise InputError(f"time {end!r} is too coarse to count steps of flow.dt = {dt:g}.")
    count = round(h / dt)
    if abs(h - count * dt) > slack:
        raise InputError(
            f"time must be a multiple of flow.dt = {dt:g} after {start!r}; got {end!r}."
        )
    return count


def power_and_sum(X: Enclosure, count: int) -> tuple[Enclosure, Enclosure]:
    """X^k and I + X + ... + X^(k-1) for k >= 1, by doubling; exact for one step."""
    power, total = X, Enclosure.exactly(np.eye(len(X.mid)))
    for bit in bin(count)[3:]:
        total = total + power @ total
        power = power @ power
        if bit == "1":
            total, power = total + power, power @ X
    return power, total


class StepMaps:
    """x after so many steps x+ = A x + f of discrete time, in floats; matrices are made once."""

    def __init__(self, A: Matrix) -> None:
        self._A = Enclosure.exactly(A)
        self._made: OrderedDict[int, tuple[Matrix, Matrix]] = OrderedDict()

    def __call__(self, x: Matrix, f: Matrix, count: int) -> Matrix:
        """x (n,) after `count` steps, f (n,) in each."""
        if count == 0:
            return x
        power, total = cached_step(self._made, count, self._maps)
        return np.asarray(power @ x + total @ f)

    def _maps(self, count: int) -> tuple[Matrix, Matrix]:
        power, total = power_and_sum(self._A, count)
        return power.mid, total.mid


def reach(X: Enclosure, count: int, entering: Matrix) -> Matrix:
    """Upper bound of the sum of |X^i entering| over i < count, by doubling."""
    size, terms = np.abs(entering), 4 * len(entering)
    if count == 0:
        return np.zeros_like(size)
    power, total = X, size
    for bit in bin(count)[3:]:
        total = raised(total + power.magnitude @ total, terms)
        power = power @ power
        if bit == "1":
            total = raised(total + power.magnitude @ size, terms)
            power = power @ X
    return total
