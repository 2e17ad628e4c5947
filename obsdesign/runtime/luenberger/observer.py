"""Point observer with jumps at run time: exact steps, linear interpolation between samples.

    xhat' = F xhat + L y(t) + B u + b_mid,   F = A - L C        between jumps
    xhat+ = G xhat- + M (y- - C xhat-) + E w + c_mid            at jumps

M may depend on the dwell time that ends at the jump (a schedule). Between two samples y is
interpolated linearly; a measurement taken before a jump says nothing about the time after it, and
then the next sample stands alone. Without any, the plant alone predicts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy import concatenate, ndarray
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.runtime.base import Estimate, Sample, by_position, centred, instant, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.flow_cells import FlowCells, driven_columns, free_cells
from obsdesign.runtime.jump import corrected_jump, no_jumps
from obsdesign.runtime.known_inputs import KnownInputs
from obsdesign.runtime.luenberger.stretches import LARGE, SHORTEST, Stretches
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Inputs, Outputs, States
from obsdesign.runtime.status import (
    MISSING_SAMPLE,
    VOID_ERROR,
    status_of,
    still_void,
    void_since,
)

_ONE = np.ones(1)
_FLOAT = np.dtype(np.float64)
# how an estimate ends that has x alone
_NO_BOUNDS = (None, None, None, (), "ok", None, None, None)


class LuenbergerState(NamedTuple):
    """Everything the next step needs: the estimate x just after time t.

    y: measurement that the next step may start from, less the middle of its noise; is_usual: is
    there such a y, are all numbers below `LARGE`, and are known inputs within their bounds,
    as they were? refutation: since when the bound of the error is void, and why, "" while not.
    """

    t: float
    x: States
    u: Inputs
    y: Outputs | None
    guard: DwellGuard
    started: bool
    is_usual: bool = False
    refutation: str = ""


@dataclass(frozen=True)
class LuenbergerObserver(SteppedObserver[LuenbergerState]):
    """Executes a design of kind `luenberger`."""

    gains: LuenbergerGains
    kind: ClassVar[str] = "luenberger"
    finds_events: ClassVar[bool] = False

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> LuenbergerObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(LuenbergerGains.from_document(gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> LuenbergerState:
        """State at time t from a guess of x(t), before the first sample and its jump."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        guard = DwellGuard.from_gains(self.gains)
        inputs = np.zeros(self.gains.m)
        return LuenbergerState(instant(t), guess, inputs, None, guard, started=False)

    def reset(self, state: LuenbergerState, *, x: ArrayLike) -> LuenbergerState:
        """The same instant with a new guess of x(t): the bound of the error counts again.

        Inputs and the time of the last jump are kept.
        """
        return state._replace(x=vector(x, self.n, "x"), is_usual=False, refutation="")

    def step(self, state: LuenbergerState, sample: Sample) -> tuple[LuenbergerState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        usual = self._usual(state, sample) if state.is_usual else None
        return super().step(state, sample) if usual is None else usual

    def _usual(
        self, state: LuenbergerState, sample: Sample
    ) -> tuple[LuenbergerState, Estimate] | None:
        """The step of a sample between jumps without any objection; None for any other."""
        t, y, u, _, jump, *_ = sample
        since, x, inputs, start, guard, *_ = state
        if jump or u is not None or start is None or type(y) is not ndarray:
            return None
        if y.dtype is not _FLOAT or y.shape != start.shape or not _moderate(y):
            return None
        h, end = t - since, centred(y.copy(), self.gains)
        if not 0.0 < h < self.measured_cells.longest:
            return None
        if guard.last_jump is not None and guard.after(t, False)[1]:
            return None
        x = self._measured(h, x, start, inputs, end)
        if not _moderate(x):
            return None
        following = by_position(LuenbergerState, (t, x, inputs, end, guard, True, True, ""))
        return following, by_position(Estimate, (t, x, *_NO_BOUNDS))

    def advance(
        self, state: LuenbergerState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[LuenbergerState, Estimate]:
        """Flow to t with the measurements at both ends, then jump if the sample says so."""
        when = self.gains.jump_measurement
        x = self._flow(state, t, y if not sample.jump or when == "before" else None)
        guard, late = state.guard.after(t, sample.jump)
        objections: list[str] = [late] if late else []
        large = self.known_inputs.reasons(state.u, sample.w if sample.jump else None)
        refutation = state.refutation
        objections += large
        if refutation:
            objections.append(still_void(refutation, VOID_ERROR))
        if large and not refutation:
            refutation = void_since(t, large[0])
        # without L, samples between jumps are of no use and none is missed
        is_expected = when != "none" if sample.jump else np.any(self.gains.L)
        if y is None and is_expected:
            objections.append(MISSING_SAMPLE)
        usable = y
        if sample.jump:
            if self.gains.G is None:
                raise no_jumps()
            M = self.jump_gain(state.guard.last_jump, t)
            x = corrected_jump(self.gains, x, sample.w, y, M)
            usable = y if when == "after" else None
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        is_usual = (
            self.is_certain(refutation, u)
            and usable is not None
            and all(map(_moderate, (x, usable, u)))
        )
        following = LuenbergerState(t, x, u, usable, guard, True, is_usual, refutation)
        return following, Estimate(t, x=x, status=status_of(objections, x))

    def is_certain(self, refutation: str, u: Matrix) -> bool:
        """Does the bound of the error count in the step behind a row with input u?"""
        return not (refutation or self.known_inputs.reasons(u, None))

    def batch(self, state: LuenbergerState, record: Columns) -> Batch:
        """Estimates of the rows of a record from a state at its first row: those of `step`."""
        return self.batch_step(state, record)[1]

    def batch_step(self, state: LuenbergerState, record: Columns) -> tuple[LuenbergerState, Batch]:
        """The state and the estimates after the rows of a record: the numbers of `step`."""
        if record.y is None or record.bounds is not None or record.mode is not None:
            return super().batch_step(state, record)
        return Stretches(self, state, record, record.y).batch()

    def _flow(self, state: LuenbergerState, t: float, y_end: Matrix | None) -> Matrix:
        if t == state.t:
            return state.x
        start = state.y if state.y is not None else y_end
        end = y_end if y_end is not None else start
        h = t - state.t
        if start is None or end is None:
            return np.asarray(self.free_cells.at(h).dot(concatenate((state.x, state.u, _ONE))))
        return self._measured(h, state.x, start, state.u, end)

    def _measured(self, h: float, x: Matrix, start: Matrix, u: Matrix, end: Matrix) -> Matrix:
        """The estimate after a step h in which y goes from start to end."""
        slope = (end - start) / max(h, SHORTEST)
        known = concatenate((x, start, u, _ONE, slope))
        return np.asarray(self.measured_cells.at(h).dot(known))

    @cached_property
    def known_inputs(self) -> KnownInputs:
        """Bounds of known inputs that the bound of the error counts on."""
        return KnownInputs(self.gains.input_bound, self.gains.jump_input_bound)

    @cached_property
    def free_cells(self) -> FlowCells:
        """Steps of [x; u; 1]."""
        return free_cells(self.gains)

    @cached_property
    def measured_cells(self) -> FlowCells:
        """Steps of [x; y; u; 1; slope of y]."""
        g, driven = self.gains, driven_columns(self.gains)
        n, p, known = g.n, g.p, driven.shape[1]
        N = np.zeros((n + p + known + p,) * 2)
        N[:n, : n + p + known] = np.hstack([flow_error_matrix(g.A, g.L, g.C), g.L, driven])
        N[n : n + p, -p:] = np.eye(p)
        return FlowCells(N, n)

    def jump_gain(self, last_jump: float | None, t: float) -> Matrix:
        """M, or where gains follow a schedule, the one for the dwell time that ends at t."""
        gains = self.gains
        if last_jump is None or gains.M_cells is None or gains.dwell_borders is None:
            return gains.M
        cell = np.searchsorted(gains.dwell_borders, t - last_jump, side="right")
        return np.asarray(gains.M_cells[cell])


def _moderate(values: Matrix) -> bool:
    """Are all numbers far from overflow, none NaN? Of a few, faster than by numpy."""
    return bool(sum(map(abs, values.tolist())) < LARGE)
