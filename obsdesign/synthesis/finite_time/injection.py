"""L of finite-time estimation where it is left open, and with it the window and coordinates S.

L makes the period of condition (13) long: IPOPT from several starts (`period_nlp`), then
quasi-Newton steps, and Nelder and Mead on the true norms, which close the last per cent. Small L
are good for it, and bounded below (`SMALLEST_GAIN`). S only changes the norms of Theorem 1, which
then speaks of |S x|. Searches end after some processor time with the best they have seen. Floats
only; what comes out is proved or not by others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmi.time_budget import deadline, ended, remark_end
from obsdesign.equations.finite_time import gains as equations
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.synthesis.finite_time.period_descent import polished
from obsdesign.synthesis.finite_time.period_program import PeriodProgram, Start
from obsdesign.synthesis.finite_time.period_question import Injection as Injection
from obsdesign.synthesis.finite_time.period_question import Open as Open
from obsdesign.synthesis.finite_time.period_question import (
    normal_coordinates,
    triangular,
)

Array = NDArray[np.float64]

# starts of IPOPT, each the better one of so many
_STARTS, _SCREENED = 6, 4
# processor time of one search, and the part of it that IPOPT may have
SECONDS, _OF_PROGRAM = 0.6, 0.5
# |L| of the first guess relative to |A| / |C|
_SMALL = 1e-3


def best_injection(
    asked: Open,
    first: Sequence[Injection] = (),
    *,
    starts: int = _STARTS,
    seconds: float = SECONDS,
    enough: float = math.inf,
) -> Injection:
    """The longest period of (13) over what is open; never a shorter one than those of `first`.

    enough: log of a period beyond which the search need not go.
    """
    end = deadline(seconds)
    known = [asked.rated(one.L, asked.window or one.window, one.S) for one in first]
    guesses = [*known, *_guesses(asked)]
    if starts and (asked.L is None or asked.coordinates):
        guesses += _of_program(asked, starts, deadline(_OF_PROGRAM * seconds))
    best = max(guesses, key=lambda one: one.log_period)
    return max(polished(asked, best, end, seconds, enough), best, key=lambda one: one.log_period)


def _guesses(asked: Open) -> list[Injection]:
    A, C = asked.A, asked.C
    size = float(np.linalg.norm(A, 2)) or 1.0
    windows = [asked.window] if asked.window else [x / size for x in (0.1, 0.3, 1.0, 3.0)]
    small = _SMALL * size / float(np.linalg.norm(C, 2)) ** 2
    gains = [asked.L]
    if asked.L is None:
        gains = [small * C.T, -small * C.T, small * np.ones_like(C.T)]
    found = [asked.rated(L, T) for L in gains for T in windows if L is not None]
    normal = normal_coordinates(A) if asked.coordinates else None
    if normal is not None:
        S = triangular(normal, len(A))
        found += [asked.rated(one.L, one.window, S) for one in found]
    return found


def _of_program(asked: Open, starts: int, end: float) -> list[Injection]:
    """What IPOPT makes of the better ones of random starts, until the time is over."""
    seconds = end - time.process_time()
    if seconds <= 0:
        return []
    program = PeriodProgram(
        asked.A, asked.C, asked.window, L=asked.L, coordinates=asked.coordinates,
        tighter=asked.tighter, seconds=max(seconds / 2, 0.05),
    )  # fmt: skip

    def promise(start: Start) -> float:
        n, p = len(asked.A), len(asked.C)
        L = start.size * start.direction.reshape(p, n).T if asked.L is None else asked.L
        S = None if start.triangle is None else triangular(start.triangle, n)
        return asked.rated(L, asked.window or start.window, S).log_period

    ranked = sorted(program.starts(_SCREENED * starts), key=promise, reverse=True)
    found = []
    for start in ranked[:starts]:
        point = program.solve(start)
        L = point.L if asked.L is None else asked.L
        S = point.S if asked.coordinates else None
        sound = np.isfinite(point.L).all() and np.isfinite(point.S).all()
        if sound and 0 < point.window < math.inf:
            found.append(asked.rated(L, point.window, S))
        if time.process_time() > end:
            break
    return found


# --- the fewest samples ---------------------------------------------------------------------------

_BISECTION_SECONDS, _SCAN_SECONDS = 0.15, 10.0
# bisections from other starts, with that many of the samples of the one before
_ROUNDS, _FEWER = 4, 0.9


def fewest_samples(asked: Open, period: float, least: int) -> tuple[int | None, Injection]:
    """Fewest samples, at least `least`, for which (13) seems to hold, and for what; None: none.

    For a given L all numbers are tried upwards; else by bisection below the best window.
    """
    A, L = asked.A, asked.L
    log_period = math.log(period)
    if not np.any(A):
        return least, Injection(asked.C.T if L is None else L, least * period, math.inf)
    if L is not None and not asked.coordinates:
        return _scanned(asked, L, period, least)
    best = best_injection(asked)
    if best.log_period <= log_period:
        return None, best
    high = max(least, math.floor(best.window / period))
    found = _with_samples(asked, high * period, best, log_period)
    for _ in range(_ROUNDS):
        high, found = _bisected(asked, period, (least - 1, high), found)
        if high <= least:
            break
        # another start than where the last one has led to
        fewer = max(least, math.floor(_FEWER * high))
        other = best_injection(
            _at(asked, fewer * period), (found,), seconds=2 * SECONDS, enough=log_period
        )
        if other.log_period <= log_period:
            break
        high, found = fewer, other
    if found.log_period <= log_period:
        found = best_injection(_at(asked, high * period), (best,))
    return high, found


def _bisected(
    asked: Open, period: float, ends: tuple[int, int], found: Injection
) -> tuple[int, Injection]:
    """The fewest samples between the ends, the second of which will do with what was found."""
    low, high = ends
    while high - low > 1:
        middle = (low + high) // 2
        other = _with_samples(asked, middle * period, found, math.log(period))
        if other.log_period > math.log(period):
            high, found = middle, other
        else:
            low = middle
    return high, found


def _at(asked: Open, window: float) -> Open:
    return replace(asked, window=window)


def _with_samples(asked: Open, window: float, near: Injection, enough: float) -> Injection:
    return best_injection(
        _at(asked, window), (near,), starts=0, seconds=_BISECTION_SECONDS, enough=enough
    )


def _scanned(asked: Open, L: Array, period: float, least: int) -> tuple[int | None, Injection]:
    # beyond some ten time constants only rounding is left of M_T
    reach = math.ceil(60.0 / (np.linalg.norm(asked.A, 2) * period))
    end = deadline(_SCAN_SECONDS)
    for k in range(least, max(min(equations.MOST_SAMPLES, reach), least) + 1):
        value = approx_log_longest_period(asked.A, asked.C, L, k * period, None, asked.tighter)
        if value > math.log(period):
            return k, Injection(L, k * period, value)
        if time.process_time() > end:
            remark_end("the shortest window", ended(end, _SCAN_SECONDS))
            break
    return None, Injection(L, least * period, -math.inf)
