"""Whole records at once: stretches of equal steps as two linear recursions in blocks.

Where nothing but samples in time happens, centre and radius obey m+ = A m + d and r+ = R r + a with
the same A and R in every row. Any path of centres will do, as long as the radius takes up how far
it is from the exact map (the defect, which is computed): so the centres may come from matrix
products over blocks of rows, in any order of summation. The first row that a stretch cannot
explain is left to `step`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, raised
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.interval.step_kernels import StepKernels
from obsdesign.runtime.step_cache import shared_length

Step = Callable[[IntervalState, Sample], tuple[IntervalState, Estimate]]

_BLOCK = 16
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
    n, p, middle = kernel.n, kernel.p, kernel.middle
    count = len(y1)
    with np.errstate(over="ignore", invalid="ignore"):
        known = np.empty((count, middle - n))
        known[:, n : n + p], known[:, n + p : n + 2 * p] = y0, y1
        known[:, n + 2 * p : -1], known[:, -1] = u, 1.0
        X = kernel.rows[n : 2 * n, n:middle]
        driven = known[:, n:] @ X[:, n:].T
        centres = _recursion(X[:, :n], driven, box[n:])
        known[0, :n], known[1:, :n] = box[n:], centres[:-1]
        defect = np.abs(centres - known @ X.T)
        added = raised(np.abs(known) @ kernel.rows[:n, middle:].T + defect, 4 * middle)
        radii = _upper_recursion(kernel.rows[:n, :n], added, box[:n])
        v = np.empty((count, kernel.width))
        v[0, :n], v[1:, :n] = box[:n], radii[:-1]
        v[:, n:middle] = known
        np.abs(known, out=v[:, middle:])
        out = v @ kernel.rows[2 * n :].T
        ends = out[:, 2 * p + 1 : 2 * p + 1 + 2 * n]
        for k in range(1, kernel.candidates):
            np.maximum(ends, out[:, 2 * p + 1 + 2 * n * k :][:, : 2 * n], out=ends)
        lower, upper = ends[:, :n], -ends[:, n:]
        # a number that is not finite makes a comparison fail
        fine = (out[:, : 2 * p].min(axis=1) >= 0) & (out[:, 2 * p] < math.inf)
        if p > 1:
            fine &= (lower <= upper).all(axis=1)
    kept = count if fine.all() else int(np.argmin(fine))
    last = box if kept == 0 else np.concatenate([radii[kept - 1], centres[kept - 1]])
    return Stretch(lower[:kept], upper[:kept], last)


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


def _recursion(A: Matrix, driven: Matrix, start: Matrix) -> Matrix:
    """x_k = A x_{k-1} + driven_k, x_{-1} = start: rows x_k, by blocks."""
    n = len(A)
    powers = [np.eye(n)]
    for _ in range(_BLOCK):
        powers.append(powers[-1] @ A)
    return _blocks(np.array(powers), driven, start, 0)


def _upper_recursion(R: Matrix, added: Matrix, start: Matrix) -> Matrix:
    """The same with R, added, start >= 0, rounded up."""
    n = len(R)
    powers = [np.eye(n)]
    for _ in range(_BLOCK):
        powers.append(np.where(powers[-1] @ R > 0, raised(powers[-1] @ R, 2 * n), 0.0))
    return _blocks(np.array(powers), added, start, 2 * n * (_BLOCK + 2))


def _blocks(powers: Matrix, driven: Matrix, start: Matrix, terms: int) -> Matrix:
    """Return rows x_k: blocks from zero in one product, then the contribution of their starts."""
    count, n = driven.shape
    size = min(_BLOCK, count)
    blocks = -(-count // size)
    padded = np.zeros((blocks * size, n))
    padded[:count] = driven
    # row (i, a), column (j, b): what driven_i, entry a, adds to x_j, entry b
    toeplitz = np.zeros((size, n, size, n))
    for lag in range(size):
        for j in range(lag, size):
            toeplitz[j - lag, :, j, :] = powers[lag].T
    local = padded.reshape(blocks, size * n) @ toeplitz.reshape(size * n, size * n)
    ends = local.reshape(blocks, size, n)[:, -1]
    starts = np.empty((blocks, n))
    whole, x, grown = powers[size], start, 1.0 + 2 * terms * UNIT
    for i in range(blocks):
        starts[i] = x
        x = (whole @ x + ends[i]) * grown
    spread = powers[1 : size + 1].transpose(2, 0, 1).reshape(n, size * n)
    total = local + starts @ spread
    if terms:
        total = raised(total, terms)
    result: Matrix = total.reshape(blocks * size, n)[:count]
    return result
