"""Gains of an interval observer in given coordinates: a program to start from, then descent.

Every entry of W and N is convex and piecewise linear in one row of a gain, with kinks where an
entry of A - L C or G - M C vanishes: descent along one gain entry at a time tries those kinks,
the limits, and steps around the current value.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lmi.time_budget import deadline, ended, ended_by_count, remark_end, scaled
from obsdesign.synthesis.interval.goals import growth, mean_width, shortest
from obsdesign.synthesis.interval.linear_program import clock_gains
from obsdesign.synthesis.interval.task import Task

Matrix = NDArray[np.float64]
Goal = Callable[[Task, Matrix, Matrix], float]

OBJECTIVES: dict[str, Goal] = {
    "feasible": growth,
    "shortest_dwell": shortest,
    "narrowest": mean_width,
}
_NODES = 16
_FEW_NODES = 6
_LARGE = 6  # with more states than that, half of them
_SWEEPS = 8
# evaluations of a goal in one descent, and in one inside a search over coordinates
_MOST, _FEW = 3000, 250
SECONDS = 3.0  # of processor time, for the gains in one system of coordinates
_SUFFICIENT_GROWTH = 0.9  # `feasible` stops at this growth from jump to jump
_LEAST_IMPROVEMENT = 1e-7  # relative improvement that is worth another sweep


def best_gains(
    task: Task, objective: str, end: float | None = None
) -> tuple[float, Matrix, Matrix]:
    """(value, L, M), gains in z; value as `OBJECTIVES` has it, inf where the goal is missed.

    end: processor time at which the best so far is returned (default: `SECONDS` from now).
    """
    goal = OBJECTIVES[objective]
    own_budget, end = end is None, deadline(SECONDS) if end is None else end
    if not (task.open_L or task.open_M):
        none = np.zeros(task.limit_L.shape)
        return goal(task, none, none), none, none
    starts = [*_starts(task, objective, end)]
    ranked = sorted(starts, key=lambda pair: _value(task, goal, *pair))
    best: tuple[float, Matrix, Matrix] = (math.inf, *ranked[0])
    for L, M in ranked[:2]:
        value, L, M = _descent(task, objective, (L, M), end)
        if value < best[0]:
            best = value, L, M
    unweighted = task.with_equal_weights()
    # descent is local: no wider than without weights
    if goal is mean_width and unweighted is not task:
        _, *start = best_gains(unweighted, objective, end)
        other = _descent(task, objective, start, end)
        best = min(best, other, key=lambda result: result[0])
    if math.isinf(best[0]) and goal is not growth:  # nothing to descend on: contract first
        _, *start = _descent(task, "feasible", ranked[0], end)
        best = _descent(task, objective, start, end)
    if own_budget:
        remark_end("gains", ended(end, SECONDS), matters=objective != "feasible")
    return _rounded(task, goal, *best)


def quick_gains(task: Task, objective: str, end: float = math.inf) -> tuple[float, Matrix, Matrix]:
    """The same with a small program and little descent: inside a search over coordinates."""
    goal = OBJECTIVES[objective]
    if not (task.open_L or task.open_M):
        return best_gains(task, objective)
    starts = [_clipped(task, *(np.zeros(task.limit_L.shape) for _ in range(2)))]
    low = 0.0 if task.G is None else task.low
    for L, M in clock_gains(task, low, _nodes(task, _FEW_NODES), objective == "narrowest") or ():
        starts.append(_clipped(task, L, M))
    _, L, M = min(
        ((_value(task, goal, *pair), *pair) for pair in starts), key=lambda start: start[0]
    )
    return _descent(task, objective, (L, M), end, most=_FEW)


def _starts(task: Task, objective: str, end: float) -> Iterator[tuple[Matrix, Matrix]]:
    shape = task.limit_L.shape
    yield _clipped(task, np.zeros(shape), np.zeros(shape))
    low = 0.0 if task.G is None else task.low
    if objective == "shortest_dwell" and task.G is not None:
        low = _shortest_program(task, end)
    constant = clock_gains(task, low, _nodes(task, _NODES), objective == "narrowest")
    for L, M in constant or ():
        yield _clipped(task, L, M)


def _shortest_program(task: Task, end: float) -> float:
    """About the shortest dwell time for which the program is feasible, as far as time lasts."""
    unit = 1.0 / max(float(np.abs(task.A).max()), 1e-12)
    high = task.high if math.isfinite(task.high) else unit
    while math.isinf(task.high) and clock_gains(task, high, _nodes(task, _NODES), False) is None:
        high *= 2
        if high > 1e3 * unit or time.process_time() > end:
            return task.low
    low = 0.0
    for _ in range(7):
        if time.process_time() > end:
            break
        middle = 0.5 * (low + high)
        if clock_gains(task, middle, _nodes(task, _NODES), False) is None:
            low = middle
        else:
            high = middle
    return high


def _nodes(task: Task, most: int) -> int:
    """Number of nodes of the program, whose size grows with nodes times n^2."""
    return most if len(task.A) <= _LARGE else most // 2


def _clipped(task: Task, L: Matrix, M: Matrix) -> tuple[Matrix, Matrix]:
    return (np.clip(L, -task.limit_L, task.limit_L), np.clip(M, -task.limit_M, task.limit_M))


def _value(task: Task, goal: Goal, L: Matrix, M: Matrix) -> float:
    return goal(task, L, M) if task.is_admissible(L, M) else math.inf


def _descent(
    task: Task, objective: str, start: Sequence[Matrix], end: float, most: int = _MOST
) -> tuple[float, Matrix, Matrix]:
    """Return (value, L, M): improve one entry at a time while it helps and time and effort last."""
    goal, (L, M) = OBJECTIVES[objective], start
    value = _value(task, goal, L, M)
    stride, spent, limit = 0.5, 0, scaled(most)
    for _ in range(_SWEEPS):
        before = value
        for which in ("L", "M"):
            if not (task.open_L if which == "L" else task.open_M):
                continue
            for index in np.ndindex(*L.shape):
                if objective == "feasible" and value < _SUFFICIENT_GROWTH:
                    return value, L, M
                for candidate in _candidates(
                    task, which, (L, M), index, stride=stride, to_limits=goal is mean_width
                ):
                    spent += 1
                    if time.process_time() > end:
                        return value, L, M
                    if spent > limit:
                        evidence = ended_by_count("evaluations", limit) if most == _MOST else {}
                        remark_end("gains", evidence, matters=goal is not growth)
                        return value, L, M
                    new = (candidate, M) if which == "L" else (L, candidate)
                    trial = _value(task, goal, *new)
                    if trial < value - _LEAST_IMPROVEMENT * abs(value) or (
                        math.isinf(value) and math.isfinite(trial)
                    ):
                        value, (L, M) = trial, new
        if not value < before - _LEAST_IMPROVEMENT * abs(before):
            stride *= 0.25
            if stride < 0.01:
                break
    return value, L, M


def _candidates(
    task: Task,
    which: str,
    gains: tuple[Matrix, Matrix],
    index: tuple[int, ...],
    *,
    stride: float,
    to_limits: bool,
) -> Iterator[Matrix]:
    """Yield L or M, as `which` names, with one entry changed."""
    i, k = index
    L, M = gains
    if which == "L":
        gain, X, C, limit = L, task.A - L @ task.C, task.C, task.limit_L[i, k]
    else:
        assert task.G is not None
        gain, X, C, limit = M, task.G - M @ task.C_jump, task.C_jump, task.limit_M[i, k]
    current = float(gain[i, k])
    with np.errstate(all="ignore"):
        kinks = current + X[i] / C[k]
    reach = stride * max(abs(current), float(np.abs(X[i]).max(initial=0.0)), 1e-3)
    values = [*kinks[np.isfinite(kinks)].tolist(), 0.0, current + reach, current - reach]
    if to_limits and math.isfinite(limit):
        values += [limit, -limit]
    for value in values:
        if value != current and abs(value) <= limit:
            changed = gain.copy()
            changed[i, k] = value
            yield changed


def _rounded(
    task: Task, goal: Goal, value: float, L: Matrix, M: Matrix
) -> tuple[float, Matrix, Matrix]:
    """Return gains in few digits where they cost nothing: easier to read, and to copy by hand."""
    for digits in (3, 6, 9):
        short_L, short_M = _clipped(task, _digits(L, digits), _digits(M, digits))
        short_value = _value(task, goal, short_L, short_M)
        if short_value <= value + 1e-6 * abs(value):
            return short_value, short_L, short_M
    return value, L, M


def _digits(X: Matrix, digits: int) -> Matrix:
    text = [float(f"{x:.{digits}g}") for x in X.ravel()]
    return np.array(text).reshape(X.shape)
