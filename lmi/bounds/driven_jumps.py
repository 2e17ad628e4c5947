"""Bounds of a driven system with jumps, for all sequences of dwell times; in balls.

    e' = F e + E d,   e+ = H e + K d,   |d| <= 1

Just before jumps |T e| comes to at most eta / (1 - gamma), where |T e^(F theta) H x| <= gamma |T x|
and eta bounds what d adds from jump to jump. From bounds |e-| <= r that hold just before jumps

    |e| <= |e^(F theta) H| r + |e^(F theta) K| 1 + int_0^theta |e^(Fs) E| 1 ds

follows for a time theta after one: at theta of the range for the next jump, hence again a bound
just before jumps, of which the smaller is kept. Long after a jump, where dwell times have no end or
a far one, the moduli of the flow's subspaces bound what is left.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    ball,
    entries,
    exact,
    inverse,
    precision,
    rational,
    scalar,
    to_float,
)
from lmi.arithmetic.norms import float_above, upper_balls
from lmi.bounds.flow_cells import Course
from lmi.prove.common_matrix import prove_common
from lmi.prove.hurwitz import rightmost
from lmi.time_budget import UNLIMITED, TimeBudget

_BITS = 160
# after so many times 1 / (decay rate of F) beyond the shortest dwell time nothing is followed
_FORGOTTEN = 12.0
_REPEATS = 50


@dataclass(frozen=True)
class DrivenJumps:
    """F, H (n, n), E (n, k), K (n, l), exact; dwell times in [low, high], high maybe infinite."""

    F: Exact
    E: Exact
    H: Exact
    K: Exact
    low: float
    high: float


@dataclass(frozen=True)
class Radius:
    """|T e| <= radius just before jumps; back (n, n) exact, T^-1."""

    back: Exact
    radius: Ball


@dataclass(frozen=True)
class _Stretch:
    """Bounds on a cell of times since a jump: |e^(F theta) H|, that times T^-1, what d adds."""

    can_jump: bool
    mapped: Exact
    normed: Exact
    added: Exact


def radius_before_jumps(
    system: DrivenJumps, T: Matrix, gamma: float, budget: TimeBudget = UNLIMITED
) -> Radius | None:
    """Ultimate bound of |T e| just before jumps; None where gamma is not proved.

    T (n, n) floats, gamma < 1; budget: ends the proof, of nothing then.
    """
    lifted = exact(T)
    back = inverse(lifted)
    if back is None or not 0 < gamma < 1:
        return None
    F, H = lifted @ system.F @ back, lifted @ system.H @ back
    unit = np.eye(len(T))
    contracts = prove_common(F, H, unit, system.low, system.high, gamma=gamma, budget=budget)
    if contracts.outcome != "proved":
        return None
    own = DrivenJumps(F, lifted @ system.E, H, lifted @ system.K, system.low, system.high)
    with precision(_BITS):
        steps = _steps(own, exact(unit))
        if steps is None:
            return None
        added = _largest([step.added for step in steps if step.can_jump])
        norm = sum((value * value for value in added), scalar(0)).sqrt()
        return Radius(back, (norm / (1 - scalar(rational(gamma)))).abs_upper())


def driven_bounds(
    system: DrivenJumps, before: Exact | None, around: Radius | None
) -> tuple[Matrix, Matrix] | None:
    """(before, always): bounds of |e| just before jumps, and at any time; (n,) floats.

    before (n,) exact, around: what is known just before jumps; None where nothing is.
    None where balls grow too wide, where nothing is known before jumps, and where decay is not
    proved and dwell times have no end.
    """
    if before is None and around is None:
        return None
    with precision(_BITS):
        back = 0 * system.F if around is None else around.back
        radius = None if around is None else around.radius
        steps = _steps(system, back)
        if steps is None:
            return None
        r = _first(before, back, radius)
        for _ in range(_REPEATS):
            last = _reached([step for step in steps if step.can_jump], r, radius)
            smaller = np.array([a.min(b) for a, b in zip(r, last, strict=True)])
            is_settled = all(new >= old * 0.9999 for new, old in zip(smaller, r, strict=True))
            r = smaller
            if is_settled:
                break
        before_jump, always = _floats(r), _floats(_reached(steps, r, radius))
    bounds = np.minimum(before_jump, always), always
    return bounds if np.isfinite(bounds).all() else None


def _first(before: Exact | None, back: Exact, radius: Ball | None) -> Exact:
    """The bounds just before jumps that are known at first."""
    box = None if before is None else [scalar(value).abs_upper() for value in before]
    if radius is None:
        return np.array(box)
    around = [(x * radius).abs_upper() for x in _row_norms(entries(ball(back)))]
    if box is None:
        return np.array(around)
    return np.array([a.min(b) for a, b in zip(box, around, strict=True)])


def _steps(system: DrivenJumps, back: Exact) -> list[_Stretch] | None:
    """Bounds on cells that cover the times from 0 to the longest dwell time.

    None where that is infinite, or far beyond all decay, and the flow is not proved to decay.
    """
    parts = (system.H, system.H @ back, system.K, system.E)
    low, end = system.low, _end(system.F, system.low, system.high)
    if math.isinf(end):
        return None
    ends = np.cumsum([0, *(part.shape[1] for part in parts)])
    slices = tuple(slice(a, b) for a, b in itertools.pairwise(ends) if b > a)
    course = Course.from_pair(system.F, np.hstack(parts), slices)
    first, start, last = rational(0.0), rational(low), rational(end)
    stretches = [(False, cell) for cell in course.cells(first, start)]
    stretches += [(True, course.instant(start))]
    stretches += [(True, cell) for cell in course.cells(start, last)]
    if end < system.high:
        later = course.later(last)
        if later is None:
            return None
        stretches.append((True, later))
    sums, steps = np.array([scalar(0)] * len(system.F)), list[_Stretch]()
    for can_jump, cell in stretches:
        mapped, normed, kicked, _ = np.hsplit(cell.largest, ends[1:-1])
        sums = upper_balls(sums + _row_sums(np.hsplit(cell.integral, ends[1:-1])[3]))
        steps.append(_Stretch(can_jump, mapped, normed, sums + _row_sums(kicked)))
    return steps


def _end(F: Exact, low: float, high: float) -> float:
    """Time since a jump up to which the flow is followed; infinite if it does not decay."""
    decay = -rightmost(to_float(F)).real
    return min(high, low + _FORGOTTEN / decay) if decay > 0 else high


def _reached(steps: Sequence[_Stretch], r: Exact, radius: Ball | None) -> Exact:
    """The largest |e| on these cells, from what is known before the jump."""
    values = []
    for step in steps:
        mapped = step.mapped @ r
        if radius is not None:
            pairs = zip(mapped, _row_norms(step.normed), strict=True)
            mapped = np.array([box.min((norm * radius).abs_upper()) for box, norm in pairs])
        values.append(mapped + step.added)
    return _largest(values)


def _row_norms(X: Exact) -> list[Ball]:
    return [sum((x * x for x in row), scalar(0)).abs_upper().sqrt() for row in X]


def _row_sums(X: Exact) -> Exact:
    return np.array([sum(row, scalar(0)) for row in X])


def _largest(values: Sequence[Exact]) -> Exact:
    """The largest of several vectors, entry by entry, from above."""
    result = upper_balls(values[0])
    for other in values[1:]:
        result = np.array([a.max(b) for a, b in zip(result, upper_balls(other), strict=True)])
    return result


def _floats(values: Exact) -> Matrix:
    return np.array([float_above(value) for value in values])
