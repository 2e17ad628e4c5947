"""L of finite-time estimation where it is left open, and the window with it.

By default L makes the period of condition (13) long: IPOPT from several starts
(`period_nlp`), then Nelder and Mead on the true norms, which closes the last per cent. Small L are
good for it, and bounded below (`SMALLEST_GAIN`). With objective `least_noise` L makes the gains
small instead. Floats only; what comes out is proved or not by others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm, exponential_grid, flow_integrals
from obsdesign.equations import finite_time as equations
from obsdesign.equations.finite_time_bounds import approx_log_longest_period
from obsdesign.problem import Problem

Array = NDArray[np.float64]

_STARTS = 8
# |L| of the first guess relative to |A| / |C|
_SMALL = 1e-3
_POLISH: Any = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 2000, "maxfev": 2000}


@dataclass(frozen=True)
class Injection:
    """L (n, p), a window T, and log of the period below which (13) holds for them, in floats."""

    L: Array
    window: float
    log_period: float


def best_injection(
    A: Array, C: Array, window: float | None, L: Array | None = None, starts: int = _STARTS
) -> Injection:
    """The longest period of (13) over what is None: L, window, or both."""
    guesses = _guesses(A, C, window, L, starts)
    ranked = sorted(guesses, key=lambda one: -one.log_period)
    best = _polished(A, C, ranked[0], window is None, L is None)
    return max(best, ranked[0], key=lambda one: one.log_period)


def _guesses(
    A: Array, C: Array, window: float | None, L: Array | None, starts: int
) -> list[Injection]:
    size = float(np.linalg.norm(A, 2)) or 1.0
    windows = [window] if window is not None else [x / size for x in (0.1, 0.3, 1.0, 3.0)]
    small = _SMALL * size / float(np.linalg.norm(C, 2)) ** 2
    gains = [small * C.T, -small * C.T, small * np.ones_like(C.T)] if L is None else [L]
    found = [_rated(A, C, gain, T) for gain in gains for T in windows]
    if L is None and starts:
        from obsdesign.synthesis.period_nlp import PeriodProgram

        program = PeriodProgram(A, C, window)
        for start in program.starts(starts):
            point = program.solve(start)
            if np.isfinite(point.L).all() and 0 < point.window < math.inf:
                found.append(_rated(A, C, point.L, point.window))
    return found


def _rated(A: Array, C: Array, L: Array, T: float) -> Injection:
    return Injection(L, T, _log_period(A, C, L, T))


def _log_period(A: Array, C: Array, L: Array, T: float) -> float:
    """As (13) allows, and short enough for the window to hold n / p samples."""
    value = approx_log_longest_period(A, C, L, T)
    if math.isnan(value):
        return -math.inf
    return min(value, math.log(T) - math.log(math.ceil(len(A) / len(C))))


def _polished(A: Array, C: Array, start: Injection, free_window: bool, free_L: bool) -> Injection:
    """Nelder and Mead from a point, over direction and size of L and log T."""
    from scipy.optimize import minimize

    if math.isinf(start.log_period) or not (free_window or free_L):
        return start
    least = equations.SMALLEST_GAIN * float(np.linalg.norm(A, 2))
    size = float(np.linalg.norm(start.L)) or 1.0

    def point(x: Array) -> tuple[Array, float]:
        L = start.L
        if free_L:
            L = (x[:-2] / (np.linalg.norm(x[:-2]) or 1.0)).reshape(L.shape) * math.exp(x[-2])
            seen = float(np.linalg.norm(L @ C, 2))
            L = L * max(1.0, 1.000001 * least / seen) if seen > 0 else L
        return L, math.exp(x[-1]) if free_window else start.window

    def cost(x: Array) -> float:
        if abs(x[-1]) > 700 or abs(x[-2]) > 700:
            return math.inf
        value = _log_period(A, C, *point(x))
        return -value if math.isfinite(value) else 1e6

    x0 = np.concatenate([start.L.reshape(-1) / size, [math.log(size), math.log(start.window)]])
    for _ in range(2):  # a simplex that has collapsed is opened again
        spread = np.vstack([x0, x0 + 0.3 * np.eye(len(x0))])
        x0 = minimize(
            cost, x0, method="Nelder-Mead", options={**_POLISH, "initial_simplex": spread}
        ).x
    return _rated(A, C, *point(x0))


def fewest_samples(A: Any, C: Any, given: Any, period: float, least: int) -> tuple[int | None, Any]:
    """(k, L): fewest samples, at least `least`, for which (13) seems to hold; None: there are none.

    For a given L all numbers are tried upwards; else by bisection below the best window.
    """
    if not np.any(A):
        return least, C.T if given is None else given
    log_period = math.log(period)
    if given is not None:
        # beyond some ten time constants only rounding is left of M_T
        most = min(equations.MOST_SAMPLES, math.ceil(60.0 / (np.linalg.norm(A, 2) * period)))
        for k in range(least, max(most, least) + 1):
            if approx_log_longest_period(A, C, given, k * period) > log_period:
                return k, given
        return None, given
    best = best_injection(A, C, None)
    if best.log_period <= log_period:
        return None, best.L
    low, high, L = least - 1, max(least, math.floor(best.window / period)), best.L
    while high - low > 1:
        middle = (low + high) // 2
        found = best_injection(A, C, middle * period, starts=0)
        if found.log_period > log_period:
            high, L = middle, found.L
        else:
            low = middle
    if approx_log_longest_period(A, C, L, high * period) <= log_period:
        L = best_injection(A, C, high * period).L
    return high, L


def chosen_injection(problem: Problem, k: int) -> Array:
    """L for a window of k samples, by the problem's objective."""
    A, C = problem.plant.flow.A, problem.plant.output.C
    period = float(problem.plant.output.period or 1.0)
    if not np.any(C) or not np.any(A):
        return C.T / max(float(np.linalg.norm(C)) ** 2, 1e-300) / (k * period)
    L = best_injection(A, C, k * period).L
    if problem.options.get("objective") == "least_noise":
        return _quiet(A, C, L, period, k, str(problem.options.get("method")))
    return L


