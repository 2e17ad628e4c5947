"""Bounds since a sample on the period or a jump, with any rows between.

Claims about the width are about samples a period apart and jumps between them:
r+ = |K e^{A h}| r + ..., K = I - L C, and r+ = |G e^{A s}| r + ... at jumps. Rows in between, off
the period or without a sample, make two steps of one, and |K e^{A (h - s)}| |e^{A s}| is at least
|K e^{A h}|, often more. So in addition to the box of such a row the observer keeps the radius at
the last sample on the period (or jump), and makes the whole step from there as well: the
intersection of both is no wider than without the rows between. The centre goes from row to row, as
inputs may change there, and its rounding is bounded separately.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.interval.path import around_path
from obsdesign.runtime.interval.state import Course, IntervalState
from obsdesign.runtime.interval.step_kernels import StepKernels


def course_of(state: IntervalState, t: float, latest: float) -> Course:
    """The course of a row at t; latest: how long one lasts, since nothing is claimed later.

    It begins at the state itself where none has begun.
    """
    n = len(state.box) // 2
    course = state.course
    if course is None or t - course.since > latest:
        centre, radius = midpoint(state.box[:n], -state.box[n:])
        return Course(state.t, state.t, radius, np.concatenate([np.zeros(n), centre]))
    return course


def advanced(
    kernels: StepKernels, course: Course, state: IntervalState, t: float, y: Matrix | None
) -> tuple[Course, Matrix]:
    """The course and its box at time t; y: a measurement there that ends it, used by the box."""
    size = max(abs(t), abs(state.t))
    name = "none" if y is None else "sampled"
    path = kernels.for_step(t - state.t, size).path(name).after(course.path, y, state.u)
    whole = kernels.for_step(t - course.since, max(size, abs(course.since))).box_map(name)
    box = around_path(path, whole.R, whole.g, course.radius)
    return course._replace(now=t, path=path), box
