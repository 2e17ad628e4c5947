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

from obsdesign.equations.impulsive_input.curve import ImpulseCurve, power_sum

Array = NDArray[Any]

_NEWTON_STEPS = 60
_SETTLED = 1e-6  # of a cell of the grid: Newton steps this small converge quadratically
_CLOSE = 0.9  # of the highest: lower grid maxima cannot win by refining
_CANDIDATES = 3  # grid minima that are refined: the lowest may lie beside its neighbour's valley


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
        age = float(ages[inside[k]])
        ends = (max(low, age - curve.step), min(high, age + curve.step))
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
    R: Array, curve: ImpulseCurve, k: int, bracket: tuple[float, float],
    limits: tuple[float, float], weighting: Array | None,
) -> Impulse:  # fmt: skip
    """Newton on F inside the bracket around grid point k; bisection where it would leave it."""
    n, origin = curve.n, k * curve.step
    series = curve.series(k)
    b_series = _weighted(series[:, n:], weighting)
    F_series = curve.F[n:]

    def at(age: float) -> tuple[Array, Array, Array]:
        whole = power_sum(series, age - origin)
        first = F_series @ whole
        second = F_series @ (curve.F @ whole)
        return (power_sum(b_series, age - origin), _weighted(first, weighting),
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


def left_inverse(J: Array) -> Array:
    """J^+, its columns first in units of their own: an age and a weight may be of any two sizes."""
    sizes = np.linalg.norm(J, axis=0)
    sizes[sizes == 0] = 1.0
    return np.asarray(np.linalg.pinv(J / sizes) / sizes[:, None])
