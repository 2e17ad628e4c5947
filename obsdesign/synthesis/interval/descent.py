"""Gains of an interval observer in given coordinates: a program to start from, then descent.

Every entry of W and N is convex and piecewise linear in one row of a gain, with kinks where an
entry of A - L C or G - M C vanishes: descent along one gain entry at a time tries those kinks,
the limits, and steps around the current value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget, ended_by_count, remark_end
from obsdesign.synthesis.interval.goals import growth, mean_width, shortest
from obsdesign.synthesis.interval.linear_program import clock_gains
from obsdesign.synthesis.interval.task import Task

Goal = Callable[[Task, Matrix, Matrix], float]
Gains = tuple[float, Matrix, Matrix]  # value of the objective, L, M

OBJECTIVES: dict[str, Goal] = {
    "feasible": growth,
    "shortest_dwell": shortest,
    "narrowest": mean_width,
}
_NODES = 16
_FEW_NODES = 6
_LARGE = 6  # with more states than that, half of them
_SWEEPS = 8
# evaluations of a goal in one descent, fewer with many states, as each then takes longer; and in
# one inside a search over coordinates
_MOST, _MOST_BY_STATES, _FEW = 3000, 12_000, 250
# programs for the shortest dwell time, times n^3, and how often it is doubled or halved at most
_PROGRAM_WORK, _HALVINGS = 17_000, 7
_SUFFICIENT_GROWTH = 0.9  # `feasible` stops at this growth from jump to jump
# decimals of gains, tried in turn; the last restores zeros of A - L C where A is in decimals
_DIGITS = (3, 6, 9, 15)
_LEAST_IMPROVEMENT = 1e-7  # relative improvement that is worth another sweep


def solvers_of_gains(task: Task) -> Solvers:
    """Solvers that `best_gains` and `quick_gains` call: the program of `clock_gains`."""
    if not (task.open_L or task.open_M):
        return ()
    return ("CVXPY/Clarabel",) if task.is_constrained else ("HiGHS",)


def best_gains(task: Task, objective: str, budget: TimeBudget) -> tuple[Gains, tuple[Remark, ...]]:
    """Gains in z, the best when limits or the budget end the search, and its remarks.

    The value is as `OBJECTIVES` has it, inf where the goal is missed. A user's constraints are
    those of the program, and what it gives is not improved: inf where it gives nothing.
    """
    goal = OBJECTIVES[objective]
    if not solvers_of_gains(task):
        return _without_open_gains(task, goal), ()
    low = 0.0 if task.G is None else task.low
    if objective == "shortest_dwell" and task.G is not None:
        low = _shortest_program(task, budget)
    ranked = _ranked(task, goal, _starts(task, low, _NODES, objective, budget))
    if task.is_constrained_by_user:
        return ranked[0], ()
    best: Gains = (math.inf, *ranked[0][1:])
    remarks: tuple[Remark, ...] = ()
    for _, *start in ranked[:2]:
        result, more = _descent(task, objective, start, budget)
        best, remarks = min(best, result, key=_first), remarks + more
    unweighted = task.with_equal_weights()
    # descent is local: no wider than without weights
    if goal is mean_width and unweighted is not task:
        (_, *start), before = best_gains(unweighted, objective, budget)
        result, more = _descent(task, objective, start, budget)
        best, remarks = min(best, result, key=_first), remarks + before + more
    if math.isinf(best[0]) and goal is not growth:  # nothing to descend on: contract first
        (_, *start), before = _descent(task, "feasible", ranked[0][1:], budget)
        best, more = _descent(task, objective, start, budget)
        remarks += before + more
    remarks += remark_end("gains", budget.ended(), matters=objective != "feasible")
    return _rounded(task, goal, *best), remarks


def _first(gains: Gains) -> float:
    return gains[0]


def _without_open_gains(task: Task, goal: Goal) -> Gains:
    none = np.zeros(task.limit_L.shape)
    return goal(task, none, none), none, none


def quick_gains(task: Task, objective: str, budget: TimeBudget) -> Gains:
    """Gains by a small program and little descent: inside a search over coordinates."""
    goal = OBJECTIVES[objective]
    if not solvers_of_gains(task):
        return _without_open_gains(task, goal)
    low = 0.0 if task.G is None else task.low
    ranked = _ranked(task, goal, _starts(task, low, _FEW_NODES, objective, budget))
    if task.is_constrained_by_user:
        return ranked[0]
    return _descent(task, objective, ranked[0][1:], budget, is_quick=True)[0]


def _ranked(task: Task, goal: Goal, starts: Iterator[tuple[Matrix, Matrix]]) -> list[Gains]:
    """The starts, the best first; without one zero gains of value inf."""
    none = np.zeros(task.limit_L.shape)
    ranked = sorted(((_value(task, goal, *pair), *pair) for pair in starts), key=_first)
    return ranked or [(math.inf, none, none)]


def _starts(
    task: Task, low: float, nodes: int, objective: str, budget: TimeBudget
) -> Iterator[tuple[Matrix, Matrix]]:
    """Yield zero gains and those of the program; of a user's constraints those that meet them."""
    shape = task.limit_L.shape
    constant = clock_gains(task, low, _nodes(task, nodes), objective == "narrowest", budget) or ()
    if task.is_constrained_by_user:
        yield from (task.within(*pair) for pair in constant[:1])
        return
    yield task.within(np.zeros(shape), np.zeros(shape))
    for L, M in constant:
        yield task.within(L, M)


