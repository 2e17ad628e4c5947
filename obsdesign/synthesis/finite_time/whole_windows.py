"""Windows of whole samples near the one for which condition (13) allows the longest period.

nu = T/k has to be below nu_max(T). Where T is open, T/k and nu_max(T) meet for each k, and the
best k is next to T*/nu_max(T*) of the best window T*. In floats, without proof.
"""

from __future__ import annotations

import math

from obsdesign.equations.finite_time.gains import MOST_SAMPLES
from obsdesign.synthesis.finite_time.period_problem import Injection, PeriodProblem

# windows are tried from T (1 + REACH / k) downwards to T (1 - REACH / k), so many per T / k
_REACH, _PER_SAMPLE = 2, 8
_HALVINGS = 48
# relative distance from the end of (13) at which balls can decide
_INSIDE = 1e-12


def whole_windows(problem: PeriodProblem, best: Injection, least: int) -> list[tuple[float, int]]:
    """(period, samples) with T/k just below nu_max(T) for the L of best, longest period first.

    k is one of the few integers next to T / nu_max, at least `least`; none beyond MOST_SAMPLES.
    """
    ratio = math.log(best.window) - best.log_period
    if not ratio < math.log(MOST_SAMPLES):
        return []
    near = math.floor(math.exp(ratio))
    windows = []
    for k in range(max(near - 1, least, 1), near + 3):
        window = _longest(problem, best, k)
        if window is not None:
            windows.append((window * (1 - _INSIDE) / k, k))
    return sorted(windows, reverse=True)


def _longest(problem: PeriodProblem, best: Injection, k: int) -> float | None:
    """The largest T near that of best with T/k below nu_max(T), by bisection; None: none."""

    def is_allowed(T: float) -> bool:
        return problem.rated(best.L, T, best.S).log_period >= math.log(T / k)

    steps = range(_REACH * _PER_SAMPLE, -_REACH * _PER_SAMPLE - 1, -1)
    windows = [best.window * (1 + step / (_PER_SAMPLE * k)) for step in steps]
    above = None
    for window in (T for T in windows if T > 0):
        if is_allowed(window):
            break
        above = window
    else:
        return None
    low, high = window, window if above is None else above
    for _ in range(_HALVINGS if above is not None else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if is_allowed(middle) else (low, middle)
    return low
