"""A second answer to (17), with a proof: two ages at which impulses leave parallel features.

b(s1) and b(s2) in R^r are parallel where r - 1 minors vanish. Two features: one equation, solved by
a change of sign along s2 for a given s1. Three features: two equations in two ages, whose zero is
certain where Krawczyk's operator maps a box of ages into its inside. With more features a second
answer is an accident that no box can prove; then nothing is found here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    around_zero,
    ball,
    exp_around,
    exp_times,
    number,
    to_float,
)
from lmi.prove import exponential_sign as signs
from lmi.verdict import Verdict, refuted
from obsdesign.equations.impulsive_input.features import feature_flows
from obsdesign.verification.impulsive_input.witnesses import Age, EqualFeatures

_STARTS = 12  # of Newton's method, for three features
_STEPS = 30
_LEAST_AGE_DIFFERENCE = 1e-3  # of the window: ages closer than this are one
_RADII = (1e-8, 1e-10, 1e-6)  # of the window: boxes of ages that are tried

# features at one age, and their rates
_Pair = tuple[list[Ball], list[Ball]]
_FloatPair = tuple[Matrix, Matrix]


@dataclass(frozen=True, kw_only=True)
class FeatureCurve:
    """Features b(s) of an impulse of weight 1 by its age s in [margin, tau].

    F, z: exact, [v; b](s) = e^{F s} z, v (n,); b (k, r): on a grid of ages, floats; nonnegative:
    weights of opposite sign are no second answer.
    """

    F: Exact
    z: Exact
    n: int
    b: Matrix
    margin: float
    tau: float
    nonnegative: bool = False

    def value(self, age: float) -> list[Ball]:
        """Balls of b at an age, (r,)."""
        return signs.value(self.F, self.z, age)[self.n :]

    def enclosure(self, age: float, around: Balls | None = None) -> _Pair:
        """Balls of b and its rate at an age, or on e^{F u} of `around` it."""
        state = exp_times(self.F, age) * ball(self.z)
        state = state if around is None else around * state
        return _entries(state, self.n), _entries(ball(self.F) * state, self.n)


def second_solution(curve: FeatureCurve) -> Verdict | None:
    """Refuted with two ages whose features are parallel, or None."""
    if curve.b.shape[1] == 2:
        return _crossing_anywhere(curve)
    if curve.b.shape[1] == 3:
        for ages in _meetings(curve):
            verdict = _certain_meeting(curve, ages)
            if verdict is not None:
                return verdict
    return None


# --- two features ---------------------------------------------------------------------------------


def _crossing_anywhere(curve: FeatureCurve) -> Verdict | None:
    """Two features: ages s1 < s2 with b(s1), b(s2) parallel, between two certain signs."""
    b = curve.b
    ages = np.linspace(curve.margin, curve.tau, len(b))
    for k in range(0, len(b) - 8, 4):
        cross = b[k, 0] * b[:, 1] - b[k, 1] * b[:, 0]
        far = np.arange(k + 4, len(b) - 1)
        changes = far[cross[far] * cross[far + 1] < 0]
        if curve.nonnegative:
            changes = changes[b[changes] @ b[k] > 0]
        for j in changes[:1]:
            verdict = _crossing(curve, float(ages[k]), float(ages[j]), float(ages[j + 1]))
            if verdict is not None:
                return verdict
    return None


def _crossing(curve: FeatureCurve, s1: float, low: float, high: float) -> Verdict | None:
    """Refuted where b(s1) is certainly parallel to b at an age in [low, high]; else None."""
    first = curve.value(s1)

    def cross(s: float) -> Ball:
        there = curve.value(s)
        return first[0] * there[1] - first[1] * there[0]

    ends = cross(low), cross(high)
    if not ((ends[0] < 0 and ends[1] > 0) or (ends[0] > 0 and ends[1] < 0)):
        return None
    rising = bool(ends[0] < 0)
    for _ in range(45):
        middle = (low + high) / 2
        at = cross(middle)
        if not (at < 0 or at > 0):
            break
        if bool(at < 0) == rising:
            low = middle
        else:
            high = middle
    there = curve.value(high)
    index = 0 if abs(float(there[0].mid())) > abs(float(there[1].mid())) else 1
    slope = number(high - low)
    if not (there[index] > slope or there[index] < -slope):
        return None
    return _same_features(
        curve, (first[index], there[index]), (s1, high), brackets=[s1, [low, high]]
    )


# --- three features -------------------------------------------------------------------------------


def _meetings(curve: FeatureCurve) -> Iterator[tuple[float, float]]:
    """Pairs of ages with parallel features: Newton's method in floats from the best of a grid."""
    F, start, b = to_float(curve.F), to_float(curve.z)[:, 0], curve.b
    margin, tau = curve.margin, curve.tau
    ages, size = np.linspace(margin, tau, len(b)), np.linalg.norm(b, axis=1)
    unit = b / np.where(size > 0, size, 1.0)[:, None]
    # the sine of the angle, over the way between: near the diagonal it does not vanish
    apart = np.abs(ages[:, None] - ages[None, :]) + np.eye(len(ages))
    sine = np.sqrt(np.maximum(1 - (unit @ unit.T) ** 2, 0.0)) / apart
    inner = sine[1:-1, 1:-1]
    lowest = np.ones_like(inner, dtype=bool)
    for i, j in ((0, 1), (1, 0), (1, 2), (2, 1)):
        lowest &= inner <= sine[i : i + len(inner), j : j + len(inner)]
    rows, columns = np.nonzero(np.triu(lowest, 2))
    order = np.argsort(inner[rows, columns])[:_STARTS]
    for k in order:
        pair = np.array([ages[rows[k] + 1], ages[columns[k] + 1]])
        for _ in range(_STEPS):
            values, slopes = _minors(*(_followed(F, start, curve.n, s) for s in pair))
            try:
                move = np.linalg.solve(slopes, values)
            except np.linalg.LinAlgError:
                break
            pair = pair - move
            if not (margin <= pair.min() and pair.max() <= tau):
                break
            if np.abs(move).max() < 1e-13 * tau:
                break
        else:
            continue
        inside = margin < pair.min() and pair.max() < tau
        if inside and abs(pair[1] - pair[0]) > _LEAST_AGE_DIFFERENCE * tau:
            yield float(pair.min()), float(pair.max())


