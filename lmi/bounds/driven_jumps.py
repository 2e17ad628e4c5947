"""Bounds of a driven system with jumps, for all sequences of dwell times; in balls.

    e' = F e + E d,   e+ = H e + K d,   |d| <= 1

Just before jumps |T e| comes to at most eta / (1 - gamma), where |T e^(F theta) H x| <= gamma |T x|
and eta bounds what d adds from jump to jump. From bounds |e-| <= r that hold just before jumps

    |e| <= |e^(F theta) H| r + |e^(F theta) K| 1 + int_0^theta |e^(Fs) E| 1 ds

follows for a time theta after one: at theta of the range for the next jump, hence again a bound
just before jumps, of which the smaller is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    Rational,
    ball,
    entries,
    exact,
    exp_times,
    inverse,
    precision,
    rational,
    scalar,
    to_float,
)
from lmi.arithmetic.norms import float_above
from lmi.bounds.absolute_integral import cells
from lmi.prove.common_matrix import prove_common

_BITS = 160
# cells span this much of 1 / ||F||, unless there would be too many of them
_REACH, _FEWEST, _MOST = 2.0**-5, 64, 400
_REPEATS = 20


@dataclass(frozen=True)
class DrivenJumps:
    """F, H (n, n), E (n, k), K (n, l), exact; dwell times in [low, high], high finite."""

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
class _Step:
    """Bounds on a cell of times since a jump: |e^(F theta) H|, that times T^-1, what d adds."""

    is_last: bool
    mapped: Exact
    turned: Exact
    added: Exact


def radius_before_jumps(system: DrivenJumps, T: Matrix, gamma: float) -> Radius | None:
    """What |T e| comes to just before jumps; None where gamma is not proved.

    T (n, n) floats, gamma < 1.
    """
    lifted = exact(T)
    back = inverse(lifted)
    if back is None or not 0 < gamma < 1:
        return None
    F, H = lifted @ system.F @ back, lifted @ system.H @ back
    unit = np.eye(len(T))
    if prove_common(F, H, unit, system.low, system.high, gamma=gamma).outcome != "proved":
        return None
    own = DrivenJumps(F, lifted @ system.E, H, lifted @ system.K, system.low, system.high)
    with precision(_BITS):
        added = _largest([step.added for step in _steps(own, exact(unit)) if step.is_last])
        norm = sum((value * value for value in added), scalar(0)).sqrt()
        return Radius(back, (norm / (1 - scalar(rational(gamma)))).abs_upper())


def driven_bounds(
    system: DrivenJumps, before: Exact | None, around: Radius | None
) -> tuple[Matrix, Matrix] | None:
    """(before, always): bounds of |e| just before jumps, and at any time; (n,) floats.

    before (n,) exact, around: what is known just before jumps; None where nothing is.
    """
    if before is None and around is None:
        return None
    with precision(_BITS):
        back = 0 * system.F if around is None else around.back
        radius = None if around is None else around.radius
        steps = _steps(system, back)
        r = _first(before, back, radius)
        for _ in range(_REPEATS):
            last = _reached([step for step in steps if step.is_last], r, radius)
            smaller = np.array([min(pair) for pair in zip(r, last, strict=True)])
            is_settled = all(new > old * 0.9999 for new, old in zip(smaller, r, strict=True))
            r = smaller
            if is_settled:
                break
        always = _reached(steps, r, radius)
        return _floats(r), _floats(always)


def _first(before: Exact | None, back: Exact, radius: Ball | None) -> Exact:
    """The bounds just before jumps that are known at first."""
    boxes = []
    if before is not None:
        boxes.append([scalar(value).abs_upper() for value in before])
    if radius is not None:
        boxes.append([(x * radius).abs_upper() for x in _row_norms(entries(ball(back)))])
    return np.array([min(column) for column in zip(*boxes, strict=True)])


def _steps(system: DrivenJumps, back: Exact) -> list[_Step]:
    """Bounds on cells that cover the times from 0 to the longest dwell time."""
    n, F = len(system.F), system.F
    columns = np.hstack([system.H, system.H @ back, system.K, system.E])
    split = np.cumsum([n, n, system.K.shape[1]])
    sums, steps = np.array([scalar(0)] * n), list[_Step]()
    low, high = rational(system.low), rational(system.high)
    for start, end, is_last in ((rational(0.0), low, False), (low, high, True)):
        if end == start and not is_last:
            continue
        length, count = _lengths(F, end - start, high)
        for cell in cells(F, exp_times(F, start) * ball(columns), start, length, count):
            mapped, turned, kicked, _ = np.hsplit(cell.largest, split)
            sums = _uppers(sums + _row_sums(np.hsplit(cell.integral, split)[3]))
            steps.append(_Step(is_last, _uppers(mapped), _uppers(turned), sums + _row_sums(kicked)))
    return steps


def _lengths(F: Exact, span: Rational, whole: Rational) -> tuple[Rational, int]:
    """Length and number of cells of a part of the times."""
    size = float(np.abs(to_float(F)).sum(axis=1).max(initial=0.0))
    share = float(span / whole) if whole else 1.0
    most = max(1, round(share * _MOST))
    count = min(most, max(1, round(share * _FEWEST), round(float(span) * size / _REACH)))
    return span / count, count


def _reached(steps: Sequence[_Step], r: Exact, radius: Ball | None) -> Exact:
    """The largest |e| on these cells, from what is known before the jump."""
    values = []
    for step in steps:
        mapped = step.mapped @ r
        if radius is not None:
            pairs = zip(mapped, _row_norms(step.turned), strict=True)
            mapped = np.array([min(box, (norm * radius).abs_upper()) for box, norm in pairs])
        values.append(mapped + step.added)
    return _largest(values)


def _row_norms(X: Exact) -> list[Ball]:
    return [sum((x * x for x in row), scalar(0)).sqrt() for row in X]


def _row_sums(X: Exact) -> Exact:
    return np.array([sum(row, scalar(0)) for row in X])


def _largest(values: Sequence[Exact]) -> Exact:
    """The largest of several vectors, entry by entry, from above."""
    result = _uppers(values[0])
    for other in values[1:]:
        result = np.array([max(pair) for pair in zip(result, _uppers(other), strict=True)])
    return result


def _uppers(values: Exact) -> Exact:
    uppers = [value.abs_upper() for value in values.ravel()]
    return np.array(uppers, dtype=object).reshape(values.shape)


def _floats(values: Exact) -> Matrix:
    return np.array([float_above(value) for value in values])
