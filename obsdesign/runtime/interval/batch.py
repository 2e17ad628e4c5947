"""Whole records at once: stretches of equal steps as two linear recursions in blocks.

Where nothing but samples in time happens, centre and radius obey m+ = A m + d and r+ = R r + a with
the same A and R in every row. Any path of centres will do, as long as the radius takes up how far
it is from the exact map (the defect, which is computed): so the centres may come from matrix
products over blocks of rows, in any order of summation. The first row that a stretch cannot
explain is left to `step`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.enclosure import UNIT, raised
from obsdesign.runtime.base import Sample
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.step_cache import shared_length

Matrix = NDArray[np.float64]

_BLOCK = 16


@dataclass(frozen=True)
class Columns:
    """A record as arrays with one row per time: t (rows,), y, u, w (rows, ...), jump (rows,)."""

    t: Matrix
    y: Matrix
    u: Matrix | None
    w: Matrix | None
    jump: NDArray[np.bool_]

    @staticmethod
    def of(
        t: ArrayLike,
        y: ArrayLike | None,
        u: ArrayLike | None,
        w: ArrayLike | None,
        jump: ArrayLike | None,
    ) -> Columns:
        """From what `run_batch` is given; ValueError for arrays of other lengths."""
        times = np.asarray(t, dtype=np.float64)

        def table(values: ArrayLike | None) -> Matrix | None:
            if values is None:
                return None
            array = np.asarray(values, dtype=np.float64)
            if len(array) != len(times):
                raise ValueError(
                    f"every array must have {len(times)} rows, as t has; got {len(array)}."
                )
            return array.reshape(len(times), -1)

        seen = table(y)
        jumps = np.zeros(len(times), bool) if jump is None else np.asarray(jump, dtype=bool)
        if len(jumps) != len(times):
            raise ValueError(
                f"every array must have {len(times)} rows, as t has; got {len(jumps)}."
            )
        missing = np.full((len(times), 1), np.nan)
        return Columns(times, missing if seen is None else seen, table(u), table(w), jumps)

    def sample(self, row: int) -> Sample:
        """One row; NaN in y marks a missing sample."""
        y = self.y[row] if np.isfinite(self.y[row]).all() else None
        u, w = (None if block is None else block[row] for block in (self.u, self.w))
        return Sample(float(self.t[row]), y, u, w, bool(self.jump[row]))

    def held(self, u: Matrix, first: int, end: int) -> Matrix:
        """Inputs before rows first .. end - 1, and after the last: (end - first + 1, m)."""
        if self.u is None or not u.size:
            return np.tile(u, (end - first + 1, 1))
        return np.vstack([u, self.u[first:end]])

    def stretches(self) -> NDArray[np.int_]:
        """For each row the first one, from there on, that is not a sample one equal step later."""
        t, count = self.t, len(self.t)
        usual = np.isfinite(self.y).all(axis=1) & ~self.jump & np.isfinite(t) & (t > 0)
        if self.u is not None:
            usual &= np.isfinite(self.u).all(axis=1)
        with np.errstate(invalid="ignore"):
            steps = np.diff(t, prepend=np.nan)
            # the matrices of a step depend on its length, rounded, and on the size of its times
            same = np.zeros(count, bool)
            same[1:] = np.frexp(t[1:])[1] == np.frexp(t[:-1])[1]
            usual &= steps > 0
        breaks = np.append(np.flatnonzero(~(usual & same)), count)
        ends = breaks[np.searchsorted(breaks, np.arange(count), side="right")]
        return np.where(usual, ends, np.arange(count))


def alike_until(clock: SampleClock, since: float, times: Matrix, row: int, end: int) -> int:
    """The row up to which all steps from `row` on are regular and share the matrices of the first.

    since: the time before `row`; end: at most that row.
    """
    length, half = shared_length(float(times[row]) - since, float(times[row]))
    steps = np.diff(times[row:end], prepend=since)
    alike = np.abs(steps - length) <= half
    alike &= clock.regular_steps(steps, times[row:end])
    return row + int(np.argmin(np.append(alike, False)))


@dataclass(frozen=True)
class Stretch:
    """Rows of one kernel: bounds (rows, n) of x, and [r; m] after the last one (2n,)."""

    lower: Matrix
    upper: Matrix
    box: Matrix


def stretch(kernel: Kernel, box: Matrix, y0: Matrix, y1: Matrix, u: Matrix) -> Stretch:
    """As many rows as the kernel explains: those before an objection, an overflow, crossed bounds.

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
    """Blocks from zero in one product, their starts one after the other, then what starts add."""
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