def _followed(F: Matrix, start: Matrix, n: int, age: float) -> tuple[Matrix, Matrix]:
    """b and its rate at an age, floats."""
    at = feature_flows(F, n, age, 0.0, 1)[0] @ start[:n]
    return at[n:], (F @ at)[n:]


def _minors(first: _Pair | _FloatPair, second: _Pair | _FloatPair) -> tuple[Array, Array]:
    """b_k(s1) b_i(s2) - b_i(s1) b_k(s2), i != k, and their rates in (s1, s2); floats or balls.

    k: where b(s1) is largest, so that it is not zero.
    """
    (b1, rate1), (b2, rate2) = first, second
    k = _largest(b1)
    others = [i for i in range(3) if i != k]
    values = [b1[k] * b2[i] - b1[i] * b2[k] for i in others]
    slopes = [
        [rate1[k] * b2[i] - rate1[i] * b2[k], b1[k] * rate2[i] - b1[i] * rate2[k]] for i in others
    ]
    return np.array(values), np.array(slopes)


def _largest(values: Iterable[Ball] | Matrix) -> int:
    return int(np.argmax([abs(float(value)) for value in values]))


def _certain_meeting(curve: FeatureCurve, ages: tuple[float, float]) -> Verdict | None:
    """Krawczyk: m - Y f(m) + (1 - Y f'(X)) (X - m) lies inside X, so that X holds a zero."""
    there = [curve.enclosure(age) for age in ages]
    values, slopes = _minors(*there)
    back = np.linalg.inv(np.array([[float(x.mid()) for x in row] for row in slopes]))
    for part in _RADII:
        radius = part * curve.tau
        if min(ages) - radius < curve.margin or max(ages) + radius > curve.tau:
            continue
        around = exp_around(curve.F, radius)
        boxes = [curve.enclosure(age, around) for age in ages]
        if _largest(boxes[0][0]) != _largest(there[0][0]):
            continue
        spread = _minors(*boxes)[1]
        if all(_stays(back[i], values, spread, i, radius) for i in range(2)):
            return _witness(curve, (boxes[0][0], boxes[1][0]), ages, radius)
    return None


def _stays(row: Matrix, values: Array, slopes: Array, i: int, radius: float) -> bool:
    """One coordinate of Krawczyk's operator stays inside the box."""
    r, Y = number(radius), [number(float(y)) for y in row]
    image = -(Y[0] * values[0] + Y[1] * values[1])
    for j in range(2):
        entry = Y[0] * slopes[0][j] + Y[1] * slopes[1][j]
        entry = number(float(i == j)) - entry
        image = image + entry * around_zero(r)
    return bool(abs(image) < r)


def _witness(
    curve: FeatureCurve, b: _Pair, ages: tuple[float, float], radius: float
) -> Verdict | None:
    k = _largest(b[0])
    if not all(each[k] > 0 or each[k] < 0 for each in b):
        return None
    brackets = [[age - radius, age + radius] for age in ages]
    return _same_features(curve, (b[0][k], b[1][k]), ages, brackets)


def _same_features(
    curve: FeatureCurve,
    entries: tuple[Ball, Ball],
    ages: tuple[float, float],
    brackets: Sequence[Age],
) -> Verdict | None:
    """Refuted by impulses of these ages; None where the second weight is not allowed.

    entries: one of the parallel features of both, not zero.
    """
    ratio = entries[0] / entries[1]
    if curve.nonnegative and not ratio > 0:
        return None
    weight, count = float(ratio.mid()), "two" if curve.b.shape[1] == 2 else "three"
    reason = (
        f"an impulse of age {ages[0]:.9g} and weight 1 and one of age {ages[1]:.9g} and weight "
        f"{weight:.9g} leave the same {count} features; give more exponents"
    )
    return refuted(EqualFeatures(brackets, [1.0, weight], reason).to_dict())


def _entries(column: Balls, n: int) -> list[Ball]:
    return [row[0] for row in column.tolist()][n:]
