"""What an impulse leaves in the features of a window, by its age: a curve and its Taylor series."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input.features import impulse_responses

Array = NDArray[Any]

_POINTS = 160
_MOST_POINTS = 4000
_SWEEPS, _EVEN = 40, 1.5  # of balancing, and the scales at which it ends
_LONGEST_REACH = 20.0  # |F| step beyond which Taylor's series loses too many digits
_LEFT = 1e-3  # of the largest |b|: ages that leave less are not searched


@dataclass(frozen=True)
class ImpulseCurve:
    """[e^{D s} H; b(s)] on a grid of ages 0, step, ..., and how to go on from each point.

    F (n + mp, n + mp); states (G, n + mp, q); n states of the plant come first.
    """

    F: Array
    n: int
    step: float
    states: Array
    terms: int

    @classmethod
    def of(
        cls, F: Array, H: Array, tau: float, points: int = _POINTS, n: int | None = None
    ) -> ImpulseCurve:
        """The curve for ages in [0, tau]; the grid has `points` cells, more where F is large.

        n: entries in front that are no features; by default the states of the plant.
        """
        size = balanced_size(F)
        count = int(min(max(points, math.ceil(size * tau)), _MOST_POINTS))
        step = tau / count
        if not size * step <= _LONGEST_REACH:
            raise ValueError(
                f"A - K C or an exponent is too large for the window: {size * tau:.3g} times 1/tau"
            )
        states = impulse_responses(F, H, step, count + 1)
        if not np.isfinite(states).all():
            raise ValueError("floats cannot follow an impulse through A - K C and the features")
        reach, terms, term = size * step, 4, 1.0
        while term > 1e-18 and terms < 100:  # Taylor's remainder over one cell
            terms += 1
            term = math.exp(min(reach, 300.0) + terms * math.log(max(reach, 1e-300))
                            - math.lgamma(terms + 1))  # fmt: skip
        return cls(F, len(H) if n is None else n, step, states, terms)

    @property
    def ages(self) -> Array:
        """Grid of ages, (G,)."""
        return self.step * np.arange(len(self.states))

    @property
    def oldest(self) -> float:
        """Age from which less than a thousandth of |b| is left, in some direction; else the last.

        Beyond it whatever is in the window would be explained by an immense old impulse.
        """
        sizes = np.linalg.norm(self.states[:, self.n :], axis=1)  # (G, q)
        left = (sizes >= _LEFT * sizes.max(axis=0)).all(axis=1)
        return float(self.ages[np.flatnonzero(left)[-1]]) if left.any() else 0.0

    def series(self, k: int) -> Array:
        """Taylor coefficients of the curve about grid point k, (terms, n + mp, q)."""
        found = np.empty((self.terms, *self.states.shape[1:]))
        found[0] = self.states[k]
        for j in range(1, self.terms):
            np.matmul(self.F, found[j - 1] / j, out=found[j])
        return found

    def at(self, age: float) -> Array:
        """[e^{D s} H; b(s)] at one age."""
        k = min(max(round(age / self.step), 0), len(self.states) - 1)
        return power_sum(self.series(k), age - k * self.step)


def balanced_size(F: Array) -> float:
    """Norm of F in units of its entries that make it small: units of the states do not matter.

    Units that tie states in one direction only could shrink for ever: they stop at the diagonal.
    """
    X = np.abs(np.asarray(F, dtype=np.float64))
    own = X.diagonal().copy()
    np.fill_diagonal(X, 0.0)
    found, least = math.inf, float(own.max(initial=0.0))
    for _ in range(_SWEEPS):
        rows, columns = X.sum(axis=1), X.sum(axis=0)
        found = min(found, float((rows + own).max()), float((columns + own).max()))
        rows, columns = rows + least, columns + least
        if least == 0:
            both = (rows > 0) & (columns > 0)
            rows, columns = np.where(both, rows, 1.0), np.where(both, columns, 1.0)
        scale = np.sqrt(columns / rows)
        if scale.max() < _EVEN and scale.min() * _EVEN > 1:
            break
        X = X * scale[:, None] / scale
    return found


def power_sum(series: Array, v: float) -> Array:
    """sum_j v^j series_j; series (terms, ...)."""
    powers = v ** np.arange(len(series), dtype=np.float64)
    return (powers @ series.reshape(len(series), -1)).reshape(series.shape[1:])
