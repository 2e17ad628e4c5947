"""Step 2 of Mattsson and Medvedev: time and weight of one impulse from the features of a window.

Minimises |R - b(age) g|^2 over age and g, (18). For a given age g is a linear least-squares
solution; what remains is a function of one variable, found on a grid and refined by Newton's
method that may not leave its bracket. Rounding limits any grid (the cost is flat to 1e-16 |R|^2);
the root of the derivative is not limited by it.

    cost(age) = |r|^2,  r = R - b g,  g = b^+ R
    F = cost'/2 = -r'(b_dot g)     F' from r_dot = -b_dot g - b g_dot,
    g_dot = (b'b)^-1 (b_dot' r - b' b_dot g)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input import impulse_responses

Array = NDArray[Any]

_POINTS = 160
_MOST_POINTS = 4000
_LONGEST_REACH = 20.0  # |F| step beyond which Taylor's series loses too many digits
_LEFT = 1e-3  # of the largest |b|: ages that leave less are not searched
_NEWTON_STEPS = 60
_SETTLED = 1e-6  # of a cell of the grid: Newton steps this small converge quadratically
_CLOSE = 0.9  # of the highest: lower grid maxima cannot win by refining
_CANDIDATES = 3  # grid minima that are refined: the lowest may lie beside its neighbour's valley


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
        return _sum(self.series(k), age - k * self.step)


def balanced_size(F: Array) -> float:
    """Norm of F in units of its entries that make it small: units of the states do not matter.

    Units that tie states in one direction only could shrink for ever: they stop at the diagonal.
    """
    X = np.abs(np.asarray(F, dtype=np.float64))
    own = np.diag(np.diag(X))
    least, found = 0.0, math.inf
    for sweep in range(60):
        if sweep == 20:
            least = float(own.max(initial=0.0))
        rows, columns = (X - own).sum(axis=1) + least, (X - own).sum(axis=0) + least
        both = (rows > 0) & (columns > 0)
        scale = np.sqrt(np.where(both, columns, 1.0) / np.where(both, rows, 1.0))
        X = X * scale[:, None] / scale[None, :]
        found = min(found, float(X.sum(axis=0).max()), float(X.sum(axis=1).max()))
    return found


def _sum(series: Array, v: float) -> Array:
    powers = v ** np.arange(len(series), dtype=np.float64)
    return (powers @ series.reshape(len(series), -1)).reshape(series.shape[1:])


@dataclass(frozen=True)
class Impulse:
    """A fitted impulse: age at the end of the window, weights (q,), what it leaves and explains.

    b, b_dot: weighted features (r, q) and their derivative by age, of the impulse of weight 1;
    cost = |R - b g|^2; gain = |R|^2 - cost; inside: the minimum lies inside the range searched.
    """

    age: float
    weights: Array
    cost: float
    gain: float
    b: Array
    b_dot: Array
    inside: bool


def fit_impulse(
    R: Array,
    curve: ImpulseCurve,
    low: float,
    high: float,
    weighting: Array | None = None,
    nonnegative: bool = False,
) -> Impulse | None:
    """The impulse with age in [low, high] that explains the features R (r,) best, or None.

    weighting: (r, mp), applied to b; R is weighted already. nonnegative: weights below zero count
    as zero (one direction only). None when no age explains anything.
    """
    ages = curve.ages
    inside = np.flatnonzero((ages >= low - 1e-12 * high) & (ages <= high * (1 + 1e-12)))
    if len(inside) == 0:
        inside = np.array([int(np.argmin(np.abs(ages - (low + high) / 2)))])
    b = _weighted(curve.states[inside][:, curve.n :], weighting)
    gains = explained(b, R, nonnegative)
    best: Impulse | None = None
    for k in peaks(gains):
        if gains[k] <= 0:
            continue
        ends = (max(low, ages[inside[k]] - curve.step), min(high, ages[inside[k]] + curve.step))
        found = _refine(R, curve, int(inside[k]), ends, (low, high), weighting)
        if nonnegative and (found.weights < 0).any():
            continue
        if best is None or found.cost < best.cost:
            best = found
    return best


def _weighted(b: Array, weighting: Array | None) -> Array:
    return b if weighting is None else weighting @ b


def explained(b: Array, R: Array, nonnegative: bool) -> Array:
    """|R|^2 - min_g |R - b g|^2 for each b of a stack (G, r, q)."""
    if b.shape[2] == 1:
        column = b[:, :, 0]
        onto, size = column @ R, np.einsum("ij,ij->i", column, column)
        if nonnegative:
            onto = np.maximum(onto, 0.0)
        return np.where(size > 0, onto**2 / np.where(size > 0, size, 1.0), 0.0)
    Q = np.linalg.qr(b)[0]
    onto = np.einsum("gij,i->gj", Q, R)
    return np.einsum("ij,ij->i", onto, onto)


def peaks(gains: Array) -> list[int]:
    """The highest local maxima, highest first."""
    padded = np.concatenate([[-math.inf], gains, [-math.inf]])
    tops = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    tops = tops[gains[tops] >= _CLOSE * gains.max(initial=0.0)]
    return [int(k) for k in tops[np.argsort(-gains[tops])][:_CANDIDATES]]


def _refine(
    R: Array,
    curve: ImpulseCurve,
    k: int,
    bracket: tuple[float, float],
    limits: tuple[float, float],
    weighting: Array | None,
) -> Impulse:
    """Newton on F inside the bracket around grid point k; bisection where it would leave it."""
    n, origin = curve.n, k * curve.step
    series = curve.series(k)
    b_series = _weighted(series[:, n:], weighting)
    F_series = curve.F[n:]

    def at(age: float) -> tuple[Array, Array, Array]:
        whole = _sum(series, age - origin)
        first = F_series @ whole
        second = F_series @ (curve.F @ whole)
        return (_sum(b_series, age - origin), _weighted(first, weighting),
                _weighted(second, weighting))  # fmt: skip

    low, high = bracket
    ends = [_slope(R, *at(end)) for end in (low, high)]
    if ends[0][0] < 0 < ends[1][0]:
        age, moved = min(max(origin, low), high), math.inf
        for _ in range(_NEWTON_STEPS):
            F, F_dot = _slope(R, *at(age))
            low, high = (age, high) if F < 0 else (low, age)
            following = age - F / F_dot if F_dot > 0 else math.inf
            if not low <= following <= high:
                following = (low + high) / 2
            last, moved, age = moved, abs(following - age), following
            # rounding of F ends the descent: steps no longer shrink
            if moved <= 4 * math.ulp(curve.step) or _SETTLED * curve.step > moved > last / 4:
                break
    else:  # no valley inside: the lower end of the bracket
        costs = [_solve(R, at(end)[0])[1] for end in (low, high)]
        age = (low, high)[int(np.argmin(costs))]
    b, b_dot, _ = at(age)
    g, cost = _solve(R, b)
    inner = limits[0] < age < limits[1]
    return Impulse(age, g, cost, float(R @ R) - cost, b, b_dot, inner)


def _solve(R: Array, b: Array) -> tuple[Array, float]:
    if b.shape[1] == 1:
        column = b[:, 0]
        size = float(column @ column)
        g = np.array([float(column @ R) / size if size > 0 else 0.0])
    else:
        g = np.linalg.lstsq(b, R, rcond=None)[0]
    rest = R - b @ g
    return g, float(rest @ rest)


def _slope(R: Array, b: Array, b_dot: Array, b_ddot: Array) -> tuple[float, float]:
    """(F, F'): half the derivative of the reduced cost by age, and its derivative."""
    if b.shape[1] == 1:  # the same in scalars, which is what most plants need
        b, b_dot, b_ddot = b[:, 0], b_dot[:, 0], b_ddot[:, 0]
        size = b @ b
        g: Any = (b @ R) / size
        rest, moved = R - b * g, b_dot * g
        g_dot = (b_dot @ rest - b @ moved) / size
        bent = b_ddot * g + b_dot * g_dot
        return -float(rest @ moved), float((moved + b * g_dot) @ moved - rest @ bent)
    g, _ = _solve(R, b)
    rest, moved = R - b @ g, b_dot @ g
    g_dot = np.linalg.solve(b.T @ b, b_dot.T @ rest - b.T @ moved)
    bent = b_ddot @ g + b_dot @ g_dot
    return -float(rest @ moved), float((moved + b @ g_dot) @ moved - rest @ bent)
