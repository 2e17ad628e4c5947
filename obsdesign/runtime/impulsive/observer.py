"""Impulsive observer at run time: exact steps between impulses, a windowed gain at each.

    xhat' = A xhat + B u + b_mid                                            between impulses
    xhat+ = G xhat- + E w + c_mid + L[k] (C xhat- - y[k])                   at impulse k

L[k] is gain (12) of Medina and Lawrence in the form of `equations.impulsive`, from a window that
slides (`window.py`), or, for the strategy `quadratic`, a table over the last spacing. Before
the first impulse the window is filled with a virtual past whose spacings are admissible: gains
depend on spacings alone, so that the theorem holds from the first impulse on.

An impulse without measurement leaves the estimate uncorrected; the window then reaches over it to
an older measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.impulsive.formulas import Core
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.runtime.base import Estimate, Sample, instant, vector
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.flow_cells import FlowCells, free_cells
from obsdesign.runtime.impulsive.window import Element, SlidingWindow
from obsdesign.runtime.jump import corrected_jump
from obsdesign.runtime.point_observer import SteppedObserver
from obsdesign.runtime.state_marks import Inputs, States
from obsdesign.runtime.status import MISSING_SAMPLE, status_of

# condition numbers, columns scaled to their usual sizes: digits are lost; nothing is left
_ILL_CONDITIONED, _SINGULAR = 1e8, 1e14
_ONE = np.ones(1)


@dataclass(frozen=True, slots=True)
class ImpulsiveState:
    """Everything the next step needs: the estimate x just after time t, and the window.

    carry: the moves over impulses without measurement (compressed windows); skipped: the last
    impulse had none; uncertified: impulses until the window holds certified spacings only.
    """

    t: float
    x: States
    u: Inputs
    window: SlidingWindow
    spacing: float | None
    guard: DwellGuard
    carry: Matrix | None = None
    skipped: bool = False
    uncertified: int = 0
    started: bool = False


@dataclass(frozen=True)
class ImpulsiveObserver(SteppedObserver[ImpulsiveState]):
    """Executes a design of kind `impulsive`."""

    gains: ImpulsiveGains
    kind: ClassVar[str] = "impulsive"
    finds_events: ClassVar[bool] = False

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> ImpulsiveObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(ImpulsiveGains.from_document(gains))

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> ImpulsiveState:
        """State at time t from a guess of x(t), before the first sample and its impulse."""
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        inputs = np.zeros(self.gains.m)
        return ImpulsiveState(
            t=instant(t),
            x=guess,
            u=inputs,
            window=self._virtual_past,
            spacing=None,
            guard=DwellGuard.from_gains(self.gains),
        )

    def advance(
        self, state: ImpulsiveState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[ImpulsiveState, Estimate]:
        """Flow to t; at an impulse, correct and jump."""
        x = self._flow(state, t)
        guard, late = state.guard.after(t, sample.jump)
        objections: list[str] = [late] if late else []
        following = state
        if sample.jump:
            if state.guard.last_jump is not None:
                following = self._slide(state, t - state.guard.last_jump)
            if state.uncertified:
                objections.append("window contains a missing sample or an uncertified spacing")
            if y is None:
                objections.append(MISSING_SAMPLE)
            L, warning = self._gain(following)
            objections += [warning] if warning and y is not None else []
            x = corrected_jump(self.gains, x, sample.w, y, None if L is None else -L)
            length = self.gains.window_length
            uncertified = length if late or y is None else max(state.uncertified - 1, 0)
            following = replace(following, uncertified=uncertified, skipped=y is None)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        following = replace(following, t=t, x=x, u=u, guard=guard, started=True)
        return following, Estimate(t, x=x, status=status_of(objections, x))

    def gain_after(self, spacings: Sequence[float]) -> tuple[Matrix | None, str | None]:
        """(L, warning or None) of an impulse after these spacings, the newest last.

        Before them is the virtual past. L is None where the window determines nothing.
        """
        state = self.init()
        for spacing in spacings:
            state = self._slide(state, spacing)
        return self._gain(state)

    @cached_property
    def _core(self) -> Core:
        return Core.from_gains(self.gains, np.asarray)

    @cached_property
    def _typical(self) -> float:
        return float(np.mean(self.gains.dwell_range))

    @cached_property
    def _virtual_past(self) -> SlidingWindow:
        gains = self.gains
        if not gains.has_window:
            return SlidingWindow.from_elements([], 1.0)
        element = self._element(self._typical, None)
        past = [element] * (gains.window_length - 1)
        return SlidingWindow.from_elements(past, gains.window_weight)

    def _core_flow(self, spacing: float) -> Matrix:
        if self._core.A is self.gains.A:  # the step to here is this flow
            return self._cells.at(spacing)[:, : self.n]
        return self._core_cells.at(spacing)

    def _element(self, spacing: float, carry: Matrix | None) -> Element:
        """Full: measured, then moved by a spacing. Compressed: moved, measured at its end."""
        core, flow = self._core, self._core_flow(spacing)
        if core.U is None or core.S is None:
            return Element(flow @ core.J, core.C)
        states = flow @ core.U if carry is None else flow @ (core.U @ carry)
        return Element(core.S @ states, core.C @ states)

    def _slide(self, state: ImpulsiveState, spacing: float) -> ImpulsiveState:
        """The window after another spacing."""
        if not self.gains.has_window:
            return replace(state, spacing=spacing)
        if self._core.U is None:
            element = self._element(spacing, None)
            if state.skipped:
                return replace(state, window=state.window.stretched(element.move))
            return replace(state, window=_shifted(state.window, element), spacing=spacing)
        past = self._element(state.spacing or self._typical, state.carry)
        if state.skipped:
            return replace(state, carry=past.move, spacing=spacing)
        return replace(state, window=_shifted(state.window, past), spacing=spacing, carry=None)

    def _gain(self, state: ImpulsiveState) -> tuple[Matrix | None, str | None]:
        """(L, warning or None); L is None where the window determines nothing."""
        core, spacing = self._core, state.spacing or self._typical
        if not self.gains.has_window:
            return self.gains.table_gain(spacing), None
        outputs, left = core.C, core.J
        if core.U is not None:
            flow = self._core_flow(spacing)
            states = flow @ (core.U if state.carry is None else core.U @ state.carry)
            outputs, left = core.C @ states, core.J @ states
        past = state.window.product
        rows = self._rows(past, outputs)
        if past is not None:
            left = left @ past.move
        correction, condition = _newest_share(rows, len(outputs), self._usual_sizes)
        if correction is None:
            return None, "singular window: no correction"
        L = -left @ correction
        warning = "ill-conditioned window" if condition > _ILL_CONDITIONED else None
        return (L if core.lift is None else core.lift @ L), warning

    def _rows(self, past: Element | None, outputs: Matrix) -> Matrix:
        """The window matrix, its older part already triangular."""
        if past is None:
            return outputs
        return np.concatenate((past.factor / self.gains.window_weight, outputs @ past.move))

    @cached_property
    def _usual_sizes(self) -> Matrix:
        """Sizes of the columns of the window matrix at the spacing of the virtual past."""
        core, outputs = self._core, self._core.C
        if core.U is not None:
            outputs = core.C @ self._core_flow(self._typical) @ core.U
        sizes = np.linalg.norm(self._rows(self._virtual_past.product, outputs), axis=0)
        return np.where(sizes > 0, sizes, 1.0)

    def _flow(self, state: ImpulsiveState, t: float) -> Matrix:
        if t == state.t:
            return state.x
        step = self._cells.at(t - state.t)
        known = np.concatenate((state.x, state.u, _ONE)) if self._forced else state.x
        return np.asarray(step @ known)

    @cached_property
    def _cells(self) -> FlowCells:
        """Steps of [x; u; 1], of x alone where nothing drives the flow."""
        gains = self.gains
        return free_cells(gains) if self._forced else FlowCells(gains.A, gains.n)

    @cached_property
    def _core_cells(self) -> FlowCells:
        return FlowCells(self._core.A, len(self._core.A))

    @cached_property
    def _forced(self) -> bool:
        return self.gains.B is not None or bool(np.any(self.gains.flow_drift))


def _shifted(window: SlidingWindow, element: Element) -> SlidingWindow:
    """The newest element in, the oldest out; a window of one impulse holds none."""
    return window if window.is_empty else window.push(element).pop()


def _newest_share(rows: Matrix, outputs: int, sizes: Matrix) -> tuple[Matrix | None, float]:
    """(R^-1 (last rows of Q)', condition number), or (None, inf); columns in their usual sizes."""
    if len(rows) < rows.shape[1]:
        return None, np.inf
    Q, scaled = np.linalg.qr(rows / sizes)
    with np.errstate(all="ignore"):
        try:
            back = np.linalg.inv(scaled)
        except np.linalg.LinAlgError:
            return None, np.inf
        condition = float(np.linalg.norm(scaled) * np.linalg.norm(back))
        if not condition < _SINGULAR:
            return None, np.inf
        return (back / sizes[:, None]) @ Q[-outputs:].T, condition
