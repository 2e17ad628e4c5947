"""Equal steps share their matrices, although their lengths differ by rounding."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

_CACHED_STEPS = 256


def cached_step(
    cache: OrderedDict[tuple[float, int], T],
    h: float,
    size: float,
    build: Callable[[float, float], T],
) -> T:
    """What `build(length, error)` makes for a step of about h between time stamps of size `size`.

    A difference of two stamps is known to an ulp of the larger. It is rounded to that many
    decimals, and `error` bounds how far the true step may be from the rounded one, for all stamps
    whose steps are rounded alike: what is cached does not depend on which of them came first.
    """
    length, half, decimals = rounded_step(h, size)
    key = (length, decimals)
    if key not in cache:
        cache[key] = build(length, 2 * half)  # 4 ulp(size) is at most one unit, 2 half
        if len(cache) > _CACHED_STEPS:
            cache.popitem(last=False)
    return cache[key]


def rounded_step(h: float, size: float) -> tuple[float, float, int]:
    """(rounded length, half a unit of its last decimal, decimals) for steps that are taken as one.

    Every step within half a unit of the rounded length, between stamps of the same size, is one.
    """
    decimals = math.floor(-math.log10(4 * math.ulp(size)))
    length = round(h, decimals)
    if not length:  # a step that is shorter than the unit keeps its length
        return h, 0.0, decimals
    return length, 0.5 * 10.0**-decimals, decimals
