"""Time on a target: lengths of steps that are listed, and ticks that they are multiples of.

Dwell times and periods are compared as whole numbers of ticks, exactly: a target's clock does not
drift, and no time stamp is stored.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.errors import InputError
from obsdesign.runtime.clocks.time_stamps import RELATIVE_TIME_TOLERANCE

# ticks are 32-bit numbers on the target, where the largest one stands for never
MOST_TICKS = 2**31
# lengths that one source file may list
MOST_STEPS = 64
# parts of a length that it may be off
MOST_ERROR = 0.1


@dataclass(frozen=True)
class Steps:
    """Lengths of steps as an export lists them, none: the period; error: how far off, relative."""

    lengths: tuple[float, ...] = ()
    error: float = 0.0

    def listed(self, period: float | None = None) -> tuple[float, ...]:
        """The lengths, ascending; InputError where they are none."""
        if not 0.0 <= self.error <= MOST_ERROR:
            raise InputError(
                f"--step-error must be from 0 to {MOST_ERROR:g}, in parts of the length; "
                f"got {self.error!r}."
            )
        return _listed(self.lengths or (() if period is None else (period,)))


@dataclass(frozen=True)
class Timing:
    """Lengths of steps, and what is compared in ticks.

    lengths: those that are listed, above zero and ascending; tick: their largest common unit;
    shortest, longest, jitter: of dwell times, longest and jitter None where there is no limit;
    period: of samples, None where they are no events; limit: ticks of the longest step for which a
    width is guaranteed, None without; borders: of dwell times in ticks, from which on the next jump
    gain of a schedule counts; error: of lengths, relative.
    """

    lengths: tuple[float, ...]
    tick: Fraction
    shortest: int
    longest: int | None
    jitter: int | None
    period: int | None = None
    limit: int | None = None
    borders: tuple[int, ...] = ()
    error: float = 0.0

    @property
    def ticks(self) -> list[int]:
        """Ticks of each length."""
        return [int(_exactly(length) / self.tick) for length in self.lengths]

    @property
    def spacings(self) -> int | None:
        """How many dwell times there are in whole ticks; None without a longest one."""
        return None if self.longest is None else self.longest - self.shortest + 1

    @property
    def has_guard(self) -> bool:
        """Is there any limit of dwell times?"""
        return self.shortest > 0 or self.longest is not None or self.jitter is not None


def _listed(lengths: Sequence[float]) -> tuple[float, ...]:
    if not lengths:
        raise InputError(
            "--steps is missing: the lengths of the steps that the code is for, "
            "as in --steps 0.01,0.02."
        )
    for length in lengths:
        if not 0.0 < length < math.inf:
            raise InputError(f"--steps: lengths must be positive numbers; got {length!r}.")
    if len(set(lengths)) > MOST_STEPS:
        raise InputError(f"--steps: at most {MOST_STEPS} lengths; got {len(set(lengths))}.")
    return tuple(sorted(set(lengths)))


def timing_of(
    steps: Steps,
    dwell_range: tuple[float, float],
    jitter: float | None,
    *,
    period: float | None = None,
    limit: float | None = None,
    borders: Matrix | None = None,
) -> Timing:
    """The timing of a design; InputError where lengths have no common unit that is long enough."""
    lengths = steps.listed(period)
    every = [*lengths, *([] if period is None else [period])]
    tick = _common_unit(every)
    largest = max(_exactly(length) for length in every) / tick
    if largest > MOST_TICKS:
        raise InputError(
            f"--steps: {', '.join(map(repr, every))} have {float(tick):.3g} as largest common "
            "unit, which is too short; list lengths that are multiples of a longer one."
        )
    shortest, longest = dwell_range
    return Timing(
        lengths, tick, _from(shortest, tick), _up_to(longest, tick),
        None if jitter is None else _up_to(jitter, tick),
        None if period is None else int(_exactly(period) / tick),
        None if limit is None else _up_to(limit, tick),
        tuple(_from(border, tick) for border in ([] if borders is None else borders.tolist())),
        steps.error,
    )  # fmt: skip


def _exactly(length: float) -> Fraction:
    """The decimal number that a length is written as."""
    return Fraction(repr(float(length)))


def _common_unit(lengths: Sequence[float]) -> Fraction:
    exact = [_exactly(length) for length in lengths]
    below = math.lcm(*(each.denominator for each in exact))
    return Fraction(math.gcd(*(int(each * below) for each in exact)), below)


def _tolerance(length: Fraction) -> Fraction:
    return Fraction(RELATIVE_TIME_TOLERANCE) * length


def _from(length: float, tick: Fraction) -> int:
    """Fewest ticks that are not below a length, up to the tolerance of times."""
    exact = _exactly(length)
    return min(max(math.ceil((exact - _tolerance(exact)) / tick), 0), MOST_TICKS)


def _up_to(length: float, tick: Fraction) -> int | None:
    """Most ticks that are not above a length, up to the tolerance; None where any are."""
    if not np.isfinite(length):
        return None
    exact = _exactly(length)
    ticks = math.floor((exact + _tolerance(exact)) / tick)
    return None if ticks > MOST_TICKS else ticks
