"""A step to a sample in time of one output, without any objection, written out.

Most of its time is spent calling; its numbers are those of the general step, bit for bit.
"""

from __future__ import annotations

from numpy import absolute, maximum

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import MODERATE, Estimate, by_position
from obsdesign.runtime.interval.kernel import largest
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.interval.step_cells import Usual


def usual_step(
    usual: Usual, state: IntervalState, t: float, y: float, next_u: Matrix
) -> tuple[IntervalState, Estimate] | None:
    """The product of a step and what follows; None where there is an objection."""
    product, (blank, box, y_start, y_end, inputs, known, sizes, checks, first, others, inner,
              uses_y, y_index, lows, highs, _, _) = usual  # fmt: skip
    _, before, u, y_before, guard, _, _, _, _, _, _, _, _ = state
    v = blank.copy()
    v[box] = before
    if uses_y:
        v[y_start] = y_before
    v[y_index] = y
    if u.size:
        v[inputs] = u
    absolute(v[known], v[sizes])
    out = product(v)
    below, above, size = out[checks].tolist()
    if not (below >= 0.0 and above >= 0.0 and size < MODERATE):
        return None
    ends = out[first]
    for block in others:
        ends = maximum(ends, out[block])
    lower, upper = ends[lows], -ends[highs]
    if True in (lower > upper).tolist():
        return None
    if inner:
        ends = largest([out[block] for block in inner])
        if True in (ends[lows] > -ends[highs]).tolist():
            return None
    return by_position(
        IntervalState, (t, ends, next_u, v[y_end], guard, True, t, "", t, True, None, None, None)
    ), by_position(Estimate, (t, None, lower, upper, None, (), "ok", None, None, None))
