"""Whole records at once: rows without objections in a loop of products and jumps.

What multiplies the map of a step is known beforehand but for the estimate: measurements at its
ends, inputs and slopes of all rows are written together, the maps of new lengths are made together.
The numbers are those of `step`, to which rows are left that a stretch does not explain: missing
samples, dwell times outside the range, inputs beyond their bounds, numbers that may overflow.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.base import Estimate, Sample, centred
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.jump import corrected_jump

if TYPE_CHECKING:
    from obsdesign.runtime.luenberger.observer import LuenbergerObserver, LuenbergerState

# rows that are done together; of fewer, `step` takes each
_FEWEST_ROWS, _MOST_ROWS = 8, 4096
# beyond, a step is made where overflow is not a warning
LARGE = 1e30
# what a slope of y adds in shorter steps is nothing, and neither is finite
SHORTEST = 1e-150


@dataclass(frozen=True)
class Stretches:
    """Rows of a record behind a state that was started; y: its measurements (rows, p)."""

    observer: LuenbergerObserver
    before: LuenbergerState
    record: Columns
    y: Matrix

    def batch(self) -> tuple[LuenbergerState, Batch]:
        """The state and the estimates after all rows."""
        record, state, rows = self.record, self.before, len(self.record.t)
        x, status, row = np.empty((rows, self.observer.n)), ["ok"] * rows, 0
        ends = self._ends
        while row < rows:
            end = min(int(ends[row]), row + _MOST_ROWS)
            if end - row >= _FEWEST_ROWS and self._begins(state, row):
                own = self._together(state, slice(row, end))
                if len(own):
                    x[row : row + len(own)] = own
                    row += len(own)
                    state = self._behind(row - 1, own[-1], state)
                    continue
            state, estimate = self._stepped(state, row)
            x[row], status[row] = estimate.x, estimate.status
            row += 1
        return state, Batch(record.t, x, None, None, None, tuple(status))

    def _begins(self, state: LuenbergerState, row: int) -> bool:
        """Is the step to a row one of measurements, without anything that an earlier row left?"""
        is_known = state.y is not None or not self._happens[row] or self._is_before
        return state.started and is_known and self.observer.is_certain(state.refutation, state.u)

    @property
    def _is_before(self) -> bool:
        """Are measurements at jumps of the state before them?"""
        return self.observer.gains.jump_measurement == "before"

    def _stepped(self, state: LuenbergerState, row: int) -> tuple[LuenbergerState, Estimate]:
        record = self.record
        u, w = (None if block is None else block[row] for block in (record.u, record.w))
        t, jump = float(record.t[row]), bool(self._happens[row])
        return self.observer.step(state, Sample(t, self.y[row], u, w, jump))

    @cached_property
    def _measured(self) -> Matrix:
        return centred(self.y, self.observer.gains)

    @cached_property
    def _steps(self) -> Matrix:
        with np.errstate(invalid="ignore", over="ignore"):
            return np.diff(self.record.t, prepend=self.before.t)

    @cached_property
    def _happens(self) -> NDArray[np.bool_]:
        """Of each row: does a jump happen at it?"""
        return np.array(self.record.happens)

    @cached_property
    def _jumps(self) -> Indices:
        return np.flatnonzero(self._happens)

    @cached_property
    def _ends(self) -> Indices:
        """Of each row the first one from it on that a stretch does not explain."""
        record, count = self.record, len(self.record.t)
        longest = self.observer.measured_cells.longest
        with np.errstate(invalid="ignore", over="ignore"):
            usual = (self._steps > 0.0) & (self._steps < longest)
            usual &= _are_moderate(self.y) & self._are_dwell_times_kept()
        known = self.observer.known_inputs
        if record.u is not None:
            usual &= known.kept(record.u) & _are_moderate(record.u)
        if record.w is not None:
            usual &= _are_moderate(record.w)
            if known.w is not None:
                usual &= ~self._happens | (np.abs(record.w) <= known.w).all(axis=1)
        if self.observer.gains.G is None:
            usual &= ~self._happens
        if self.observer.gains.jump_measurement == "none":  # the step between two has no y
            usual[1:] &= ~(self._happens[1:] & self._happens[:-1])
        breaks = np.append(np.flatnonzero(~usual), count)
        return breaks[np.searchsorted(breaks, np.arange(count))]

    def _are_dwell_times_kept(self) -> NDArray[np.bool_]:
        """Of each row: is it in time for the last jump before it, without any tolerance?"""
        t, jump, guard = self.record.t, self._happens, self.before.guard
        jumps = np.array([np.nan if guard.last_jump is None else guard.last_jump, *t[self._jumps]])
        dwell = np.diff(jumps, prepend=np.nan)
        dwell[0] = np.nan if guard.last_dwell is None else guard.last_dwell
        before: Indices = np.cumsum(jump) - jump  # place in `jumps` of the last one before a row
        elapsed = t - jumps[before]
        change = np.abs(elapsed - dwell[before])
        is_short = jump & (elapsed < guard.shortest)
        is_other = jump & (change > guard.jitter)
        # NaN where there was none yet, which no comparison objects to
        kept: NDArray[np.bool_] = ~(is_short | is_other | (elapsed > guard.longest))
        return kept

    def _together(self, state: LuenbergerState, rows: slice) -> Matrix:
        """Estimates (k, n) of the rows of a stretch, less those from the first large one on."""
        observer, n = self.observer, self.observer.n
        v, maps = self._known(state, rows), observer.measured_cells.several(self._steps[rows])
        products = [step.dot for step in maps]
        results, first = v[1:, :n], 0
        views = list(zip(products, v, results, strict=False))
        jumps = self._jumps[slice(*np.searchsorted(self._jumps, (rows.start, rows.stop)))]
        last_jump = self._guard(rows.start - 1).last_jump
        with np.errstate(over="ignore", invalid="ignore"):
            for row in (jumps - rows.start).tolist():
                for product, known, result in views[first : row + 1]:
                    product(known, result)
                k, first = rows.start + row, row + 1
                t, w = float(self.record.t[k]), self.record.w
                M = observer.jump_gain(last_jump, t)
                own = None if w is None else w[k]
                results[row] = corrected_jump(
                    observer.gains, results[row], own, self._measured[k], M
                )
                last_jump = t
            for product, known, result in views[first:]:
                product(known, result)
            fine = _are_moderate(results)
        return results[: int(np.argmin(np.append(fine, False)))]

    def _known(self, state: LuenbergerState, rows: slice) -> Matrix:
        """[x; y at the start; u; 1; slope of y] of each step (k + 1, ...), x of the first alone."""
        n, p, steps = self.observer.n, self.observer.gains.p, self._steps[rows]
        jump = self._happens[rows]
        start = np.empty((len(steps), p))
        end = self._measured[rows].copy()
        start[1:] = end[:-1]
        # y just before a jump says nothing of the step behind it, y after one of that up to it
        has_start = np.ones(len(steps), dtype=bool)
        if self.observer.gains.jump_measurement != "after":
            has_start[1:] = ~jump[:-1]
        has_end = ~jump | self._is_before
        has_start[0] = state.y is not None
        if state.y is not None:
            start[0] = state.y
        start[~has_start] = end[~has_start]
        end[~has_end] = start[~has_end]
        v = np.empty((len(steps) + 1, self.observer.measured_cells.columns))
        v[0, :n], m = state.x, len(state.u)
        v[:-1, n : n + p] = start
        v[:-1, n + p : n + p + m] = self._held(state, rows)
        v[:-1, n + p + m] = 1.0
        v[:-1, n + p + m + 1 :] = (end - start) / np.maximum(steps, SHORTEST)[:, None]
        return v

    def _held(self, state: LuenbergerState, rows: slice) -> Matrix:
        """Inputs over the step to each row."""
        if self.record.u is None:
            return np.broadcast_to(state.u, (rows.stop - rows.start, len(state.u)))
        return np.vstack([state.u, self.record.u[rows.start : rows.stop - 1]])

    def _guard(self, row: int) -> DwellGuard:
        """The guard behind a row."""
        guard = self.before.guard
        for k in self._jumps[: np.searchsorted(self._jumps, row, side="right")][-2:]:
            guard, _ = guard.after(float(self.record.t[k]), True)
        return guard

    def _behind(self, row: int, x: Matrix, state: LuenbergerState) -> LuenbergerState:
        """The state behind a row of a stretch; state: before it."""
        is_used = not self._happens[row] or self.observer.gains.jump_measurement == "after"
        u = state.u if self.record.u is None else self.record.u[row].copy()
        y = self._measured[row].copy() if is_used else None
        return state._replace(
            t=float(self.record.t[row]), x=x.copy(), u=u, y=y, guard=self._guard(row),
            is_usual=is_used and self.observer.is_certain(state.refutation, u),
        )  # fmt: skip


def _are_moderate(values: Matrix) -> NDArray[np.bool_]:
    """Of each row: are its numbers far from overflow, none NaN?"""
    return np.asarray(np.abs(values).sum(axis=1) < LARGE)
