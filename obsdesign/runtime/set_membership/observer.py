"""The multiplier observer at run time: the tightest bounds that a window of stages supports.

Every bound is a weak-duality sum over the last stages (`evaluation`), certified for any
multipliers; those of a row are proposed in floats (`proposals`). The result is never wider than the
prediction from the last box, nor than its part in the strip of the measurement. Crossed bounds
prove that plant, declared bounds and data contradict each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import (
    Estimate,
    Sample,
    instant,
    later,
    optional_measurement,
    vector,
)
from obsdesign.runtime.bounds import Bounds, DeclaredBounds, DeclaredBox, declared_noise
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import (
    JUMP,
    BoundsFault,
    initial_bounds,
    midpoint,
)
from obsdesign.runtime.dwell_guard import DwellGuard
from obsdesign.runtime.set_membership.model import Disturbance, Model, observer_model
from obsdesign.runtime.set_membership.stages import Stage, drift_of, sampled_strip
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.set_membership.tables import Table, Tables
from obsdesign.runtime.set_membership.tape import Bounder, Contradiction, Result, Tape
from obsdesign.runtime.time_stamps import time_tolerance

_SUBNORMAL = 1e-290
_MOST_NAMED = 8


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
        b = DeclaredBox("b", model.flow.lower, model.flow.upper)
        c = None if model.jump is None else DeclaredBox("c", model.jump.lower, model.jump.upper)
        v = declared_noise(self.gains.noise_bound, self.gains.noise_centre)
        return DeclaredBounds(b, c, v)

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SetMembershipState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        now, box, flow = instant(t), self._box(lower, upper), self._model.flow
        return SetMembershipState(
            now, box, box, (), np.zeros(int(self.reads["u"])),
            np.stack([flow.lower, flow.upper]), DwellGuard.from_gains(self.gains), False, now,
        )  # fmt: skip

    def reset(
        self, state: SetMembershipState, *, lower: ArrayLike, upper: ArrayLike
    ) -> SetMembershipState:
        """The same instant with new bounds of x(t): ends the refutation of a state.

        Inputs and the time of the last jump are kept. ValueError as for `init`.
        """
        box = self._box(lower, upper)
        return state._replace(box=box, start=box, stages=(), refutation="")

    def step(
        self, state: SetMembershipState, sample: Sample
    ) -> tuple[SetMembershipState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        t = later(sample.t, state.t, state.started)
        y = optional_measurement(sample.y, self.gains.p)
        own = sample.bounds or Bounds()
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite bounds
            tape, result, fault = self._propagated(state, sample, t, y)
        guard, late = state.guard.after(t, sample.jump)
        reasons = [] if fault is None else [fault]
        reasons += [late] if late else []
        reasons += self._objections(state, sample, y, t)
        if not np.isfinite(result.box).all():
            reasons.append(BoundsFault.OVERFLOWED.value)
        refutation = state.refutation
        if refutation:
            reasons.append(refutation)
        elif fault is not None:
            refutation = f"void since time {t:.9g} ({fault})"
        following = SetMembershipState(
            t, tape.box, tape.start, tape.stages, u, self._held(own), guard, True,
            state.sampled if y is None else t, refutation,
        )  # fmt: skip
        events = tuple((t, text) for text in ([JUMP] if sample.jump else []) + reasons)
        return following, self._estimate(t, result, events, "; ".join(reasons) or "ok")

    def _propagated(
        self, state: SetMembershipState, sample: Sample, t: float, y: Matrix | None
    ) -> tuple[Tape, Result, str | None]:
        """The tape and the bounds after a row, and the contradiction in it, if there is one."""
        bounder, when = self._bounder, self.gains.jump_measurement
        tape = Tape(state.start, state.stages, state.box)
        used = y if not sample.jump or when == "before" else None
        stages = [self._flow_stage(state, sample, t, used)]
        if sample.jump:
            stages.append(self._jump_stage(sample, t, y if when == "after" else None))
        fault, free = None, tape.box
        for stage in stages:
            tape = bounder.predicted(tape, stage)
            free, cut = tape.box, bounder.cut(tape)
            if cut is None:
                fault = _contradiction_text(bounder.contradiction(tape))
            tape = Tape.beginning(free) if cut is None else cut
        if fault is not None:
            return self._restarted(free, fault)
        bounded = bounder.bounded(tape)
        if isinstance(bounded, Contradiction):
            return self._restarted(free, _contradiction_text(bounded))
        return (*bounded, None)

    def _restarted(self, box: Matrix, fault: str) -> tuple[Tape, Result, str]:
        """A tape that begins anew: nothing before a contradiction is used after it."""
        tape = Tape.beginning(box)
        nothing = np.full((2, self.n), np.nan)
        further = 0 if self.gains.directions is None else len(self.gains.directions)
        return tape, Result(box, np.full((2, further), np.nan), nothing), fault

    def _flow_stage(
        self, state: SetMembershipState, sample: Sample, t: float, y: Matrix | None
    ) -> Stage:
        h, size = t - state.t, max(abs(t), abs(state.t))
        table = self._tables.for_step(h, size)
        strip = self._strip(sample, y)
        return self._stage(
            Stage(t, h, size, False, state.u, state.u, state.u, strip, state.box, not sample.jump),
            table, self._model.flow, state.u, state.held,
        )  # fmt: skip

    def _jump_stage(self, sample: Sample, t: float, y: Matrix | None) -> Stage:
        table, c = self._tables.jump, self._model.jump
        assert c is not None
        inputs = 0 if self.gains.E is None else self.gains.E.shape[1]
        w = np.zeros(inputs) if sample.w is None else vector(sample.w, inputs, "w")
        declared = self.declared_bounds.c
        assert declared is not None
        pair = None if sample.bounds is None else sample.bounds.c
        held = np.stack(declared.completed(pair))
        strip = self._strip(sample, y)
        return self._stage(
            Stage(t, 0.0, abs(t), True, w, w, w, strip, held, True), table, c, w, held
        )

    def _stage(
        self, stage: Stage, table: Table, b: Disturbance, known: Matrix, held: Matrix
    ) -> Stage:
        """The stage with its drift and the radii of its disturbance, the box still open."""
        middle, radius = midpoint(held[0], held[1])
        drift, error = drift_of(table, np.concatenate([known, middle]))
        radii = np.zeros(self._model.width)
        radii[: len(b.active)] = radius[b.active]
        nothing = np.full((2, self.n), np.nan)
        return stage._replace(drift=drift, drift_error=error, radius=radii, box=nothing)

    def _strip(self, sample: Sample, y: Matrix | None) -> Matrix | None:
        if y is None:
            return None
        pair = None if sample.bounds is None else sample.bounds.v
        return sampled_strip(y, *self.declared_bounds.v.completed(pair))

    def _held(self, own: Bounds) -> Matrix:
        return np.stack(self.declared_bounds.b.completed(own.b))

    def _objections(
        self, state: SetMembershipState, sample: Sample, y: Matrix | None, t: float
    ) -> list[str]:
        """Sentences on a sample that is missing or late: claimed widths are of samples in time."""
        gains = self.gains
        is_due = gains.measured != "at_jumps" or sample.jump
        if sample.jump and gains.jump_measurement == "none":
            is_due = False
        sentences = []
        if gains.period is not None and gains.measured == "periodic" and state.started:
            apart = t - state.sampled
            slack = time_tolerance(apart, t)
            is_due = is_due and apart >= gains.period - slack
            if y is not None and apart > gains.period + slack:
                limit = f"above {gains.period:.9g}"
                sentences.append(f"time {apart:.9g} since the last sample, {limit}")
        return ["missing sample"] * (is_due and y is None) + sentences

    def _estimate(
        self, t: float, result: Result, events: tuple[tuple[float, str], ...], status: str
    ) -> Estimate:
        scales, has_lag = self._model.scales, self.gains.fixed_lag is not None
        lower, upper = _unscaled(result.box, scales)
        return Estimate(
            t, lower=lower, upper=upper, events=events, status=status,
            directions=None if self.gains.directions is None else result.directions,
            lagged=_unscaled(result.lagged, scales) if has_lag else None,
        )  # fmt: skip

    def _box(self, lower: ArrayLike, upper: ArrayLike) -> Matrix:
        low, high = initial_bounds(self.n, lower, upper)
        return _outward(np.stack([low, high]) * self._model.scales)

    @cached_property
    def _model(self) -> Model:
        return observer_model(self.gains)

    @cached_property
    def _tables(self) -> Tables:
        return Tables(self._model)

    @cached_property
    def _bounder(self) -> Bounder:
        return Bounder(self.gains, self._model, self._tables)


def _unscaled(box: Matrix, scales: Matrix) -> Matrix:
    """Bounds of x from those of z: exact unless they underflow."""
    return _outward(box / scales)


def _outward(box: Matrix) -> Matrix:
    """A box whose entries were scaled by powers of two, outward where they underflowed."""
    is_small = (np.abs(box) < _SUBNORMAL) & (box != 0.0)
    ends = np.stack([np.nextafter(box[0], -np.inf), np.nextafter(box[1], np.inf)])
    return np.where(is_small, ends, box)


def _contradiction_text(contradiction: Contradiction) -> str:
    """The status of bounds that crossed, with the samples that prove the contradiction."""
    times = [f"{t:.9g}" for t in contradiction.times]
    if len(times) > _MOST_NAMED:
        times = [*times[:3], "...", *times[-3:]]
    samples = f"samples at {' '.join(times)}" if times else "no sample"
    return f"{BoundsFault.CROSSED.value}: {samples} contradict plant and declared bounds"
