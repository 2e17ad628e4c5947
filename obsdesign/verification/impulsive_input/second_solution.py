"""A second answer to (17), with a proof: two ages at which impulses leave parallel features.

b(s1) and b(s2) in R^r are parallel where r - 1 minors vanish. Two features: one equation, solved by
a change of sign along s2 for a given s1. Three features: two equations in two ages, whose zero is
certain where Krawczyk's operator maps a box of ages into its inside. With more features a second
answer is an accident that no box can prove; then nothing is found here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lmi.arithmetic.balls import around_zero, ball, exp_around, exp_times, number, to_float
from lmi.arithmetic.exponential import expm
from lmi.prove import exponential_sign as signs
from lmi.verdict import Verdict, refuted

_STARTS = 12  # of Newton's method, for three features
_STEPS = 30
_APART = 1e-3  # of the window: ages closer than this are one
_RADII = (1e-8, 1e-10, 1e-6)  # of the window: boxes of ages that are tried


def second_solution(
    F: Any, z: Any, n: int, b: Any, window: float, margin: float, nonnegative: bool = False
) -> Verdict | None:
    """Refuted, or None. F, z: exact, [v; b](s) = e^{F s} z, v (n,); b (k, r): on a grid, floats.

    nonnegative: weights of opposite sign are no second answer.
    """
    if b.shape[1] == 2:
        return _crossing_anywhere(F, z, n, b, window, margin, nonnegative)
    if b.shape[1] == 3:
        for ages in _meetings(F, z, n, b, window, margin):
            found = _certain_meeting(F, z, n, ages, (margin, window), nonnegative)
            if found is not None:
                return found
    return None


# --- two features ---------------------------------------------------------------------------------


def _crossing_anywhere(
    F: Any, z: Any, n: int, b: Any, window: float, margin: float, nonnegative: bool
) -> Verdict | None:
    """Two features: ages s1 < s2 with b(s1), b(s2) parallel, between two certain signs."""
    ages = np.linspace(margin, window, len(b))
    for k in range(0, len(b) - 8, 4):
        cross = b[k, 0] * b[:, 1] - b[k, 1] * b[:, 0]
        far = np.arange(k + 4, len(b) - 1)
        changes = far[cross[far] * cross[far + 1] < 0]
        if nonnegative:
            changes = changes[b[changes] @ b[k] > 0]
        for j in changes[:1]:
            brackets = float(ages[k]), float(ages[j]), float(ages[j + 1])
            found = _crossing(F, z, n, *brackets, nonnegative)
            if found is not None:
                return found
    return None


def _crossing(
    F: Any, z: Any, n: int, s1: float, low: float, high: float, nonnegative: bool
) -> Verdict | None:
    first = signs.value(F, z, s1)[n:]

    def cross(s: float) -> Any:
        there = signs.value(F, z, s)[n:]
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
    there = signs.value(F, z, high)[n:]
    index = 0 if abs(float(there[0].mid())) > abs(float(there[1].mid())) else 1
    slope = number(high - low)
    if not (there[index] > slope or there[index] < -slope):
        return None
    if nonnegative and not first[index] / there[index] > 0:
        return None
    weight = float((first[index] / there[index]).mid())
    reason = (
        f"an impulse of age {s1:.9g} and weight 1 and one of age {high:.9g} and weight "
        f"{weight:.9g} leave the same two features; give more exponents"
    )
    return refuted({"ages": [s1, [low, high]], "weights": [1.0, weight], "reason": reason})


# --- three features -------------------------------------------------------------------------------


def _meetings(
    F: Any, z: Any, n: int, b: Any, window: float, margin: float
) -> Iterator[tuple[float, float]]:
    """Pairs of ages with parallel features: Newton's method in floats from the best of a grid."""
    F_float, start = to_float(F), to_float(z)[:, 0]
    ages, size = np.linspace(margin, window, len(b)), np.linalg.norm(b, axis=1)
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
            values, slopes = _minors(*(_followed(F_float, start, n, s) for s in pair))
            try:
                move = np.linalg.solve(slopes, values)
            except np.linalg.LinAlgError:
                break
            pair = pair - move
            if not (margin <= pair.min() and pair.max() <= window):
                break
            if np.abs(move).max() < 1e-13 * window:
                break
        else:
            continue
        inside = margin < pair.min() and pair.max() < window
        if inside and abs(pair[1] - pair[0]) > _APART * window:
            yield float(pair.min()), float(pair.max())


def _followed(F: Any, start: Any, n: int, age: float) -> tuple[Any, Any]:
    """b and its rate at an age, floats."""
    at = expm(F * age) @ start
    return at[n:], (F @ at)[n:]


def _minors(first: tuple[Any, Any], second: tuple[Any, Any]) -> tuple[Any, Any]:
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


def _largest(values: Any) -> int:
    return int(np.argmax([abs(float(value)) for value in values]))


def _certain_meeting(
    F: Any, z: Any, n: int, ages: tuple[float, float], limits: tuple[float, float],
    nonnegative: bool,
) -> Verdict | None:  # fmt: skip
    """Krawczyk: m - Y f(m) + (1 - Y f'(X)) (X - m) lies inside X, so that X holds a zero."""
    rates = ball(F)
    there = []
    for age in ages:
        at = exp_times(F, age) * ball(z)
        there.append((_entries(at, n), _entries(rates * at, n)))
    values, slopes = _minors(*there)
    back = np.linalg.inv(np.array([[float(x.mid()) for x in row] for row in slopes]))
    for part in _RADII:
        radius = part * limits[1]
        if min(ages) - radius < limits[0] or max(ages) + radius > limits[1]:
            continue
        around = exp_around(F, radius)
        boxes = []
        for age in ages:
            at = around * (exp_times(F, age) * ball(z))
            boxes.append((_entries(at, n), _entries(rates * at, n)))
        if _largest(boxes[0][0]) != _largest(there[0][0]):
            continue
        spread = _minors(*boxes)[1]
        if all(_stays(back[i], values, spread, i, radius) for i in range(2)):
            return _witness(boxes, ages, radius, nonnegative)
    return None


def _stays(row: Any, values: Any, slopes: Any, i: int, radius: float) -> bool:
    """One coordinate of Krawczyk's operator stays inside the box."""
    r, Y = number(radius), [number(float(y)) for y in row]
    moved = -(Y[0] * values[0] + Y[1] * values[1])
    for j in range(2):
        rest = Y[0] * slopes[0][j] + Y[1] * slopes[1][j]
        rest = number(float(i == j)) - rest
        moved = moved + rest * around_zero(r)
    return bool(abs(moved) < r)


def _witness(
    boxes: Any, ages: tuple[float, float], radius: float, nonnegative: bool
) -> Verdict | None:
    b1, b2 = boxes[0][0], boxes[1][0]
    k = _largest(b1)
    if not (b1[k] > 0 or b1[k] < 0) or not (b2[k] > 0 or b2[k] < 0):
        return None
    if nonnegative and not b1[k] / b2[k] > 0:
        return None
    weight = float((b1[k] / b2[k]).mid())
    reason = (
        f"an impulse of age {ages[0]:.9g} and weight 1 and one of age {ages[1]:.9g} and weight "
        f"{weight:.9g} leave the same three features; give more exponents"
    )
    brackets = [[age - radius, age + radius] for age in ages]
    return refuted({"ages": brackets, "weights": [1.0, weight], "reason": reason})


def _entries(column: Any, n: int) -> list[Any]:
    return [row[0] for row in column.tolist()][n:]
