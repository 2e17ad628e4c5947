"""Whole records at once: stretches of equal steps in a loop of their products alone.

Where nothing but samples in time happens, every row is one product with one matrix, and the box of
the next row is cut from it: the numbers are those of `step`. Objections are looked for afterwards.
The first row that a stretch cannot explain is left to `step`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.kernel import Kernel, largest
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length

Step = Callable[[IntervalState, Sample], tuple[IntervalState, Estimate]]

# rows of a stretch that are done together
_FEWEST_ROWS, _MOST_ROWS = 16, 4096


@dataclass(frozen=True)
class Stretch:
    """Rows of one kernel: bounds (rows, n) of x, and the box after the last one (2n,)."""

    lower: Matrix
    upper: Matrix
    box: Matrix


def stretch(kernel: Kernel, box: Matrix, y0: Matrix, y1: Matrix, u: Matrix) -> Stretch:
    """Rows that the kernel explains: those before an objection, an overflow or crossed bounds.

    y0, y1: (rows, p) measurements at the start and the end of each step; u: (rows, m) inputs that
    hold over it.
    """
    n2, p, count, middle = 2 * kernel.n, kernel.p, len(y1), kernel.middle
    v = np.tile(kernel.blank, (count + 1, 1))
    v[:-1, n2 : n2 + p], v[:-1, n2 + p : n2 + 2 * p], v[:-1, n2 + 2 * p : middle - 1] = y0, y1, u
    v[0, :n2] = box
    np.abs(v[:, :middle], out=v[:, middle:])
    out = np.empty((count, len(kernel.rows)))
    outer, inner = kernel.blocks
    with np.errstate(over="ignore", invalid="ignore"):
        _recur(kernel.rows, v, out, inner or outer)
        ends = v[1:, :n2] if not inner else largest([out[:, block] for block in outer])
        lower, upper = ends[:, : kernel.n].copy(), -ends[:, kernel.n :]
        # a number that is not finite makes a comparison fail
        fine = (out[:, : 2 * p].min(axis=1) >= 0) & (out[:, 2 * p] < math.inf)
        fine &= (lower <= upper).all(axis=1)
        if inner:
            fine &= (v[1:, : kernel.n] <= -v[1:, kernel.n : n2]).all(axis=1)
    kept = count if fine.all() else int(np.argmin(fine))
    return Stretch(lower[:kept], upper[:kept], v[kept, :n2].copy())


def _recur(rows: Matrix, v: Matrix, out: Matrix, blocks: list[slice]) -> None:
    """out_k = rows v_k; the box in v_{k+1} is the largest of the blocks of out_k."""
    n2, middle = blocks[0].stop - blocks[0].start, v.shape[1] // 2
    boxes, sizes = v[1:, :n2], v[1:, middle : middle + n2]
    first, second, *others = (out[:, block] for block in (blocks[0], *blocks[-1:], *blocks[1:-1]))
    product, maximum, absolute = rows.dot, np.maximum, np.absolute
    steps = zip(v, out, first, second, boxes, sizes, *others, strict=False)
    for given, result, one, other, box, size, *more in steps:
        product(given, result)
        maximum(one, other, out=box)
        for block in more:
            maximum(box, block, out=box)
        absolute(box, size)


@dataclass(frozen=True)
class Stretches:
    """A record, and what it takes to do its equal steps together; y: its measurements (rows, p)."""

    kernels: StepKernels
    clock: SampleClock
    record: Columns
    y: Matrix

    def batch(self, state: IntervalState, step: Step) -> Batch:
        """Estimates of all rows: of those between stretches by `step`."""
        record, n, rows = self.record, self.kernels.gains.n, len(self.record.t)
        lower, upper = np.empty((rows, n)), np.empty((rows, n))
        status, row = ["ok"] * rows, 0
        events: list[object] = []
        ends = self._ends()
        while row < rows:
            state, together = self._next(state, range(row, int(ends[row])))
            if together is not None:
                done = slice(row, row + len(together.lower))
                lower[done], upper[done] = together.lower, together.upper
                row = done.stop
            if row < rows:
                state, estimate = step(state, self._sample(row))
                lower[row], upper[row] = estimate.lower, estimate.upper
                status[row] = estimate.status
                events += estimate.events
                row += 1
        return Batch(record.t, None, lower, upper, None, tuple(status), tuple(events))

    def _sample(self, row: int) -> Sample:
        u, w = (None if block is None else block[row] for block in (self.record.u, self.record.w))
        bounds = None if self.record.bounds is None else self.record.bounds[row]
        return Sample(
            float(self.record.t[row]), self.y[row], u, w, bool(self.record.jump[row]), bounds
        )

    def _ends(self) -> Indices:
        """Return for each row the first later one that is not a sample one equal step later."""
        t, u, count = self.record.t, self.record.u, len(self.record.t)
        usual = np.isfinite(self.y).all(axis=1) & ~self.record.jump & np.isfinite(t) & (t > 0)
        if self.record.bounds is not None:
            usual &= np.array([own is None for own in self.record.bounds])
        if u is not None:
            usual &= np.isfinite(u).all(axis=1)
        with np.errstate(invalid="ignore"):
            steps = np.diff(t, prepend=np.nan)
            # the matrices of a step depend on its length, rounded, and on the size of its times
            same = np.zeros(count, bool)
            same[1:] = np.frexp(t[1:])[1] == np.frexp(t[:-1])[1]
            usual &= steps > 0
        breaks = np.append(np.flatnonzero(~(usual & same)), count)
        ends = breaks[np.searchsorted(breaks, np.arange(count), side="right")]
        return np.where(usual, ends, np.arange(count))

    def _next(self, state: IntervalState, span: range) -> tuple[IntervalState, Stretch | None]:
        """The state after the steps of one length at the start of `span`, and these rows.

        None where there are none, or too few of them.
        """
        kernels, times, row = self.kernels, self.record.t, span.start
        first_t = float(times[row])
        if not (state.is_ordinary and state.started and len(span) >= _FEWEST_ROWS):
            return state, None
        is_periodic, has_y = kernels.is_periodic, state.y is not None
        if not (self.clock.is_in_time(state, first_t) if is_periodic else has_y):
            return state, None
        end = self._end_of_equal_steps(state, span)
        if end - row < _FEWEST_ROWS:
            return state, None
        chosen = kernels.with_sample(first_t - state.t, first_t, True)
        after, inputs = self.y[row:end], self._held(state.u, row, end)
        first = np.zeros(chosen.p) if state.y is None else state.y
        rows = stretch(chosen, state.box, np.vstack([first, after[:-1]]), after, inputs[:-1])
        done = len(rows.lower)
        if done == 0:
            return state, None
        now = float(times[row + done - 1])
        following = IntervalState(
            t=now, box=rows.box, u=inputs[done], y=after[done - 1], guard=state.guard,
            started=True, sampled=now, phase=now,
        )  # fmt: skip
        return following, rows

    def _held(self, u: Matrix, first: int, end: int) -> Matrix:
        """Inputs before rows first .. end - 1, and after the last: (end - first + 1, m)."""
        if self.record.u is None or not u.size:
            return np.tile(u, (end - first + 1, 1))
        return np.vstack([u, self.record.u[first:end]])

    def _end_of_equal_steps(self, state: IntervalState, span: range) -> int:
        """Return the row that ends the steps of one length, in time, at the start of `span`."""
        row, times = span.start, self.record.t
        end = min(span.stop, row + _MOST_ROWS)
        if state.guard.last_jump is not None:
            latest = state.guard.last_jump + state.guard.longest
            end = min(end, int(np.searchsorted(times, latest)))
        first_t = float(times[row])
        length, half = shared_length(first_t - state.t, first_t)
        steps = np.diff(times[row:end], prepend=state.t)
        alike = np.abs(steps - length) <= half
        alike &= self.clock.regular_steps(steps, times[row:end])
        return row + int(np.argmin(np.append(alike, False)))
