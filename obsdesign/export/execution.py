"""A program run in Python: every operation of the C code in its order, rounded as there.

The results are those of C without fused multiplication, bit for bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.export.program import Product, Program


class Row(NamedTuple):
    """A sample of a target: step, its place among the lengths, 0 for none; y: None if missing."""

    step: int
    y: Matrix | None
    u: Matrix | None = None
    w: Matrix | None = None
    jump: bool = False


class Carried(NamedTuple):
    """What the next row needs of numbers: e, the measurement that it starts from, and u.

    since_jump: ticks since the last jump, None before the first; history: number of the sequence of
    the last spacings; has_gap: was the last sample missing? filled: samples in
    the window, without a gap.
    """

    e: Matrix
    y: Matrix | None
    u: Matrix
    since_jump: int | None = None
    history: int = 0
    has_gap: bool = False
    filled: int = 0


class Execution:
    """Steps of a program; numbers are those of its target."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._dtype = program.target.dtype
        self._rows = [each.rows.astype(self._dtype) for each in program.products]

    def start(self, *initial: Matrix) -> Carried:
        """The state from bounds lower, upper of x, or from an estimate x."""
        program, u = self.program, self._numbers(np.zeros(self.program.sizes.m))
        first = [self._numbers(each) for each in initial]
        if not program.has_bounds:
            x = np.zeros(program.sizes.ends, self._dtype)
            x[program.first : program.first + program.sizes.n] = first[0]
            if program.initial is not None:
                x, _ = self._applied(program.initial, x, None, None, u)
            return Carried(x, None, u, history=len(program.jumps) - 1)
        e = np.concatenate([first[0], -first[1]])
        if program.initial is not None:
            _, e = self._applied(program.initial, e, None, None, u)
        return Carried(e, None, u)

    def step(self, state: Carried, row: Row) -> tuple[Carried, Matrix]:
        """The state and [lower; -upper] of x, or x and d, after a row."""
        program = self.program
        when, flow = program.rules.when, program.flows[row.step]
        y = None if row.y is None else self._numbers(row.y)
        used = y if not row.jump or when == "before" else None
        ends = e = state.e
        if program.full is not None and row.step and state.filled >= program.rules.samples:
            flow = program.full
        if flow is not None:
            place = flow[_MODES[state.y is not None, used is not None]]
            ends, e = self._applied(place, e, state.y, used, state.u)
            if program.refines_gaps and (used is None or state.has_gap):
                ends = self._refined(e, ends)
        elapsed = state.since_jump
        if elapsed is not None and row.step:
            elapsed += program.timing.ticks[row.step - 1]
        cell = state.history
        if row.jump:
            cell = self._cell(elapsed, state.history)
            corrected = y is not None and when != "none"
            place = program.jumps[cell][corrected]
            w = self._numbers(np.zeros(program.sizes.l) if row.w is None else row.w)
            known = np.concatenate([np.zeros(program.sizes.before_jump_inputs, w.dtype), w])
            ends, e = self._applied(place, e, None, y if corrected else None, known)
            if used is None and program.through and row.step:
                ends, e = self._cut(row.step, state, w, ends, e)
            if corrected and program.still is not None:
                ends, e = self._applied(program.still, e, None, y, state.u)
            elapsed = 0
        kept = y if not row.jump or when == "after" else None
        u = state.u if row.u is None else self._numbers(row.u)
        has_gap = y is None and not row.jump
        filled = 0 if used is None else state.filled + 1
        if row.jump:
            filled = int(when == "after" and y is not None)
        return Carried(e, kept, u, elapsed, cell, has_gap, filled), ends[program.answer]

    def _cut(
        self, step: int, state: Carried, w: Matrix, ends: Matrix, e: Matrix
    ) -> tuple[Matrix, Matrix]:
        """Ends after a jump, with those of step and jump as one product."""
        place = self.program.through[step]
        assert place is not None
        _, whole = self._applied(place, state.e, None, None, np.concatenate([state.u, w]))
        both = np.maximum(e, whole)
        cut = self._refined(both, ends)
        return (ends, e) if cut is ends else (cut, both)

    def _refined(self, box: Matrix, ends: Matrix) -> Matrix:
        """Bounds of x, cut with those that the box gives; as they are where these cross."""
        still = self.program.flows[0]
        assert still is not None
        of_x, _ = self._applied(still["none"], box, None, None, self._numbers(np.zeros(0)))
        cut = np.maximum(ends, of_x)
        return ends if _crossed(box) or _crossed(cut) else cut

    def _cell(self, elapsed: int | None, history: int) -> int:
        """Place of the gain of a jump, `elapsed` ticks after the last one."""
        timing, count = self.program.timing, len(self.program.jumps)
        if self.program.rules.window and timing.spacings is not None:
            if elapsed is None:
                return history
            above, base = elapsed - timing.shortest, timing.spacings + 1
            return (history * base + above) % count if 0 <= above < base - 1 else count - 1
        borders = timing.borders
        if elapsed is None or not borders:
            return 0
        return 1 + sum(border <= elapsed for border in borders)

    def _numbers(self, values: Matrix) -> Matrix:
        return np.asarray(values, dtype=self._dtype)

    def _applied(
        self, place: int, e: Matrix, y0: Matrix | None, y1: Matrix | None, known: Matrix
    ) -> tuple[Matrix, Matrix]:
        """(ends of x, ends that are carried) of a product."""
        sizes, product = self.program.sizes, self.program.products[place]
        v = np.zeros(sizes.middle, self._dtype)
        v[: sizes.ends] = e
        at = sizes.ends
        for y in (y0, y1):
            if y is not None:
                v[at : at + sizes.p] = y
            at += sizes.p
        v[at : at + len(known)] = known
        v[-1] = 1.0
        if not self.program.has_bounds:
            result = self._sums(place, v)
            return result, result
        out = self._sums(place, np.concatenate([v, np.abs(v)]))
        return self._largest(product, out)

    def _sums(self, place: int, v: Matrix) -> Matrix:
        rows = self._rows[place]
        total = np.zeros(len(rows), self._dtype)
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            for column, value in zip(rows.T, v, strict=True):
                total = total + column * value
        return total

    def _largest(self, product: Product, out: Matrix) -> tuple[Matrix, Matrix]:
        n2 = self.program.sizes.ends
        if not out[product.rooms] <= self.program.target.largest:
            nothing = np.full(n2, -np.inf, self._dtype)
            return nothing, nothing
        blocks = out[product.rooms + 1 :].reshape(-1, n2)
        ends = blocks[: product.outer].max(axis=0)
        inner = blocks[product.outer : product.outer + product.inner]
        e = inner.max(axis=0) if product.inner else ends
        if _crossed(ends) or _crossed(e):
            of_x, of_z = product.whole
            return blocks[of_x], blocks[of_z]
        return ends, e


def width_cost(program: Program, double: Program, rows: list[Row], initial: list[Matrix]) -> float:
    """Relative growth of the mean width of all bounds of a record against binary64."""
    means = []
    for each in (program, double):
        execution = Execution(each)
        state, widths = execution.start(*initial), []
        for row in rows:
            state, ends = execution.step(state, row)
            widths.append(-(ends[: each.sizes.n] + ends[each.sizes.n :]).astype(np.float64))
        means.append(np.mean(widths, axis=0))
    ours, least = means
    return float(np.max(np.where(least > 0, ours / np.where(least > 0, least, 1.0) - 1.0, 0.0)))


def _crossed(ends: Matrix) -> bool:
    n = len(ends) // 2
    return bool((ends[:n] > -ends[n:]).any())


_MODES = {
    (False, False): "none", (True, False): "start", (False, True): "end", (True, True): "both",
}  # fmt: skip
