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
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length

Step = Callable[[IntervalState, Sample], tuple[IntervalState, Estimate]]

# rows of a stretch that are done together
_FEWEST_ROWS, _MOST_ROWS = 16, 4096


@dataclass(frozen=True)
class Stretch:
    """Rows of one kernel: bounds (rows, n) of x, and [r; m] after the last one (2n,)."""

    lower: Matrix
    upper: Matrix
    box: Matrix


def stretch(kernel: Kernel, box: Matrix, y0: Matrix, y1: Matrix, u: Matrix) -> Stretch:
    """Rows that the kernel explains: those before an objection, an overflow or crossed bounds.

    y0, y1: (rows, p) measurements at the start and the end of each step; u: (rows, m) inputs that
    hold over it.
    """
    n, p, count = kernel.n, kernel.p, len(y1)
    n2, n2p = 2 * n, 2 * n + p
    v = np.tile(kernel.blank, (count, 1))
    v[:, n2:n2p], v[:, n2p : n2p + p], v[:, n2p + p : kernel.middle - 1] = y0, y1, u
    np.abs(v[:, n : kernel.middle], out=v[:, kernel.middle :])
    out, boxes = np.empty((count, len(kernel.rows))), np.empty((count + 1, n2))
    boxes[0], sizes = box, slice(kernel.middle, kernel.middle + n)
    (first, *others), inner = kernel.blocks
    if inner:
        first, *others = inner
    with np.errstate(over="ignore", invalid="ignore"):
        for given, before, after, result in zip(v, boxes[:-1], boxes[1:], out, strict=True):
            given[:n2] = before
            np.abs(before[n:], given[sizes])
            np.dot(kernel.rows, given, result)
            ends = result[first]
            for block in others:
                ends = np.maximum(ends, result[block])
            after[:] = kernel.halves.dot(ends) if others else result[:n2]
        bounds, _ = kernel.ends(out)
        lower, upper = bounds[:, :n], -bounds[:, n:]
        # a number that is not finite makes a comparison fail
        fine = (out[:, n2 : n2 + 2 * p].min(axis=1) >= 0) & (out[:, n2 + 2 * p] < math.inf)
        fine &= (lower <= upper).all(axis=1) & (boxes[1:, :n] >= 0).all(axis=1)
    kept = count if fine.all() else int(np.argmin(fine))
    return Stretch(lower[:kept], upper[:kept], boxes[kept])


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
