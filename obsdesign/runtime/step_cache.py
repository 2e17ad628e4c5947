"""Matrices of a step, built once for each length.

Point estimates use the difference of two stamps as it is (`cached_step`): equal decimal steps have
a few different ones. Bounds include the error of the length anyway (`clocks.time_stamps`), so that
there all of them share one matrix (`shared_step`).
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import TypeVar

from obsdesign.runtime.clocks.time_stamps import length_error

K = TypeVar("K")
T = TypeVar("T")

_CACHED_STEPS = 256
# Units in the last place: a step of fewer keeps its own length, a longer one is rounded to a
# decimal unit of at least as many as two stamps of equal decimal steps can differ by, and a half.
_SHORT_STEP_ULPS, _LEAST_UNIT_ULPS = 128.0, 3.0


def cached_step(cache: OrderedDict[K, T], h: K, build: Callable[[K], T]) -> T:
    """Return `build(h)`, from the cache if it is there."""
    return _cached(cache, h, lambda: build(h))


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
    error = half + length_error(length, size) if h else 0.0
    return _cached(cache, (length, math.frexp(size)[1]), lambda: build(length, error))


def _cached(cache: OrderedDict[K, T], key: K, build: Callable[[], T]) -> T:
    if key not in cache:
        cache[key] = build()
        if len(cache) > _CACHED_STEPS:
            cache.popitem(last=False)
    return cache[key]


def shared_length(h: float, size: float) -> tuple[float, float]:
    """(length, half): every step within `half` of `length` shares its matrices with h.

    The unit is decimal, 1, 2 or 5 times a power of ten and at most 7.5 ulp: equal decimal steps
    lie around a multiple of it, those of k * 0.1 around 0.1, and are not split.
    """
    ulp = math.ulp(size)
    if h < _SHORT_STEP_ULPS * ulp:
        return h, 0.0
    least = _LEAST_UNIT_ULPS * ulp
    power = 10.0 ** math.floor(math.log10(least))
    unit = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= least)
    length = round(h / unit) * unit
    # quotient and product are rounded, by less than an ulp and by half an ulp of h; h is below
    # length + unit, and what is shared does not depend on which of these steps came first
    return length, 0.5 * unit + 2.0 * math.ulp(length + unit)
