"""Bounds since a sample on the period or a jump, whatever rows came between.

What is claimed of the width is about samples a period apart and jumps between them:
r+ = |K e^{A h}| r + ..., K = I - L C, and r+ = |G e^{A s}| r + ... at jumps. Rows in between, off
the period or without a sample, make two steps of one, and |K e^{A (h - s)}| |e^{A s}| is at least
|K e^{A h}|, often more. So beside the box of such a row the
observer keeps the radius at the last sample on the period (or jump), and makes the whole step from
there as well: what both share is no wider than without the rows between. The centre goes from row
to row, as inputs may change there, and its rounding is bounded beside.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.enclosure import raised
from obsdesign.runtime.base import Vector
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.kernel import StepKernels
from obsdesign.runtime.interval.state import Course, IntervalState


def besides(
    kernels: StepKernels,
    clock: SampleClock,
    state: IntervalState,
    t: float,
    seen: Vector | None,
    off: bool,
) -> tuple[list[Vector], Course | None]:
    """Further boxes at t, the first of them that of the course, and the course unless it ends.

    seen: a measurement there; off: it is off the period.
    """
    if clock.period is None:
        return [], None
    ends = seen is not None and not off
    if ends and state.course is None:
        return [], None
    started = _course_of(state, t, clock.latest + 4 * math.ulp(t))
    course, box = _advanced(kernels, started, state, t, seen if ends else None)
    boxes = [box]
    if off and seen is not None:
        plain = kernels.at(t - state.t, max(abs(t), abs(state.t)))["none"]
        free = plain.rows.dot(plain.vector(state.box, None, None, state.u))
        boxes.append(free[: len(state.box)])
    return boxes, None if ends else course


def _course_of(state: IntervalState, t: float, latest: float) -> Course:
    """The course that a row at t is on; latest: how long one lasts, since nothing is claimed later.

    It begins at the state itself where none has begun.
    """
    n = len(state.box) // 2
    course = state.course
    if course is None or t - course.since > latest:
        return Course(state.t, state.t, state.box[:n], np.concatenate([np.zeros(n), state.box[n:]]))
    return course


def _advanced(
    kernels: StepKernels, course: Course, state: IntervalState, t: float, y: Vector | None
) -> tuple[Course, Vector]:
    """The course and its box at time t; y: a measurement there that ends it, used by the box."""
    size = max(abs(t), abs(state.t))
    one = kernels.at(t - state.t, size)["path" if y is None else "sampled path"]
    path = one.rows.dot(one.vector(course.path, None, y, state.u))
    whole = kernels.at(t - course.since, max(size, abs(course.since)))
    chosen = whole["none" if y is None else "sampled"]
    n, nothing = chosen.n, np.zeros_like(state.u)
    start = np.concatenate([course.radius, np.zeros(n)])
    reach = chosen.rows[:n].dot(chosen.vector(start, None, None, nothing))
    box = np.concatenate([raised(reach + path[:n], 1), path[n:]])
    return course._replace(now=t, path=path), box