def _quiet(A: Array, C: Array, L: Array, period: float, k: int, method: str) -> Array:
    """L with the least Frobenius norm of the gains, from a first guess and larger ones."""
    from scipy.optimize import minimize

    gain = _exact_gain if method == "exact" else _approximate_gain

    def cost(x: Array) -> float:
        with np.errstate(all="ignore"):
            try:
                size = float(np.linalg.norm(gain(A, C, x.reshape(L.shape), period, k)))
            except np.linalg.LinAlgError:
                return 1e300
        return size if math.isfinite(size) else 1e300

    reach = float(np.linalg.norm(A, 2)) / float(np.linalg.norm(C, 2))
    unit = L / np.linalg.norm(L)
    starts = [L, *(unit * reach * factor for factor in (0.1, -0.1, 1.0, -1.0))]
    runs = [minimize(cost, x.reshape(-1), method="Nelder-Mead") for x in starts]
    best = min(runs, key=lambda run: float(run.fun))
    return np.asarray(best.x).reshape(L.shape)


def _exact_gain(A: Array, C: Array, L: Array, period: float, k: int) -> Array:
    m = equations.series_steps(A, C, L, period)
    backs = exponential_grid(-A, 0.0, period / m, m)
    steps = [(back, 0.0) for back in backs]
    forward = expm(A * period)
    K_d = forward @ equations.discrete_injection(A, C, L, period / m, steps)
    terms = equations.exact_terms(forward + K_d @ C, K_d, k)
    W = equations.side_by_side(terms)
    rows = equations.sample_rows(A, C, period, k).reshape(-1, len(A))
    return np.asarray(np.linalg.solve(W @ rows, W))


def _approximate_gain(A: Array, C: Array, L: Array, period: float, k: int) -> Array:
    n = len(A)
    back, once = flow_integrals(-(A + L @ C), period)
    whole = expm(equations.difference_block(A, L @ C) * (k * period))
    terms = equations.approximate_terms(back, once @ L, k)
    return np.asarray(np.linalg.solve(whole[:n, n:], equations.side_by_side(terms)))
