"""Executes designs of kind `set_membership` for plants with parameters.

Effects of parameters are bounded along the stages (`runtime.set_membership.parameters`). Where x is
known to stay in a box, stated or proved, so are they, from when on it counts (`runtime.state_box`),
and bounds are cut with a stated box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.boxes import BoundsFault
from obsdesign.runtime.known_inputs import KnownInputs
from obsdesign.runtime.set_membership.observer import Row, SetMembershipObserver
from obsdesign.runtime.set_membership.parameters import EffectBounds
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.state_box import known_box
from obsdesign.runtime.set_membership.tape import Tape
from obsdesign.runtime.state_box import Bounds, SizeStep, StatedBox, StateTube
from obsdesign.runtime.status import reasons_of, with_reasons


@dataclass(frozen=True)
class UncertainSetMembershipObserver(SetMembershipObserver):
    """Executes a design of kind `set_membership` for a plant with parameters.

    counts_box: are effects bounded by those in the box of the state too?
    """

    counts_box: bool = True

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SetMembershipState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        state = super().init(t, lower=lower, upper=upper)
        return state._replace(largest=self._at_start(lower, upper))

    def reset(
        self, state: SetMembershipState, *, lower: ArrayLike, upper: ArrayLike
    ) -> SetMembershipState:
        """The same instant with new bounds of x(t), as of any design."""
        following = super().reset(state, lower=lower, upper=upper)
        return following._replace(largest=self._at_start(lower, upper))

    def step(
        self, state: SetMembershipState, sample: Sample
    ) -> tuple[SetMembershipState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        Without the box of the state where it does not hold yet, a known input is beyond its bound
        or, of one that was proved, a dwell time is wrong. ValueError as of any design.
        """
        large = self._known_inputs.reasons(state.u, sample.w if sample.jump else None)
        late = None
        if state.guards:
            _, late = state.guards[0].after(sample.t, bool(sample.jump))
        counts_box = state.largest is None
        if self.box is not None and self.box.ends(late, large):
            counts_box = False
        observer = self if counts_box else self._without_box
        following, estimate = SetMembershipObserver.step(observer, state, sample)
        is_apart = str(BoundsFault.APART) in reasons_of(estimate.status)
        if self.box is not None and (is_apart or not counts_box):
            step = SizeStep(sample.t - state.t, max(abs(sample.t), abs(state.t)), state.u)
            results = _results(estimate, self.n, is_jump=bool(sample.jump))
            largest = self.box.after_row(state.largest, step, results, sample.w)
            following = following._replace(largest=largest)
        events = (*estimate.events, *((estimate.t, reason) for reason in large))
        status = with_reasons(estimate.status, large)
        return following, estimate._replace(status=status, events=events)

    def _predicted(self, tape: Tape, stage: Stage) -> Tape:
        effects = self._effects
        return effects.widened(super()._predicted(tape, effects.driven(stage, tape.box)))

    def _bounded(self, tape: Tape, free: Matrix, recent: Sequence[Matrix]) -> Row:
        """The bounds of a tape, cut with a stated box; without it where nothing is left."""
        if self._stated is None:
            return super()._bounded(tape, free, recent)
        cut = tape.within(self._stated)
        if cut is None:
            return self._restarted(tape.box, BoundsFault.APART)
        row = super()._bounded(cut, free, recent)
        if row.fault is not None and super()._bounded(tape, free, recent).fault is None:
            return self._restarted(free, BoundsFault.APART)
        return row

    def _at_start(self, lower: ArrayLike, upper: ArrayLike) -> Matrix | None:
        """Bound of |x| at the start, None where a box of the state holds already."""
        return None if self.box is None else self.box.at_start(lower, upper)

    @cached_property
    def box(self) -> StatedBox | StateTube | None:
        """The box of the state, None without any."""
        return known_box(self.gains)

    @cached_property
    def _stated(self) -> Matrix | None:
        """A stated box (2, n), in the model's units; None without one that counts."""
        if not (self.counts_box and isinstance(self.box, StatedBox)):
            return None
        return self._box(self.box.lower, self.box.upper)

    @cached_property
    def _known_inputs(self) -> KnownInputs:
        return KnownInputs(self.gains.input_bound, self.gains.jump_input_bound)

    @cached_property
    def _without_box(self) -> UncertainSetMembershipObserver:
        return replace(self, counts_box=False)

    @cached_property
    def _effects(self) -> EffectBounds:
        return EffectBounds(self.gains, self._model, self.counts_box)


def _results(estimate: Estimate, n: int, *, is_jump: bool) -> list[Bounds]:
    """Bounds of x after a row; just before its jump they are not reported."""
    lower, upper = (np.asarray(end) for end in (estimate.lower, estimate.upper))
    unknown = np.full(n, np.inf)
    return [*([Bounds(-unknown, unknown)] if is_jump else []), Bounds(lower, upper)]
