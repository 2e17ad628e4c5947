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
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.kernel import Kernel, largest
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.interval.state_box import known_inputs
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length, shared_lengths

Step = Callable[[IntervalState, Sample], tuple[IntervalState, Estimate]]

# rows of a stretch that are done together
_FEWEST_ROWS, _MOST_ROWS = 16, 4096
# of these in one loop
_TOGETHER = 256


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
    n, count = kernel.n, len(y1)
    together = _Together(kernel, min(count, _TOGETHER))
    lower, upper = np.empty((2, count, n))
    with np.errstate(over="ignore", invalid="ignore"):
        for first in range(0, count, _TOGETHER):
            some = slice(first, min(first + _TOGETHER, count))
            own, boxes, fine = together.rows(box, y0[some], y1[some], u[some])
            lower[some], upper[some] = own[:, :n], -own[:, n:]
            fine &= (lower[some] <= upper[some]).all(axis=1)
            if not fine.all():
                kept = int(np.argmin(fine))
                box = boxes[kept - 1].copy() if kept else box
                return Stretch(lower[: first + kept], upper[: first + kept], box)
            box = boxes[-1].copy()
    return Stretch(lower, upper, box)


class _Together:
    """Room for rows that one kernel does in a loop: what it multiplies, the products, views."""

    def __init__(self, kernel: Kernel, count: int) -> None:
        n2, middle = 2 * kernel.n, kernel.middle
        self._kernel = kernel
        self._v = np.tile(kernel.blank, (count + 1, 1))
        self._out = np.empty((count, len(kernel.rows)))
        outer, inner = kernel.blocks
        first, *others = (self._out[:, block] for block in inner or outer)
        second, *more = others[::-1] or [first]
        boxes, sizes = self._v[1:, :n2], self._v[1:, middle : middle + n2]
        further = list(zip(*more, strict=True)) or [()] * count
        views = zip(self._v, self._out, first, second, boxes, sizes, further, strict=False)
        self._views = list(views)

    def rows(
        self, box: Matrix, y0: Matrix, y1: Matrix, u: Matrix
    ) -> tuple[Matrix, Matrix, NDArray[np.bool_]]:
        """[lower; -upper] of x, those that are carried on, and whether no number objects."""
        kernel, count = self._kernel, len(y1)
        n, p, middle = kernel.n, kernel.p, kernel.middle
        v, out = self._v[: count + 1], self._out[:count]
        v[0, : 2 * n] = box
        for values, start in ((y0, 2 * n), (y1, 2 * n + p), (u, 2 * n + 2 * p)):
            v[:-1, start : start + values.shape[1]] = values
        np.abs(v[:, :middle], out=v[:, middle:])
        product, maximum, absolute = kernel.product, np.maximum, np.absolute
        for given, result, first, second, ends, sizes, more in self._views[:count]:
            product(given, result)
            maximum(first, second, out=ends)
            for block in more:
                maximum(ends, block, out=ends)
            absolute(ends, sizes)
        # a number that is not finite makes a comparison fail
        fine = (out[:, : 2 * p] >= 0).all(axis=1) & (out[:, 2 * p] < math.inf)
        boxes = v[1:, : 2 * n]
        outer, inner = kernel.blocks
        if not inner:
            return boxes, boxes, fine
        fine &= (boxes[:, :n] <= -boxes[:, n:]).all(axis=1)
        return largest([out[:, block] for block in outer]), boxes, fine


@dataclass(frozen=True)
class Stretches:
    """A record, and what it takes to do its equal steps together; y: its measurements (rows, p)."""

    kernels: StepKernels
    clock: SampleClock
    record: Columns
    y: Matrix

    def batch(self, state: IntervalState, step: Step) -> tuple[IntervalState, Batch]:
        """The state after all rows, and their estimates: between stretches by `step`."""
        record, n, rows = self.record, self.kernels.gains.n, len(self.record.t)
        lower, upper = np.empty((rows, n)), np.empty((rows, n))
        status, row = ["ok"] * rows, 0
        events: list[object] = []
        ends, times, jumps = self._ends().tolist(), record.t.tolist(), record.jump.tolist()
        while row < rows:
            if ends[row] - row >= _FEWEST_ROWS:
                state, together = self._next(state, range(row, ends[row]))
                if together is not None:
                    done = slice(row, row + len(together.lower))
                    lower[done], upper[done] = together.lower, together.upper
                    row = done.stop
            if row < rows:
                state, estimate = step(state, self._sample(row, times[row], jumps[row]))
                lower[row], upper[row] = estimate.lower, estimate.upper
                status[row] = estimate.status
                events += estimate.events
                row += 1
        return state, Batch(record.t, None, lower, upper, None, tuple(status), tuple(events))

    def _sample(self, row: int, t: float, jump: bool) -> Sample:
        u, w = (None if block is None else block[row] for block in (self.record.u, self.record.w))
        bounds = None if self.record.bounds is None else self.record.bounds[row]
        return Sample(t, self.y[row], u, w, jump, bounds)

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
            usual &= steps > 0
        # the matrices of a step depend on its length, rounded, and on the size of its times
        lengths, exponents = shared_lengths(np.where(usual, steps, 0.0), np.where(usual, t, 1.0))
        same = np.zeros(count, bool)
        same[1:] = (exponents[1:] == exponents[:-1]) & (lengths[1:] == lengths[:-1])
        breaks = np.append(np.flatnonzero(~(usual & same)), count)
        ends = breaks[np.searchsorted(breaks, np.arange(count), side="right")]
        return np.where(usual, ends, np.arange(count))

    def _next(self, state: IntervalState, span: range) -> tuple[IntervalState, Stretch | None]:
        """The state after the steps of one length at the start of `span`, and these rows.

        None where there are none, or too few of them.
        """
        kernels, times, row = self.kernels, self.record.t, span.start
        first_t = float(times[row])
        if not (state.is_ordinary and state.started):
            return state, None
        is_periodic, has_y = kernels.is_periodic, state.y is not None
        if not (self.clock.is_in_time(state, first_t) if is_periodic else has_y):
            return state, None
        end = self._end_of_equal_steps(state, span)
        inputs = self._held(state.u, row, end)
        within = known_inputs(kernels.gains).kept(inputs[:-1])
        end = row + int(np.argmin(np.append(within, False)))
        if end - row < _FEWEST_ROWS:
            return state, None
        chosen = kernels.with_sample(first_t - state.t, first_t, True)
        after, inputs = self.y[row:end], inputs[: end - row + 1]
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
            return np.broadcast_to(u, (end - first + 1, len(u)))
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
