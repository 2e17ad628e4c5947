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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.patience import remark, until
from obsdesign.equations import finite_time as equations
from obsdesign.equations.finite_time_bounds import approx_log_longest_period
from obsdesign.synthesis.period_nlp import (
    PeriodProgram,
    Start,
    normal_coordinates,
    triangle_of,
    triangular,
)

Array = NDArray[np.float64]

# starts of IPOPT, each the better one of so many
_STARTS, _SCREENED = 6, 4
# processor time of one search, and the part of it that IPOPT may have
SECONDS, _OF_PROGRAM = 0.6, 0.5
# |L| of the first guess relative to |A| / |C|
_SMALL = 1e-3
_NELDER_MEAD: Any = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 2000, "maxfev": 2000}
# beyond, a simplex only creeps
_MOST_UNKNOWNS = 12


@dataclass(frozen=True)
class Injection:
    """L (n, p), window T, log of the period below which (13) holds (in floats), S or None."""

    L: Array
    window: float
    log_period: float
    S: Array | None = None


@dataclass(frozen=True)
class Open:
    """A plant, and what of T, L and S is given; coordinates: is S to be found?

    tighter: with `tighter_sigma` in place of Sigma in (13).
    """

    A: Array
    C: Array
    window: float | None = None
    L: Array | None = None
    coordinates: bool = False
    tighter: bool = False

    @property
    def unknowns(self) -> str:
        """What is open, for a person."""
        names = ["L"] if self.L is None else []
        names += ["the window"] if self.window is None else []
        names += ["coordinates S"] if self.coordinates else []
        return " and ".join(names) + (" for a tighter Lemma 2" if self.tighter else "")

    def rated(self, L: Array, T: float, S: Array | None = None) -> Injection:
        """As (13) allows, and short enough for the window to hold n / p samples."""
        value = approx_log_longest_period(self.A, self.C, L, T, S, self.tighter)
        most = math.log(T) - math.log(math.ceil(len(self.A) / len(self.C)))
        return Injection(L, T, -math.inf if math.isnan(value) else min(value, most), S)


def best_injection(
    asked: Open,
    first: Sequence[Injection] = (),
    *,
    starts: int = _STARTS,
    seconds: float = SECONDS,
) -> Injection:
    """The longest period of (13) over what is open; never a shorter one than those of `first`."""
    end = until(seconds)
    known = [asked.rated(one.L, asked.window or one.window, one.S) for one in first]
    guesses = [*known, *_guesses(asked)]
    if starts and (asked.L is None or asked.coordinates):
        guesses += _of_program(asked, starts, until(_OF_PROGRAM * seconds))
    best = max(guesses, key=lambda one: one.log_period)
    return max(_polished(asked, best, end), best, key=lambda one: one.log_period)


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


# --- the last per cent ----------------------------------------------------------------------------


class _Over(Exception):
    """The time of a search has ended."""


class _Polish:
    """What is open as one vector: direction and size of L, log T, the triangle of S."""

    def __init__(self, asked: Open, start: Injection, end: float) -> None:
        self._asked, self._start, self._end = asked, start, end
        self.best = start
        size = float(np.linalg.norm(start.L)) or 1.0
        x: list[Array] = []
        if asked.L is None:
            x += [start.L.reshape(-1) / size, np.array([math.log(size)])]
        if asked.window is None:
            x.append(np.array([math.log(start.window)]))
        if asked.coordinates:
            x.append(triangle_of(np.eye(len(asked.A)) if start.S is None else start.S))
        self.x0 = np.concatenate(x) if x else np.zeros(0)
        self._least = equations.SMALLEST_GAIN * float(np.linalg.norm(asked.A, 2))

    def cost(self, x: Array) -> float:
        """-log of the period; _Over when time is."""
        if time.process_time() > self._end:
            raise _Over
        if not np.isfinite(x).all() or np.abs(x).max() > 700:
            return 1e6
        found = self._point(x)
        if found.log_period > self.best.log_period:
            self.best = found
        return -found.log_period if math.isfinite(found.log_period) else 1e6

    def _point(self, x: Array) -> Injection:
        asked, L, T, S = self._asked, self._start.L, self._start.window, None
        if asked.L is None:
            m = L.size
            L = (x[:m] / (np.linalg.norm(x[:m]) or 1.0)).reshape(L.shape) * math.exp(x[m])
            seen = float(np.linalg.norm(L @ asked.C, 2))
            L = L * max(1.0, 1.000001 * self._least / seen) if seen > 0 else L
            x = x[m + 1 :]
        if asked.window is None:
            T, x = math.exp(x[0]), x[1:]
        if asked.coordinates:
            S = triangular(x, len(asked.A))
        return asked.rated(L, T, S)


def _polished(asked: Open, start: Injection, end: float) -> Injection:
    from scipy.optimize import minimize

    polish = _Polish(asked, start, end)
    x, count = polish.x0, len(polish.x0)
    if math.isinf(start.log_period) or not count:
        return start
    try:
        x = minimize(polish.cost, x, method="BFGS", options={"gtol": 1e-7, "maxiter": 100}).x
        # norms have kinks where singular values meet; a simplex that has collapsed is opened again
        for spread in (0.3, 0.1) if count <= _MOST_UNKNOWNS else ():
            simplex = np.vstack([x, x + spread * np.eye(count)])
            options = {**_NELDER_MEAD, "initial_simplex": simplex}
            x = minimize(polish.cost, x, method="Nelder-Mead", options=options).x
    except _Over:
        _ended(asked.unknowns)
    return polish.best


def _ended(what: str) -> None:
    remark(f"the search of {what} ended with its time; a longer one might find better")


# --- the fewest samples ---------------------------------------------------------------------------

_BISECTION_SECONDS, _SCAN_SECONDS = 0.15, 10.0


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
    low, high = least - 1, max(least, math.floor(best.window / period))
    found = _with_samples(asked, high * period, best)
    while high - low > 1:
        middle = (low + high) // 2
        other = _with_samples(asked, middle * period, found)
        if other.log_period > log_period:
            high, found = middle, other
        else:
            low = middle
    if found.log_period <= log_period:
        found = best_injection(_at(asked, high * period), (best,))
    return high, found


def _at(asked: Open, window: float) -> Open:
    return replace(asked, window=window)


def _with_samples(asked: Open, window: float, near: Injection) -> Injection:
    return best_injection(_at(asked, window), (near,), starts=0, seconds=_BISECTION_SECONDS)


def _scanned(asked: Open, L: Array, period: float, least: int) -> tuple[int | None, Injection]:
    # beyond some ten time constants only rounding is left of M_T
    reach = math.ceil(60.0 / (np.linalg.norm(asked.A, 2) * period))
    end = until(_SCAN_SECONDS)
    for k in range(least, max(min(equations.MOST_SAMPLES, reach), least) + 1):
        value = approx_log_longest_period(asked.A, asked.C, L, k * period, None, asked.tighter)
        if value > math.log(period):
            return k, Injection(L, k * period, value)
        if time.process_time() > end:
            _ended("the shortest window")
            break
    return None, Injection(L, least * period, -math.inf)
