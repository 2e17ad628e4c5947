"""Features of a window as a function of the age of an impulse, and their Taylor series."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.features import feature_units, impulse_responses

_POINTS = 160
_MOST_POINTS = 4000
_SWEEPS, _BALANCED_RATIO = 40, 1.5  # of balancing, and the scales at which it ends
_MAX_TAYLOR_EXPONENT = 20.0  # |F| step beyond which Taylor's series loses too many digits
_LEAST_SHARE_OF_PEAK = 1e-3  # of the largest |b|: ages that leave less are not searched


@dataclass(frozen=True)
class ImpulseCurve:
    """[e^{D s} H; b(s)] on a grid of ages 0, step, ..., and how to go on from each point.

    F (n + mp, n + mp); states (G, n + mp, q); n states of the plant come first.
    """

    F: Matrix
    n: int
    step: float
    states: Matrix
    terms: int

    @classmethod
    def from_system(
        cls, F: Matrix, H: Matrix, tau: float, points: int = _POINTS, n: int | None = None
    ) -> ImpulseCurve:
        """The curve for ages in [0, tau]; the grid has `points` cells, more where F is large.

        n: entries in front that are no features; by default the states of the plant.
        """
        units = feature_units(F, len(H), tau)
        size = balanced_size(F * units / units[:, None])
        count = int(min(max(points, math.ceil(size * tau)), _MOST_POINTS))
        step = tau / count
        if not size * step <= _MAX_TAYLOR_EXPONENT:
            raise ValueError(
                f"A - K C or an exponent is too large for the window: {size * tau:.3g} times 1/tau"
            )
        states = impulse_responses(F, H, step, count + 1, units=units)
        if not np.isfinite(states).all():
            raise ValueError("floats cannot follow an impulse through A - K C and the features")
        reach, terms, term = size * step, 4, 1.0
        while term > 1e-18 and terms < 100:  # Taylor's remainder over one cell
            terms += 1
            term = math.exp(min(reach, 300.0) + terms * math.log(max(reach, 1e-300))
                            - math.lgamma(terms + 1))  # fmt: skip
        return cls(F=F, n=len(H) if n is None else n, step=step, states=states, terms=terms)

    @property
    def ages(self) -> Matrix:
        """Grid of ages, (G,)."""
        return self.step * np.arange(len(self.states), dtype=np.float64)

    @property
    def oldest(self) -> float:
        """Age from which less than a thousandth of |b| is left, in some direction; else the last.

        Beyond it whatever is in the window would be explained by an immense old impulse.
        """
        sizes = np.linalg.norm(self.states[:, self.n :], axis=1)  # (G, q)
        left = (sizes >= _LEAST_SHARE_OF_PEAK * sizes.max(axis=0)).all(axis=1)
        return float(self.ages[np.flatnonzero(left)[-1]]) if left.any() else 0.0

    def series(self, k: int) -> Matrix:
        """Taylor coefficients of the curve about grid point k, (terms, n + mp, q)."""
        coefficients = np.empty((self.terms, *self.states.shape[1:]))
        coefficients[0] = self.states[k]
        for j in range(1, self.terms):
            np.matmul(self.F, coefficients[j - 1] / j, out=coefficients[j])
        return coefficients

    def value(self, age: float) -> Matrix:
        """[e^{D s} H; b(s)] at one age."""
        k = min(max(round(age / self.step), 0), len(self.states) - 1)
        return power_sum(self.series(k), age - k * self.step)


def balanced_size(F: Matrix) -> float:
    """Norm of F in units of its entries that make it small: units of the states do not matter.

    Units that tie states in one direction only could shrink for ever: they stop at the diagonal.
    """
    X = np.abs(np.asarray(F, dtype=np.float64))
    own = X.diagonal().copy()
    np.fill_diagonal(X, 0.0)
    smallest, least = math.inf, float(own.max(initial=0.0))
    for _ in range(_SWEEPS):
        rows, columns = X.sum(axis=1), X.sum(axis=0)
        smallest = min(smallest, float((rows + own).max()), float((columns + own).max()))
        rows, columns = rows + least, columns + least
        if least == 0:
            both = (rows > 0) & (columns > 0)
            rows, columns = np.where(both, rows, 1.0), np.where(both, columns, 1.0)
        scale = np.sqrt(columns / rows)
        if scale.max() < _BALANCED_RATIO and scale.min() * _BALANCED_RATIO > 1:
            break
        scale = np.sqrt(scale)  # half the way: whole steps of all at once never settle a cycle
        X = X * scale[:, None] / scale
    return smallest


def power_sum(series: Matrix, v: float) -> Matrix:
    """sum_j v^j series_j; series (terms, ...)."""
    powers = v ** np.arange(len(series), dtype=np.float64)
    return (powers @ series.reshape(len(series), -1)).reshape(series.shape[1:])
