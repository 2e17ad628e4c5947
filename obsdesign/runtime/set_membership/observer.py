"""The multiplier observer at run time: the tightest bounds that a window of stages supports.

Every bound is a weak-duality sum over the last stages (`evaluation`), certified for any
multipliers; those of a row are proposed in floats (`proposals`). The result is never wider than the
prediction from the last box, nor than its part in the strip of the measurement. Crossed bounds
prove that plant, declared bounds and data contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Estimate, Sample, instant, later, vector
from obsdesign.runtime.bounds import Bounds, DeclaredBounds, DeclaredBox, declared_noise
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import BoundsFault, initial_bounds
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.named_clocks import Kept
from obsdesign.runtime.set_membership.bounder import Bounder, Result
from obsdesign.runtime.set_membership.clocks import ClockedRow, Clocks
from obsdesign.runtime.set_membership.model import Model, observer_model, rescaled, unscaled
from obsdesign.runtime.set_membership.row_stages import RowStages
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.tables import Tables
from obsdesign.runtime.set_membership.tape import Contradiction, Tape
from obsdesign.runtime.status import status_of, still_void, void_since


class Row(NamedTuple):
    """What a row leads to; fault: the contradiction in it, None without one."""

    tape: Tape
    result: Result
    fault: str | None


@dataclass(frozen=True)
class SetMembershipObserver(BoundsObserver[SetMembershipState]):
    """Executes a design of kind `set_membership`."""

    gains: SetMembershipGains
    kind: ClassVar[str] = "set_membership"

    @classmethod
    def from_gains(cls, gains: Entries) -> SetMembershipObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(SetMembershipGains.from_document(gains))

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """A guard for every event of the design."""
        return self._clocks.named.begin(0.0).guards

    @property
    def capacities(self) -> dict[str, int]:
        """Stages of a window, and boxes of earlier rows."""
        lag = self.gains.fixed_lag
        return {"stages": self.gains.window, "recent": 0 if lag is None else lag + 1}

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes; b: of the flow's disturbance, w: of any; events: their number, or 1.

        A stage that is no event has the place 0 too.
        """
        model = self._model
        events = max(len(model.jumps), 1)
        return super().sizes | {"b": len(model.flow.lower), "w": model.width, "events": events}

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, x1_hi, ..., then l1_lo, ..., x1_lag_lo, ..."""
        further = 0 if self.gains.directions is None else len(self.gains.directions)
        names = [f"l{i + 1}_{end}" for i in range(further) for end in ("lo", "hi")]
        if self.gains.fixed_lag is not None:
            names += [f"x{i + 1}_lag_{end}" for i in range(self.n) for end in ("lo", "hi")]
        return (*super().names, *names)

    @cached_property
    def declared_bounds(self) -> DeclaredBounds:
        """Bounds of b (or w of b = Bw w), c and v that those of a row must not exceed."""
        model = self._model
        own = len(self.gains.declared_disturbance[1])
        b = DeclaredBox("b", model.flow.lower[:own], model.flow.upper[:own])
        # those of a row are of the one jump
        c = None if self.gains.G is None else DeclaredBox("c", *self.gains.jump_disturbance[1:])
        v = declared_noise(self.gains.noise_bound, self.gains.noise_centre)
        return DeclaredBounds(b, c, v)

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SetMembershipState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        now, box, flow = instant(t), self._box(lower, upper), self._model.flow
        guards, sampled = self._clocks.named.begin(now)
        return SetMembershipState(
            now, box, box, (), np.zeros(int(self.reads["u"])),
            np.stack([flow.lower, flow.upper]), guards, False, sampled,
            np.full(self._clocks.gains.p, np.nan),
        )  # fmt: skip

    def reset(
        self, state: SetMembershipState, *, lower: ArrayLike, upper: ArrayLike
    ) -> SetMembershipState:
        """The same instant with new bounds of x(t): ends the refutation of a state.

        Inputs and the time of the last jump are kept. ValueError as for `init`.
        """
        box = self._box(lower, upper)
        nothing = np.full(self._clocks.gains.p, np.nan)  # of sensors on change
        return state._replace(
            box=box, start=box, stages=(), sent=nothing, refutation="", recent=(),
        )  # fmt: skip

    def step(
        self, state: SetMembershipState, sample: Sample
    ) -> tuple[SetMembershipState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        NaN in y marks an output that is missing. ValueError if time does not increase (the first
        sample may share the initial time).
        """
        t = later(sample, state.t, state.started, may_repeat=self._clocks.may_repeat)
        y, events = self._measured(sample.y), self._clocks.named.places(sample)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        kept, not_kept = self._clocks.after(
            Kept(state.guards, state.sampled), t, (y, events), state.started
        )
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite bounds
            row = self._propagated(state, sample, (t, y, events), in_time=not not_kept)
        reasons = [*([] if row.fault is None else [row.fault]), *not_kept]
        following = state._replace(
            t=t, u=u, held=self._held(sample.bounds or Bounds()), guards=kept.guards, started=True,
            sampled=kept.sampled, sent=self._clocks.sent(state.sent, y),
        )  # fmt: skip
        names = [self.gains.every_event[k].name for k in events]
        return self._concluded(following, row, reasons, names)

    def _concluded(
        self, state: SetMembershipState, row: Row, reasons: list[str], events: list[str]
    ) -> tuple[SetMembershipState, Estimate]:
        """The state with the tape of a row, and its estimate; `recent` are the rows before it."""
        if not np.isfinite(row.result.box).all():
            reasons.append(BoundsFault.OVERFLOWED)
        refutation = state.refutation
        if refutation:
            reasons.append(still_void(refutation))
        elif row.fault is not None:
            refutation = void_since(state.t, row.fault)
        recent = () if row.fault is not None else state.recent
        state = state._replace(
            box=row.tape.box, start=row.tape.start, stages=row.tape.stages, refutation=refutation,
            recent=self._bounder.kept((*recent, row.result.box)),
        )  # fmt: skip
        listed = tuple((state.t, text) for text in events + reasons)
        return state, self._estimate(state.t, row.result, listed, status_of(reasons))

    def _measured(self, y: ArrayLike | None) -> Matrix | None:
        """The measurement, NaN where an output is missing; None where all are."""
        if y is None:
            return None
        values = vector(y, self.gains.p, "y")
        is_finite = np.isfinite(values)
        return np.where(is_finite, values, np.nan) if is_finite.any() else None

    def _propagated(
        self,
        state: SetMembershipState,
        sample: Sample,
        row: ClockedRow,
        *,
        in_time: bool,
    ) -> Row:
        """The tape and the bounds after a row, and the contradiction in it, if there is one."""
        bounder = self._bounder
        tape = Tape(state.start, state.stages, state.box)
        stages = self._stages.of_row(state, sample, row)
        fault, free = None, tape.box
        for stage in stages:
            tape = self._extended(tape, stage._replace(in_time=in_time))
            free, cut = tape.box, bounder.cut(tape)
            if cut is None:
                fault = bounder.contradiction(tape).reason
            tape = Tape.beginning(free) if cut is None else cut
        if fault is not None:
            return self._restarted(free, fault)
        return self._bounded(tape, free, state.recent)

    def _extended(self, tape: Tape, stage: Stage) -> Tape:
        """The tape predicted to the end of a stage, which takes the place of an idle flow."""
        predicted = self._predicted(tape, stage)
        before = None if self.gains.fixed_lag is not None else tape.before_idle(stage)
        if before is None:  # with fixed_lag every row needs its stage
            return predicted
        began = before.stages[-1].t
        h, size = stage.t - began, max(abs(stage.t), abs(began))
        joined = stage._replace(h=h, size=size).driven(self._tables.for_step(h, size))
        return self._predicted(before, joined._replace(box=predicted.box))

    def _predicted(self, tape: Tape, stage: Stage) -> Tape:
        """The tape with one more stage, its box without the measurement."""
        return self._bounder.predicted(tape, stage)

    def _bounded(self, tape: Tape, free: Matrix, recent: Sequence[Matrix]) -> Row:
        """The bounds of a tape; where they are empty, a tape that begins with the box `free`."""
        bounded = self._bounder.bounded(tape, recent)
        if isinstance(bounded, Contradiction):
            return self._restarted(free, bounded.reason)
        return Row(*bounded, None)

    def _restarted(self, box: Matrix, fault: str | None) -> Row:
        """A tape that begins anew: nothing before a contradiction is used after it."""
        tape = Tape.beginning(box)
        nothing = np.full((2, self.n), np.nan)
        further = 0 if self.gains.directions is None else len(self.gains.directions)
        return Row(tape, Result(box, np.full((2, further), np.nan), nothing), fault)

    def _held(self, own: Bounds) -> Matrix:
        stated = np.stack(self.declared_bounds.b.completed(own.b))
        flow = self._model.flow  # behind them those of an unknown input
        return np.hstack([stated, np.stack([flow.lower, flow.upper])[:, stated.shape[1] :]])

    def _estimate(
        self, t: float, result: Result, events: tuple[tuple[float, str], ...], status: str
    ) -> Estimate:
        scales, has_lag = self._model.scales, self.gains.fixed_lag is not None
        lower, upper = unscaled(result.box, scales)
        return Estimate(
            t, lower=lower, upper=upper, events=events, status=status,
            directions=None if self.gains.directions is None else result.directions,
            lagged=unscaled(result.lagged, scales) if has_lag else None,
        )  # fmt: skip

    def _box(self, lower: ArrayLike, upper: ArrayLike) -> Matrix:
        low, high = initial_bounds(self.n, lower, upper)
        return rescaled(np.stack([low, high]), self._model.scales)

    @cached_property
    def _model(self) -> Model:
        return observer_model(self.gains)

    @cached_property
    def _clocks(self) -> Clocks:
        return Clocks(self.gains)

    @cached_property
    def _tables(self) -> Tables:
        return Tables(self._model)

    @cached_property
    def _stages(self) -> RowStages:
        return RowStages(self.gains, self._model, self._tables, self._clocks, self.declared_bounds)

    @cached_property
    def _bounder(self) -> Bounder:
        return Bounder(self.gains, self._model, self._tables)
