"""Matrices of a step, built once for each length.

Point estimates use the difference of two stamps as it is (`cached_step`): equal decimal steps have
a few different ones. Bounds include the error of the length anyway (`clocks.time_stamps`), so that
there all of them share one matrix (`shared_step`).
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.clocks.time_stamps import length_error

K = TypeVar("K")
T = TypeVar("T")

_CACHED_STEPS = 256
# Units in the last place: a step of fewer keeps its own length, a longer one is rounded to a
# decimal unit of at least as many as two stamps of equal decimal steps can differ by, and a half.
SHORT_STEP_ULPS, _LEAST_UNIT_ULPS = 128.0, 3.0


def cached_step(
    cache: OrderedDict[K, T], h: K, build: Callable[[K], T], most: int = _CACHED_STEPS
) -> T:
    """Return `build(h)`, from the cache if it is there; most: entries that are kept."""
    try:
        return cache[h]
    except KeyError:
        value = cache[h] = build(h)
    if len(cache) > most:
        cache.popitem(last=False)
    return value


def shared_step(
    cache: OrderedDict[tuple[float, int], T],
    h: float,
    size: float,
    build: Callable[[float, float], T],
) -> T:
    """Return `build(length, error)` for a step h >= 0 between stamps of at most `size`.

    `error` bounds the distance from `length` to the true length of every step that shares the
    result (`obsdesign.runtime.clocks.time_stamps`); it is zero for h = 0 alone.
    """
    length, half = shared_length(h, size)
    key = (length, math.frexp(size)[1])
    try:
        return cache[key]
    except KeyError:
        error = half + length_error(length, size) if h else 0.0
        return cached_step(cache, key, lambda _: build(length, error))


def shared_length(h: float, size: float) -> tuple[float, float]:
    """(length, half): every step within `half` of `length` shares its matrices with h.

    The unit is decimal, 1, 2 or 5 times a power of ten and at most 7.5 ulp: equal decimal steps
    lie around a multiple of it, those of k * 0.1 around 0.1, and are not split.
    """
    if h < SHORT_STEP_ULPS * math.ulp(size):
        return h, 0.0
    unit = decimal_unit(size)
    length = round(h / unit) * unit
    return length, _half(length, unit)


def shared_lengths(steps: Matrix, sizes: Matrix) -> tuple[Matrix, Indices]:
    """`shared_length` of each of the steps (k,), without halves, and the exponents of `sizes`."""
    exponents = np.frexp(sizes)[1]
    units = np.ones_like(steps)
    for exponent in np.unique(exponents).tolist():
        units[exponents == exponent] = decimal_unit(math.ldexp(0.5, exponent))
    is_short = steps < SHORT_STEP_ULPS * np.spacing(sizes)
    return np.where(is_short, steps, np.rint(steps / units) * units), exponents


def shared_error(longest: float, size: float) -> float:
    """Bound of the distance from shared lengths of up to `longest` to the true ones."""
    return _half(longest, decimal_unit(size)) + length_error(longest, size)


def decimal_unit(size: float) -> float:
    """Unit of the lengths that steps between stamps of at most `size` share."""
    return _decimal_unit(math.ulp(size))


@lru_cache(maxsize=128)
def _decimal_unit(ulp: float) -> float:
    least = _LEAST_UNIT_ULPS * ulp
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least)


def _half(length: float, unit: float) -> float:
    """How far steps may be from the length that they share."""
    # quotient and product are rounded, by less than an ulp and by half an ulp of h; h is below
    # length + unit, and what is shared does not depend on which of these steps came first
    return 0.5 * unit + 2.0 * math.ulp(length + unit)
