"""The last per cent of a search for a long period: descent on the true norms of condition (13)."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.time_budget import ended, remark_end
from obsdesign.equations.finite_time import gains as equations
from obsdesign.synthesis.finite_time.period_question import Injection, Open, triangle_of, triangular

Array = NDArray[np.float64]

_NELDER_MEAD: Any = {"xatol": 1e-7, "fatol": 1e-11, "maxiter": 2000, "maxfev": 2000}
# beyond, a simplex only creeps
_MOST_UNKNOWNS = 12


class _Over(Exception):
    """The time of a search has ended."""


class _Enough(Exception):
    """What is asked for has been found."""


class _Polish:
    """What is open as one vector: direction and size of L, log T, the triangle of S."""

    def __init__(self, asked: Open, start: Injection, end: float, enough: float) -> None:
        self._asked, self._start, self._end, self._enough = asked, start, end, enough
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
            if found.log_period > self._enough:
                raise _Enough
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


def polished(
    asked: Open, start: Injection, end: float, seconds: float, enough: float = math.inf
) -> Injection:
    """At least as good as start, by quasi-Newton steps and simplices until the time is over.

    end: `deadline(seconds)`, seconds the budget of the whole search. enough: log of a period beyond
    which nobody asks.
    """
    from scipy.optimize import minimize

    polish = _Polish(asked, start, end, enough)
    x, count = polish.x0, len(polish.x0)
    if math.isinf(start.log_period) or not count or start.log_period > enough:
        return start
    try:
        x = minimize(polish.cost, x, method="BFGS", options={"gtol": 1e-7, "maxiter": 100}).x
        # norms have kinks where singular values meet; a simplex that has collapsed is opened again
        for spread in (0.3, 0.1) if count <= _MOST_UNKNOWNS else ():
            simplex = np.vstack([x, x + spread * np.eye(count)])
            options = {**_NELDER_MEAD, "initial_simplex": simplex}
            x = minimize(polish.cost, x, method="Nelder-Mead", options=options).x
    except _Enough:
        pass
    except _Over:
        remark_end(asked.unknowns, ended(end, seconds))
    return polish.best
