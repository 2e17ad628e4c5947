"""Interval observer for several events and sensors, each on a clock of its own.

Every sample is used in the best way: the box is cut with the strips of its outputs and with the box
that the sensor's gain leads to, sensor by sensor. Each of these operations takes a smaller box to a
smaller one, and none makes a box larger: a sample that is missing never narrows what follows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.column_names import signal_columns
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.runtime.base import Estimate, Sample, instant, later, vector
from obsdesign.runtime.bounds import Bounds, DeclaredBounds, DeclaredBox, declared_noise
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import BoundsFault, initial_bounds, midpoint
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.named_clocks import Kept, NamedClocks
from obsdesign.runtime.clocks.silent_sensors import SilentSensors
from obsdesign.runtime.clocks.time_grid import steps_to_row
from obsdesign.runtime.interval.clock_kernels import ClockKernels, is_finite
from obsdesign.runtime.interval.kernel import crossed
from obsdesign.runtime.state_marks import ROWS, Axes, Inputs, MeasuredRow, Past, StackedBox
from obsdesign.runtime.status import status_of, still_void, void_since


class ClockedState(NamedTuple):
    """Everything the next row needs, just after time t.

    box: (2n,), [lower; -upper]; u: input that holds; held (2, n): bounds of b up to the next row;
    guards: of every event; sampled: time of the last sample of every sensor; sent (p,): its values,
    NaN before the first; refutation: since when the bounds are void, and why, "" while they hold.
    """

    t: float
    box: StackedBox
    u: Inputs
    held: Annotated[Matrix, ROWS, Axes("2 n")]
    guards: tuple[DwellGuard, ...]
    started: bool
    sampled: tuple[Past, ...]
    sent: MeasuredRow
    refutation: str = ""


class Measured(NamedTuple):
    """Measurements of all outputs less the middle of their noise (p,), NaN where missing.

    radius (p,): of the noise, with the rounding of the middle.
    """

    y: Matrix
    radius: Matrix


class Cut(NamedTuple):
    """A box after the operations of a row so far, and what contradicts it."""

    box: Matrix
    faults: tuple[str, ...] = ()


class Row(NamedTuple):
    """A sample, checked.

    y: measurements as they are; u, held: input and bounds of b from t on; complete: the
    measurements that widths count on; events: places of those that happen, with their known inputs.
    """

    t: float
    y: Matrix | None
    u: Matrix
    held: Matrix
    complete: Matrix | None
    measured: Measured
    events: Sequence[tuple[int, Matrix]]


@dataclass(frozen=True)
class ClockedIntervalObserver(BoundsObserver[ClockedState]):
    """Executes a design of kind `interval` for several clocks."""

    gains: ClockedIntervalGains
    kind: ClassVar[str] = "interval"

    @classmethod
    def from_gains(cls, gains: Entries) -> ClockedIntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(ClockedIntervalGains.from_document(gains))

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> ClockedState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        now, box = instant(t), self._first(lower, upper)
        guards, sampled = self._clocks.begin(now)
        held = np.stack([self.gains.flow_lower, self.gains.flow_upper])
        sent = np.full(self.gains.p, np.nan)
        return ClockedState(now, box, np.zeros(self.gains.m), held, guards, False, sampled, sent)

    def reset(self, state: ClockedState, *, lower: ArrayLike, upper: ArrayLike) -> ClockedState:
        """The same instant with new bounds of x(t): ends the refutation of a state.

        Inputs and clocks are kept. ValueError as for `init`.
        """
        nothing = np.full(self.gains.p, np.nan)  # what a sensor on change sent may be refuted too
        return state._replace(box=self._first(lower, upper), sent=nothing, refutation="")

    def step(self, state: ClockedState, sample: Sample) -> tuple[ClockedState, Estimate]:
        """Move to the time of the sample, use its measurements, and let its events happen.

        NaN in y marks an output that is missing. ValueError if time decreases.
        """
        row = self.row_of(state, sample)
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite bounds
            cut = self.flowed(state, row.t)
            # a later row of one time may hold its sample
            if self._silent.has_senders and row.t > state.t:
                cut = self.sampled(cut, self._silence_strip(state, row))
            cut = self.used(cut, row.measured, row.events)
        return self.after_row(state, row, cut)

    def row_of(self, state: ClockedState, sample: Sample) -> Row:
        """A sample, checked; ValueError for one that cannot follow the state."""
        t = later(sample, state.t, state.started, may_repeat=True)
        own, events = sample.bounds or Bounds(), self._clocks.places(sample)
        y = None if sample.y is None else vector(sample.y, self.gains.p, "y")
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        held = np.stack(self.declared_bounds.b.completed(own.b))
        if own.c is not None:
            raise ValueError("bounds of c are not used with several clocks.")
        known = [(event, self.known_inputs(sample, event)) for event in events]
        return Row(t, y, u, held, self._complete(y), self._measured(y, own), known)

    def known_inputs(self, sample: Sample, event: int) -> Matrix:
        """Known inputs of an event of a sample."""
        return self._clocks.inputs(sample, event)

    def after_row(self, state: ClockedState, row: Row, cut: Cut) -> tuple[ClockedState, Estimate]:
        """The state and the estimate where a row leaves this box."""
        t, events = row.t, [event for event, _ in row.events]
        kept, not_kept = self._clocks.after(
            Kept(state.guards, state.sampled), t, row.complete, events
        )
        refutation = state.refutation
        reasons = [*cut.faults, *not_kept, *([still_void(refutation)] if refutation else [])]
        if cut.faults and cut.faults[0] is not BoundsFault.OVERFLOWED and not refutation:
            refutation = void_since(t, cut.faults[0])
        following = ClockedState(
            t, cut.box, row.u, row.held, kept.guards, True, kept.sampled,
            self._silent.sent(state.sent, row.y), refutation,
        )  # fmt: skip
        names = [self.gains.events[k].name for k in events]
        lower, upper = cut.box[: self.n], -cut.box[self.n :]
        listed = tuple((t, text) for text in names + reasons)
        return following, Estimate(t, None, lower, upper, events=listed, status=status_of(reasons))

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """A guard for every event of the design."""
        return self._clocks.begin(0.0).guards

    @cached_property
    def declared_bounds(self) -> DeclaredBounds:
        """Bounds of b and v that those of a row must not exceed."""
        b = DeclaredBox("b", self.gains.flow_lower, self.gains.flow_upper)
        return DeclaredBounds(
            b, None, declared_noise(self.gains.noise_bound, self.gains.noise_centre)
        )

    def used(self, cut: Cut, y: Measured, events: Sequence[tuple[int, Matrix]]) -> Cut:
        """A box after the samples and events of a row."""
        for event, measured in self.in_turn(y, events):
            if event is None:
                cut = self.sampled(cut, measured)
            else:
                cut = self.happened(cut, *event, measured)
        return cut

    def in_turn(
        self, y: Measured, events: Sequence[tuple[int, Matrix]]
    ) -> Iterator[tuple[tuple[int, Matrix] | None, Measured]]:
        """Samples (None) and events of a row in their order, each with what was measured at it."""
        after = np.asarray(self._clocks.sees == "after")
        late = after if events else np.zeros_like(after)
        yield None, y._replace(y=np.where(late, np.nan, y.y))
        # what saw the state before the events corrects the first of them alone
        nothing = np.full_like(y.y, np.nan)
        for k, event in enumerate(events):
            yield event, y._replace(y=nothing if k else np.where(after, nothing, y.y))
        yield None, y._replace(y=np.where(late, y.y, np.nan))

    def flowed(self, state: ClockedState, t: float) -> Cut:
        """The box after the flow up to t."""
        h, dt = t - state.t, self.gains.dt
        count = 0 if dt is None else steps_to_row(state.t, t, dt, started=state.started)
        if h == 0.0 or (dt is not None and count == 0):
            return Cut(state.box)
        size = max(abs(t), abs(state.t))
        k = self._kernels.step(h, size) if dt is None else self._kernels.steps(count)
        v = k.vector(state.box, None, None, np.concatenate([state.u, *midpoint(*state.held)]))
        return _bounded(k.n, k.ends(out := k.rows.dot(v))[0], is_finite(k, out))

    def sampled(self, cut: Cut, measured: Measured) -> Cut:
        """The box cut with the samples of each sensor in turn; whole where a sample contradicts."""
        for place, own in enumerate(self.gains.outputs):
            y, radius = measured.y[own], measured.radius[own]
            there = np.isfinite(y)
            if not there.any():
                continue
            k = self._kernels.sample(place, there)
            out = k.rows.dot(k.vector(cut.box, None, y[there], radius[there]))
            if not is_finite(k, out):
                continue
            box = np.maximum(k.ends(out)[0], cut.box)
            faults = self._contradictions(place, there, out[: 2 * k.p])
            if crossed(box):
                faults = faults or [BoundsFault.CROSSED]
                box = cut.box
            cut = Cut(box, (*cut.faults, *faults))
        return cut

    def _silence_strip(self, state: ClockedState, row: Row) -> Measured:
        """Readings of silent sensors that send on change, before the events of a row."""
        known = self._silent.readings(state.sent, state.sampled, row.t, row.y)
        if row.events:
            known = np.where(self._clocks.sees == "after", np.nan, known)
        measured = self._measured(known, Bounds())
        radius = np.nextafter(measured.radius + self._silent.change, np.inf)
        return measured._replace(radius=radius)

    def _contradictions(self, place: int, there: Matrix, room: Matrix) -> list[str]:
        """Measurements of a sensor that no state inside the bounds can give."""
        sensor = self.gains.sensors[place]
        titles = np.array(signal_columns(sensor.name, sensor.outputs))[there]
        least = np.minimum(*np.split(room, 2))
        return [f"{title} outside its bounds" for title in titles[least < 0].tolist()]

    def happened(self, cut: Cut, event: int, w: Matrix, measured: Measured) -> Cut:
        """The box after an event: with its correction too where all that it uses is measured."""
        used = self._kernels.used[event]
        corrected = bool(used.any() and np.isfinite(measured.y[used]).all())
        y, radius = (np.where(used & corrected, x, 0.0) for x in measured)
        k = self._kernels.event(event, corrected)
        v = k.vector(cut.box, None, y, np.concatenate([w, radius]))
        following = _bounded(k.n, k.ends(out := k.rows.dot(v))[0], is_finite(k, out))
        if corrected and crossed(following.box):  # the correction contradicts the box
            plain = self.happened(cut, event, w, measured._replace(y=np.full_like(y, np.nan)))
            return plain._replace(faults=(*plain.faults, BoundsFault.CROSSED))
        return following._replace(faults=(*cut.faults, *following.faults))

    def _measured(self, y: Matrix | None, own: Bounds) -> Measured:
        """Measurements as the middle of what y - v may be, and its radius, rounded outward."""
        lower, upper = self.declared_bounds.v.completed(own.v)
        if y is None:
            return Measured(np.full(self.gains.p, np.nan), upper)
        low, high = y - upper, y - lower
        is_exact = (lower == 0.0) & (upper == 0.0)
        low = np.where(is_exact, low, np.nextafter(low, -np.inf))
        high = np.where(is_exact, high, np.nextafter(high, np.inf))
        return Measured(*midpoint(low, high))

    def _complete(self, y: Matrix | None) -> Matrix | None:
        """Measurements of the sensors all of whose outputs are there: those that widths count on.

        None where there is no such sensor.
        """
        if y is None:
            return None
        parts = [y[own] for own in self.gains.outputs]
        whole = [part if np.isfinite(part).all() else np.full_like(part, np.nan) for part in parts]
        complete: Matrix = np.concatenate(whole)
        return complete if np.isfinite(complete).any() else None

    def _first(self, lower: ArrayLike, upper: ArrayLike) -> Matrix:
        low, high = initial_bounds(self.n, lower, upper)
        return np.concatenate([low, -high])

    @cached_property
    def _kernels(self) -> ClockKernels:
        return ClockKernels(self.gains)

    @cached_property
    def _clocks(self) -> NamedClocks:
        gains = self.gains
        return NamedClocks(gains.events, gains.dt, gains.spacing, gains.sensors)

    @cached_property
    def _silent(self) -> SilentSensors:
        return SilentSensors(self.gains.sensors)


def _bounded(n: int, box: Matrix, finite: bool) -> Cut:
    """A box, or the only sound one where numbers overflowed."""
    if finite:
        return Cut(box)
    return Cut(np.full(2 * n, -np.inf), (BoundsFault.OVERFLOWED,))
