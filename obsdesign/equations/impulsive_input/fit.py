"""Step 2 of Mattsson and Medvedev: time and weight of one impulse from its features.

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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.curve import ImpulseCurve, power_sum

_NEWTON_STEPS = 60
_CONVERGED_STEP = 1e-6  # of a cell of the grid: Newton steps this small converge quadratically
_LEAST_MAXIMUM_SHARE = 0.9  # of the highest: lower grid maxima cannot win by refining
_CANDIDATES = 3  # grid minima that are refined: the lowest may lie beside its neighbour's valley


@dataclass(frozen=True)
class Impulse:
    """A fitted impulse: age at the end of the window, weights (q,), what it leaves and explains.

    b, b_dot: weighted features (r, q) and their derivative by age, of the impulse of weight 1;
    cost = |R - b g|^2; gain = |R|^2 - cost; inside: the minimum lies inside the range searched.
    """

    age: float
    weights: Matrix
    cost: float
    gain: float
    b: Matrix
    b_dot: Matrix
    inside: bool


def fit_impulse(
    R: Matrix,
    curve: ImpulseCurve,
    low: float,
    high: float,
    *,
    weighting: Matrix | None = None,
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
        age = float(ages[inside[k]])
        ends = (max(low, age - curve.step), min(high, age + curve.step))
        candidate = _refine(
            R, curve, int(inside[k]), bracket=ends, limits=(low, high), weighting=weighting
        )
        if nonnegative and (candidate.weights < 0).any():
            continue
        if best is None or candidate.cost < best.cost:
            best = candidate
    return best


def _weighted(b: Matrix, weighting: Matrix | None) -> Matrix:
    return b if weighting is None else weighting @ b


def explained(b: Matrix, R: Matrix, nonnegative: bool) -> Matrix:
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


def peaks(gains: Matrix) -> list[int]:
    """The highest local maxima, highest first."""
    padded = np.concatenate([[-math.inf], gains, [-math.inf]])
    tops = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    tops = tops[gains[tops] >= _LEAST_MAXIMUM_SHARE * gains.max(initial=0.0)]
    return [int(k) for k in tops[np.argsort(-gains[tops])][:_CANDIDATES]]


def _refine(
    R: Matrix,
    curve: ImpulseCurve,
    k: int,
    *,
    bracket: tuple[float, float],
    limits: tuple[float, float],
    weighting: Matrix | None,
) -> Impulse:
    """Newton on F inside the bracket around grid point k; bisection where it would leave it."""
    n, origin = curve.n, k * curve.step
    series = curve.series(k)
    F_series = curve.F[n:]

    def derivatives(age: float) -> tuple[Matrix, Matrix, Matrix]:
        whole = power_sum(series, age - origin)
        first = F_series @ whole
        second = F_series @ (curve.F @ whole)
        return (_weighted(whole[n:], weighting), _weighted(first, weighting),
                _weighted(second, weighting))  # fmt: skip

    low, high = bracket
    ends = [_slope(R, *derivatives(end)) for end in (low, high)]
    if ends[0][0] < 0 < ends[1][0]:
        start = min(max(origin, low), high)
        age = _root(lambda age: _slope(R, *derivatives(age)), start, bracket, curve.step)
    else:  # no valley inside: the lower end of the bracket
        costs = [_solve(R, derivatives(end)[0])[1] for end in (low, high)]
        age = (low, high)[int(np.argmin(costs))]
    b, b_dot, _ = derivatives(age)
    g, cost = _solve(R, b)
    inner = limits[0] < age < limits[1]
    return Impulse(
        age=age, weights=g, cost=cost, gain=float(R @ R) - cost, b=b, b_dot=b_dot, inside=inner
    )


def _root(
    slope: Callable[[float], tuple[float, float]],
    age: float,
    bracket: tuple[float, float],
    cell: float,
) -> float:
    """Age in the bracket where F changes its sign, by Newton and bisection from `age`.

    slope: (F, F') at an age; cell: length of a cell of the grid.
    """
    (low, high), change = bracket, math.inf
    for _ in range(_NEWTON_STEPS):
        F, F_dot = slope(age)
        low, high = (age, high) if F < 0 else (low, age)
        following = age - F / F_dot if F_dot > 0 else math.inf
        if not low <= following <= high:
            following = (low + high) / 2
        last, change, age = change, abs(following - age), following
        # rounding of F ends the descent: steps no longer shrink
        if change <= 4 * math.ulp(cell) or _CONVERGED_STEP * cell > change > last / 4:
            break
    return age


def _solve(R: Matrix, b: Matrix) -> tuple[Matrix, float]:
    if b.shape[1] == 1:
        column = b[:, 0]
        size = float(column @ column)
        g = np.array([float(column @ R) / size if size > 0 else 0.0])
    else:
        g = np.linalg.lstsq(b, R, rcond=None)[0]
    residual = R - b @ g
    return g, float(residual @ residual)


def _slope(R: Matrix, b: Matrix, b_dot: Matrix, b_ddot: Matrix) -> tuple[float, float]:
    """(F, F'): half the derivative of the reduced cost by age, and its derivative."""
    if b.shape[1] == 1:  # the same in scalars, which is what most plants need
        b, b_dot, b_ddot = b[:, 0], b_dot[:, 0], b_ddot[:, 0]
        size = b @ b
        weight = (b @ R) / size
        residual, rate = R - b * weight, b_dot * weight
        drift = (b_dot @ residual - b @ rate) / size
        curvature = b_ddot * weight + b_dot * drift
        return -float(residual @ rate), float((rate + b * drift) @ rate - residual @ curvature)
    g, _ = _solve(R, b)
    residual, rate = R - b @ g, b_dot @ g
    g_dot = np.linalg.solve(b.T @ b, b_dot.T @ residual - b.T @ rate)
    curvature = b_ddot @ g + b_dot @ g_dot
    return -float(residual @ rate), float((rate + b @ g_dot) @ rate - residual @ curvature)


def left_inverse(J: Matrix) -> Matrix:
    """J^+, its columns first in units of their own: an age and a weight may be of any two sizes."""
    sizes = np.linalg.norm(J, axis=0)
    sizes[sizes == 0] = 1.0
    return np.asarray(np.linalg.pinv(J / sizes) / sizes[:, None])
