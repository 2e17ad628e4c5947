"""Windows of whole samples near the one for which condition (13) allows the longest period.

nu = T/k has to be below nu_max(T). Where T is open, T/k and nu_max(T) meet for each k, and the
best k is next to T*/nu_max(T*) of the best window T*. In floats; what comes out is proved or not
by others.
"""

from __future__ import annotations

import math

from obsdesign.equations.finite_time.gains import MOST_SAMPLES
from obsdesign.synthesis.finite_time.injection import Injection, Open

# windows are tried from T (1 + REACH / k) downwards to T (1 - REACH / k), so many per T / k
_REACH, _PER_SAMPLE = 2, 8
_HALVINGS = 48
# balls decide nothing closer to the end of (13)
_INSIDE = 1e-12


def whole_windows(asked: Open, best: Injection, least: int) -> list[tuple[float, int]]:
    """(period, samples) with T/k just below nu_max(T) for the L of best, longest period first.

    k is one of the few integers next to T / nu_max, at least `least`; none beyond MOST_SAMPLES.
    """
    ratio = math.log(best.window) - best.log_period
    if not ratio < math.log(MOST_SAMPLES):
        return []
    near = math.floor(math.exp(ratio))
    found = []
    for k in range(max(near - 1, least, 1), near + 3):
        window = _longest(asked, best, k)
        if window is not None:
            found.append((window * (1 - _INSIDE) / k, k))
    return sorted(found, reverse=True)


def _longest(asked: Open, best: Injection, k: int) -> float | None:
    """The largest T near that of best with T/k below nu_max(T), by bisection; None: none."""

    def allowed(T: float) -> bool:
        return asked.rated(best.L, T, best.S).log_period >= math.log(T / k)

    steps = range(_REACH * _PER_SAMPLE, -_REACH * _PER_SAMPLE - 1, -1)
    tried = [best.window * (1 + step / (_PER_SAMPLE * k)) for step in steps]
    above = None
    for window in (T for T in tried if T > 0):
        if allowed(window):
            break
        above = window
    else:
        return None
    low, high = window, window if above is None else above
    for _ in range(_HALVINGS if above is not None else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low
