"""Interval observer at run time: bounds that hold for samples, jumps and rounding.

Observers (6), (9) and (11) of Degue, Efimov, Richard (NOLCOS 2016) are written for a continuous y.
Here y arrives as samples, and holding the last one would break the enclosure. Between two
samples we use what the plant lets y do (a slope scheme): the path of the centre is known
exactly, and the distance of any path to it is bounded by a comparison system.

State: a centre m and a radius r >= 0 with |z - m| <= r, x = S z (S = I where there are no other
coordinates). Over a step h without jump, with the measurement y = C z(0) + v taken at its start,

    z_c' = A z_c + B u + b_mid                     z_c(0) = m       the centre of the prediction
    rho' = Mz(A) rho + b_rad                       rho(0) = r       |z - z_c| <= rho
    sig' = |C A| rho + |C| b_rad                   sig(0) = 0       |C(z - z_c) - its value at 0|
    q'   = W q + |L| (V + sig) + b_rad             q(0) = r         |z - m+| <= q

    m+ = z_c(h) + K (y - C m),   K = int_0^h e^{(A - L C) s} ds L,

because L C z = L(y + C(z_c - m)) + L(-v + something in [-sig, sig]). With the measurement at the
end of the step instead, sig(h) - sig takes the place of sig and y - C z_c(h) that of y - C m.
Without any, A predicts alone: m+ = z_c(h), r+ = rho(h). For h -> 0 this is the paper's observer.

With `measured = periodic` a sample is an event like a jump: A predicts, then z+ = z + L(y - C z).
Step and sample are one map, of which the absolute value is taken, K = I - L C:

    r+ = |K e^{A h}| r + (bound of int_0^h |K e^{A s}| ds b_rad) + |L| V

(`lmi.arithmetic.exponential.absolute_flow`); what is reported is also cut with |C x - y| <= V and
the prediction. What is claimed of the width is about samples a period apart: for rows between them
see `interval_course`.

All of it is linear in (m, y, u, 1) and (r, 1): one matrix per step size, cached
(`interval_steps`, `interval_kernel`). Matrices are enclosed; what they may be off by, and the
rounding of the step itself, go into the radius.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import frexp
from typing import Any, ClassVar

import numpy as np
from numpy import absolute, maximum, ndarray
from numpy.typing import ArrayLike

from obsdesign.runtime.base import (
    MODERATE,
    Batch,
    DwellGuard,
    Estimate,
    Sample,
    Vector,
    columns_read,
    first_time,
    later,
    optional_measurement,
    require_gains,
    require_shapes,
    vector,
)
from obsdesign.runtime.bound_observer import BoundObserver
from obsdesign.runtime.interval.batch import Columns, Stretch, alike_until, stretch
from obsdesign.runtime.interval.clock import SampleClock, refuting
from obsdesign.runtime.interval.course import besides
from obsdesign.runtime.interval.kernel import Kernel, StepKernels
from obsdesign.runtime.interval.state import IntervalState, first_box

_ONE_OUTPUT = (1,)
# rows of a stretch that are done together
_FEWEST_ROWS, _MOST_ROWS = 16, 4096


@dataclass(frozen=True)
class IntervalObserver(BoundObserver[IntervalState]):
    """Executes a design of kind `interval`."""

    gains: Mapping[str, Any]
    finds_events: ClassVar[bool] = True
    event_names: ClassVar[tuple[str, ...]] = ("t", "event")

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> IntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        two = gains.get("form") == "two_coordinates"
        squares = ("D0", "D1", *(name for name in ("S", "S2", "T") if name in gains))
        require_gains(gains, squares, () if two else ("Gp", "Gn"))
        given = [
            name for name in ("noise_bound", "noise_centre") if name in (*gains, "noise_bound")
        ]
        require_shapes(gains, dict.fromkeys(given, np.shape(gains["C"])[:1]))
        return cls(gains)

    @cached_property
    def n(self) -> int:
        """Number of states."""
        return len(self.gains["A"])

    @cached_property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        return columns_read(self.gains)

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """State at time t from bounds of x(t), before the first sample and its jump.

        ValueError if a lower bound exceeds its upper one or a bound is not finite.
        """
        guard, inputs, now = DwellGuard.of(self.gains), np.zeros(int(self.reads["u"])), float(t)
        box = first_box(self._kernels.model, self.n, lower, upper)
        return IntervalState(now, box, inputs, None, guard, False, now)

    def reset(self, state: IntervalState, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """The same instant with new bounds of x(t): ends what a refuted state says of itself.

        Inputs and the time of the last jump are kept. ValueError as for `init`.
        """
        box = first_box(self._kernels.model, self.n, lower, upper)
        return state._replace(box=box, lost="", course=None)

    def step(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        if self._short and state.moderate and (usual := self._usual(state, sample)) is not None:
            return usual
        t = later(sample.t, state.t, state.started)
        y = optional_measurement(sample.y, self._p)
        seen = y if not sample.jump or self._clock.when == "before" else None
        kernels = self._kernels.at(t - state.t, max(abs(t), abs(state.t)))
        chosen = kernels[self._mode(state, seen, t)]
        with np.errstate(over="ignore", invalid="ignore"):
            out = chosen.rows.dot(chosen.vector(state.box, state.y, seen, state.u))
            objections = [] if seen is None else chosen.implausible(out)
            off = y is not None and self._clock.off_period(state, t)
            boxes, course = besides(self._kernels, self._clock, state, t, seen, off)
            if boxes:
                chosen, out = self._kernels.shared(chosen, out, boxes, state.u)
            if sample.jump:
                chosen, out = self._kernels.after_jump(
                    kernels, out, state, y, sample.w, off, course
                )
                course = None
        guard, late = state.guard.after(t, sample.jump)
        if late:
            objections.append(late)
        objections += self._clock.objections(state, sample, y, t)
        box, bounds, fatal = chosen.results(out)
        objections += fatal
        lost = state.lost or refuting(t, objections)
        if state.lost:
            objections.append(state.lost)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        usable = y if not sample.jump or self._clock.when == "after" else None
        following = IntervalState(
            t, box, u, usable, guard, True, state.sampled if y is None else t, lost,
            state.phase if y is None or off else t,
            bool(out[2 * self.n + 2 * self._p] < MODERATE), course,
        )  # fmt: skip
        status = "; ".join(objections) if objections else "ok"
        events = tuple((t, text) for text in (["jump"] if sample.jump else []) + objections)
        return following, Estimate(t, None, *bounds, events=events, status=status)

    def _usual(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate] | None:
        """The step of a sample that is in time, with nothing to object; None for any other.

        One output and no inputs: written out, since most of its time is spent calling.
        """
        t, y, _, _, jump = sample
        if jump or state.lost or type(y) is not ndarray or y.shape != _ONE_OUTPUT:
            return None
        if state.course is not None:
            return None
        found = self._quick.get((t - state.t, frexp(t)[1]))
        if found is None or not t > state.t >= 0.0 or not -MODERATE < y.item() < MODERATE:
            return None
        apart = t - state.phase
        if not self._earliest <= apart <= self._latest and not self._clock.in_time(state, t):
            return None
        rows, blank, box, y_end, known, sizes, checks, one, two = found
        v = blank.copy()
        v[box] = state.box
        v[y_end] = y
        absolute(v[known], v[sizes])
        out = rows.dot(v)
        below, above, size = out[checks].tolist()
        if not (below >= 0.0 and above >= 0.0 and size < MODERATE):
            return None
        guard = state.guard
        if guard.last_jump is not None and guard.after(t, False)[1]:
            return None
        ends, n = maximum(out[one], out[two]), self.n
        following = IntervalState(t, out[box], state.u, v[y_end], guard, True, t, "", t, True)
        return following, Estimate(t, None, ends[:n], -ends[n:])

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
    ) -> Batch:
        """The whole record at once, from bounds of x at its first row.

        Stretches of equal steps are done together, all other rows by `step`: the bounds agree with
        those of `step` up to rounding, and hold as well.
        """
        state = self.init(first_time(np.ravel(t)), lower=lower, upper=upper)
        record = Columns.of(t, y, u, w, jump)
        times = record.t
        lows, highs = np.empty((len(times), self.n)), np.empty((len(times), self.n))
        status = ["ok"] * len(times)
        ends, row = record.stretches(), 0
        while row < len(times):
            state, found = self._stretch(state, record, row, int(ends[row]))
            if found is not None:
                done = slice(row, row + len(found.lower))
                lows[done], highs[done] = found.lower, found.upper
                row = done.stop
            if row < len(times):
                state, estimate = self.step(state, record.sample(row))
                lows[row], highs[row] = estimate.lower, estimate.upper
                status[row] = estimate.status
                row += 1
        return Batch(times, None, lows, highs, None, tuple(status))

    def _stretch(
        self, state: IntervalState, record: Columns, row: int, end: int
    ) -> tuple[IntervalState, Stretch | None]:
        """Do rows from `row` on together, as far as they are ordinary samples in time."""
        times, end = record.t, min(end, row + _MOST_ROWS)
        if state.guard.last_jump is not None:
            latest = state.guard.last_jump + state.guard.longest
            end = min(end, int(np.searchsorted(times, latest)))
        mode = "start" if self._clock.period is None else "sampled"
        fits = state.started and not state.lost and state.course is None
        fits = fits and (mode == "sampled" or state.y is not None)
        first_t = float(times[row])
        if not fits or not self._clock.admits_stretch(state, first_t):
            return state, None
        end = alike_until(self._clock, state.t, times, row, end)
        if end - row < _FEWEST_ROWS:
            return state, None
        chosen = self._kernels.at(first_t - state.t, first_t)[mode]
        after, inputs = record.y[row:end], record.held(state.u, row, end)
        first = np.zeros(self._p) if state.y is None else state.y
        found = stretch(chosen, state.box, np.vstack([first, after[:-1]]), after, inputs[:-1])
        done = len(found.lower)
        if done == 0:
            return state, None
        now = float(times[row + done - 1])
        following = IntervalState(
            now, found.box, inputs[done], after[done - 1], state.guard, True, now, "", now
        )
        return following, found

    def fleet_kernel(self, h: float, size: float, has_sample: bool) -> Kernel:
        """The kernel of a step with a measurement at its end, for `interval_fleet`."""
        mode = "sampled" if self._clock.period is not None else "start" if has_sample else "end"
        return self._kernels.at(h, size)[mode]

    @cached_property
    def _kernels(self) -> StepKernels:
        return StepKernels(self.gains)

    @cached_property
    def _quick(self) -> dict[tuple[float, int], tuple[Any, ...]]:
        return self._kernels.usual

    @cached_property
    def _clock(self) -> SampleClock:
        return SampleClock.of(self.gains)

    @cached_property
    def _p(self) -> int:
        return len(self.gains["C"])

    @cached_property
    def _latest(self) -> float:
        return self._clock.latest

    @cached_property
    def _earliest(self) -> float:
        return self._clock.earliest

    @cached_property
    def _short(self) -> bool:
        """Can `_usual` do most of the steps?"""
        return self._clock.period is not None and self._p == 1 and not self.reads["u"]

    def _mode(self, state: IntervalState, seen: Vector | None, t: float) -> str:
        if self._clock.period is not None:
            return "none" if seen is None else "sampled"
        if t != state.t and state.y is not None:
            return "start"
        return "none" if seen is None or t == state.t else "end"
