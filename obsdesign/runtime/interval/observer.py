"""Interval observer at run time: bounds that hold for samples, jumps and rounding.

Observers (6), (9) and (11) of Degue, Efimov, Richard (NOLCOS 2016), for a y that arrives as
samples: `maps` derives the maps of a step, a sample and a jump. All of them are linear in
(m, y, u, 1) and (r, 1), m and r the centre and the radius of a box: one matrix per step size,
cached (`kernel`, `step_kernels`). The errors of the enclosed matrices and the rounding of the step
itself go into the radius.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.interval.certain_bounds import without_state_bounds
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.base import (
    MODERATE,
    Estimate,
    Sample,
    instant,
    later,
    optional_measurement,
    vector,
)
from obsdesign.runtime.bounds import DeclaredBounds
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import JUMP, BoundsFault
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.interval.clock import SampleClock
from obsdesign.runtime.interval.course import advanced, course_of
from obsdesign.runtime.interval.kernel import Result
from obsdesign.runtime.interval.parametric_kernels import kernels_of
from obsdesign.runtime.interval.state import Course, IntervalState, first_box
from obsdesign.runtime.interval.state_box import known_box, known_inputs
from obsdesign.runtime.interval.step_kernels import JumpSample, StepKernels
from obsdesign.runtime.interval.stretches import Stretches
from obsdesign.runtime.interval.usual_step import usual_step
from obsdesign.runtime.interval.varying import NO_PARTS, Row, VaryingKernels
from obsdesign.runtime.known_inputs import KnownInputs
from obsdesign.runtime.state_box import Bounds, SizeStep, StatedBox, StateTube
from obsdesign.runtime.status import status_of, still_void, void_since


@dataclass(frozen=True)
class IntervalObserver(BoundsObserver[IntervalState]):
    """Executes a design of kind `interval`."""

    gains: IntervalGains
    kind: ClassVar[str] = "interval"

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """The guard of the design's jumps."""
        return (DwellGuard.from_gains(self.gains),)

    @classmethod
    def from_gains(cls, gains: Entries) -> IntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(IntervalGains.from_document(gains))

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        box = first_box(self.kernels.model, self.n, lower, upper)
        return self.from_box(instant(t), box)._replace(largest=self._largest_at_start(lower, upper))

    def from_box(self, t: float, box: Matrix) -> IntervalState:
        """State at time t from a box in the observer's coordinates, before the first sample."""
        guard, inputs = DwellGuard.from_gains(self.gains), np.zeros(int(self.reads["u"]))
        return IntervalState(t, box, inputs, None, guard, False, t)

    def reset(self, state: IntervalState, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """The same instant with new bounds of x(t): ends the refutation of a state.

        Inputs and the time of the last jump are kept. ValueError as for `init`.
        """
        box = first_box(self.kernels.model, self.n, lower, upper)
        largest = self._largest_at_start(lower, upper)
        return state._replace(box=box, refutation="", course=None, largest=largest)

    def step(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        if state.is_usual and (usual := self._usual(state, sample)) is not None:
            return usual
        t = later(sample, state.t, state.started)
        y = optional_measurement(sample.y, self.gains.p)
        off = y is not None and self.gains.is_periodic and self.clock.is_off_period(state, t)
        guard, late = state.guard.after(t, sample.jump)
        large = self.known_inputs.reasons(state.u, sample.w if sample.jump else None)
        if self.box is not None and (state.largest is not None or self.box.ends(late, large)):
            row = Row(self.unbounded, state.u, y, y, NO_PARTS, None)
        elif sample.bounds is None and state.bounds is None:
            row = Row(self.kernels, state.u, y, y, NO_PARTS, None)
        else:
            row = self.varying.row(state, sample.bounds, y)
        with np.errstate(over="ignore", invalid="ignore"):
            results, contradictions, course = self._propagated(state, sample, t, row, off)
        timing = self.clock.objections(state, sample, y, t)
        reasons = [*([late] if late else []), *timing, *large]
        objections, refutation = _judged(state.refutation, t, results, contradictions, reasons)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        kept = row.y if not sample.jump or self.gains.jump_measurement == "after" else None
        sampled = state.sampled if y is None else t
        phase = state.phase if y is None or off else t
        last = results[-1]
        largest = None
        if self.box is not None and row.kernels is self.unbounded:
            step = SizeStep(t - state.t, max(abs(t), abs(state.t)), state.u)
            known = [Bounds(each.lower, each.upper) for each in results]
            largest = self.box.after_row(state.largest, step, known, sample.w)
        following = IntervalState(t, last.box, u, kept, guard, True, sampled, refutation, phase,
                                  False, course, row.held, largest)  # fmt: skip
        is_usual = last.size < MODERATE and _is_moderate(u) and following.is_ordinary
        following = following._replace(is_usual=is_usual)
        status = status_of(objections)
        events = tuple((t, text) for text in ([JUMP] if sample.jump else []) + objections)
        return following, Estimate(t, None, last.lower, last.upper, events=events, status=status)

    def _largest_at_start(self, lower: ArrayLike, upper: ArrayLike) -> Matrix | None:
        """Bound of |x| at the start, None where a box of the state holds already."""
        return None if self.box is None else self.box.at_start(lower, upper)

    def _propagated(
        self, state: IntervalState, sample: Sample, t: float, row: Row, off: bool
    ) -> tuple[list[Result], list[str], Course | None]:
        """Results of the step to t and of its jump, contradictions of y, and the course."""
        y = row.y if not sample.jump or self.gains.jump_measurement == "before" else None
        kernels = row.kernels.for_step(t - state.t, max(abs(t), abs(state.t)))
        chosen = kernels[self._mode(state, y)]
        v = chosen.vector(state.box, state.y, y, row.u)
        out = chosen.product(v)
        contradictions = [] if y is None else chosen.implausible(out)
        result, course = chosen.result(v, out), None
        if row.kernels.keeps_course:
            further, course = self._of_course(state, t, None if y is None else row.measured, off)
            if further is not None:
                result = row.kernels.shared(result, further, row.u)
        if not sample.jump:
            return [result], contradictions, course
        jump = JumpSample(row.y, sample.w, row.u, row.parts)
        return [result, *row.kernels.after_jump(result, jump, course)], contradictions, None

    def _of_course(
        self, state: IntervalState, t: float, y: Matrix | None, off: bool
    ) -> tuple[Matrix | None, Course | None]:
        """The box of the course at t, if there is one, and the course: with the declared bounds."""
        ends = y is not None and not off
        if ends and state.course is None:
            return None, None
        latest = self.clock.latest + 4 * math.ulp(t)
        course, box = advanced(
            self.kernels, course_of(state, t, latest), state, t, y if ends else None
        )
        return box, None if ends else course

    def _usual(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate] | None:
        """The step of a sample in time, without any objection; None for any other.

        One output: written out, since most of its time is spent calling.
        """
        t, y, given, _, jump, bounds, _, _, _, _ = sample
        since, _, _, y_before, guard, _, _, _, phase, _, _, _, _ = state
        if jump or bounds is not None or type(y) is not ndarray or y.size != 1 or since < 0.0:
            return None
        h, value, kernels, clock = t - since, y.item(), self.kernels, self.clock
        usual = kernels.latest.get(h)
        if usual is None or not usual[1].begins <= t < usual[1].ends:
            usual = kernels.usual(h, t)
        if usual is None or not -MODERATE < value < MODERATE:
            return None
        if clock.period is None:
            if y_before is None or h > clock.longest:
                return None
        elif not (clock.earliest <= t - phase <= clock.latest or clock.is_in_time(state, t)):
            return None
        if guard.last_jump is not None and guard.after(t, False)[1]:
            return None
        u = state.u if given is None else vector(given, len(state.u), "u")
        if given is not None and not _is_moderate(u):
            return None
        return usual_step(usual, state, t, value, u)

    def batch(self, state: IntervalState, record: Columns) -> Batch:
        """Estimates of the rows of a record from a state at its first row: those of `step`."""
        return self.batch_step(state, record)[1]

    def batch_step(self, state: IntervalState, record: Columns) -> tuple[IntervalState, Batch]:
        """The state and the estimates after the rows of a record: the numbers of `step`."""
        if record.y is None:
            return super().batch_step(state, record)
        return Stretches(self.kernels, self.clock, record, record.y).batch(state, self.step)

    @cached_property
    def kernels(self) -> StepKernels:
        """Matrices of steps, made when they are first needed."""
        return kernels_of(self.gains)

    @cached_property
    def unbounded(self) -> StepKernels:
        """Matrices of steps that do not count on a box of the state."""
        return kernels_of(without_state_bounds(self.gains))

    @cached_property
    def box(self) -> StatedBox | StateTube | None:
        """The box of the state, and from when on it counts; None without any."""
        return known_box(self.gains)

    @cached_property
    def known_inputs(self) -> KnownInputs:
        """Bounds of known inputs that the box counts on."""
        return known_inputs(self.gains)

    @cached_property
    def varying(self) -> VaryingKernels:
        """Matrices of steps for rows with bounds of their own."""
        return VaryingKernels(self.kernels)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes, with that of what bounds of b of a row leave to the next one."""
        return super().sizes | {"2k": 2 * len(self.varying.bounds.b.lower)}

    @property
    def declared_bounds(self) -> DeclaredBounds | None:
        """Bounds of b, c and v that those of a row must not exceed; None with parameters."""
        return None if self.gains.is_uncertain else self.varying.bounds

    @cached_property
    def clock(self) -> SampleClock:
        """Sampling times that the design is for."""
        return SampleClock.from_gains(self.gains)

    def _mode(self, state: IntervalState, y: Matrix | None) -> str:
        if self.clock.period is not None:
            return "none" if y is None else "sampled"
        if state.y is not None:
            return "start" if y is None else "both"
        return "none" if y is None else "end"


def _is_moderate(u: Matrix) -> bool:
    """Are all inputs numbers that do not overflow in a step?"""
    return all(-MODERATE < value < MODERATE for value in u.tolist())


def _judged(
    refutation: str,
    t: float,
    results: list[Result],
    contradictions: list[str],
    timing: Sequence[str],
) -> tuple[list[str], str]:
    """All objections to a row, and the refutation of this row and later ones, empty without one.

    refutation: that of an earlier row; contradictions of y to the bounds; timing: objections to
    when the row came, and to its inputs.
    """
    objections, reasons = [*contradictions, *timing], contradictions
    for fault in dict.fromkeys(each.fault for each in results if each.fault is not None):
        if fault is BoundsFault.CROSSED and reasons:
            continue  # the outputs that make the bounds cross are named already
        if fault is not BoundsFault.OVERFLOWED:
            reasons = [*reasons, fault]
        objections.append(fault)
    if refutation:
        objections.append(still_void(refutation))
    elif reasons:
        refutation = void_since(t, reasons[0])
    return objections, refutation