def _shortest_program(task: Task, budget: TimeBudget) -> float:
    """About the shortest dwell time for which the program is feasible, as far as budgets last."""
    left = max(budget.scaled(_PROGRAM_WORK) // len(task.A) ** 3, 1)

    def is_feasible(low: float) -> bool:
        nonlocal left
        left -= 1
        return clock_gains(task, low, _nodes(task, _NODES), False, budget) is not None

    unit = 1.0 / max(float(np.abs(task.A).max()), 1e-12)
    high = task.high if math.isfinite(task.high) else unit
    while math.isinf(task.high) and not is_feasible(high):
        high *= 2
        if high > 1e3 * unit or left <= 0 or budget.remaining() < 0:
            return task.low
    low = 0.0
    for _ in range(_HALVINGS):
        if left <= 0 or budget.remaining() < 0:
            break
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_feasible(middle) else (middle, high)
    return high


def _nodes(task: Task, most: int) -> int:
    """Number of nodes of the program, whose size grows with nodes times n^2."""
    return most if len(task.A) <= _LARGE else most // 2


def _value(task: Task, goal: Goal, L: Matrix, M: Matrix) -> float:
    return goal(task, L, M) if task.is_admissible(L, M) else math.inf


def _descent(
    task: Task,
    objective: str,
    start: Sequence[Matrix],
    budget: TimeBudget,
    is_quick: bool = False,
) -> tuple[Gains, tuple[Remark, ...]]:
    """Improve one entry at a time while it helps and time and effort last."""
    goal, (L, M) = OBJECTIVES[objective], start
    value = _value(task, goal, L, M)
    most = _FEW if is_quick else min(_MOST, _MOST_BY_STATES // len(task.A))
    stride, spent, limit = 0.5, 0, budget.scaled(most)
    for _ in range(_SWEEPS):
        before = value
        for which in ("L", "M"):
            if not (task.open_L if which == "L" else task.open_M):
                continue
            for index in np.ndindex(*L.shape):
                if objective == "feasible" and value < _SUFFICIENT_GROWTH:
                    return (value, L, M), ()
                for candidate in _candidates(
                    task, which, (L, M), index, stride=stride, to_limits=goal is mean_width
                ):
                    spent += 1
                    if budget.remaining() < 0:
                        return (value, L, M), ()
                    if spent > limit:
                        evidence = {} if is_quick else ended_by_count("evaluations", limit)
                        remarks = remark_end("gains", evidence, matters=goal is not growth)
                        return (value, L, M), remarks
                    trial = _value(task, goal, *candidate)
                    if trial < value - _LEAST_IMPROVEMENT * abs(value) or (
                        math.isinf(value) and math.isfinite(trial)
                    ):
                        value, (L, M) = trial, candidate
        if not value < before - _LEAST_IMPROVEMENT * abs(before):
            stride *= 0.25
            if stride < 0.01:
                break
    return (value, L, M), ()


def _candidates(
    task: Task,
    which: str,
    gains: tuple[Matrix, Matrix],
    index: tuple[int, ...],
    *,
    stride: float,
    to_limits: bool,
) -> Iterator[tuple[Matrix, Matrix]]:
    """Yield (L, M) with one entry of L or M, as `which` names, changed."""
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
            pair = (changed, M) if which == "L" else (L, changed)
            yield task.within(*pair) if task.is_constrained else pair


def _rounded(task: Task, goal: Goal, value: float, L: Matrix, M: Matrix) -> Gains:
    """Return gains in few digits where they cost nothing: easier to read, and to copy by hand."""
    for digits in _DIGITS:
        short = task.inward(*(_digits(gain, digits) for gain in task.gains(L, M)))
        short_L, short_M = task.within(*short)
        short_value = _value(task, goal, short_L, short_M)
        if short_value <= value + 1e-6 * abs(value):
            return short_value, short_L, short_M
    return value, L, M


def _digits(X: Matrix, digits: int) -> Matrix:
    text = [float(f"{x:.{digits}g}") for x in X.ravel()]
    return np.array(text).reshape(X.shape)
