"""Interval observer for events whose time stamps have an error.

An event stamped tau happens at some time within `time_error` of tau. From tau - time_error on its
window is open: boxes of the states before and after it are moved side by side, and the hull of them
is reported (`branches`). A sample that contradicts one of them ends the window there, or begins it
anew. What the window leaves is a box, and a curve of the event's time (`curves`).
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.enclosure import Enclosure, expm, raised
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.equations.interval.uncertain_jump import (
    DEGREE,
    UncertainJump,
    added_in_parts,
    is_short,
    parts_of,
)
from obsdesign.runtime.announced import announcing, closing, opening, uncertain
from obsdesign.runtime.base import Announced, Estimate, Sample
from obsdesign.runtime.bounds import DeclaredBounds
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.clocks.time_stamps import length_error, time_tolerance
from obsdesign.runtime.interval.branches import Branches
from obsdesign.runtime.interval.curves import plus, ranges
from obsdesign.runtime.interval.several_clocks import ClockedIntervalObserver, Row
from obsdesign.runtime.interval.uncertain_state import Known, UncertainState, Window
from obsdesign.runtime.status import with_reasons
from obsdesign.runtime.step_cache import shared_length, shared_step

exactly = Enclosure.exactly


@dataclass(frozen=True)
class UncertainTimesObserver(BoundsObserver[UncertainState]):
    """Executes a design of kind `interval` with events at uncertain times.

    Rows before the stamp of such an event that may be after it carry it in `Sample.ahead`; `run`
    and `run_batch` see to that.
    """

    gains: ClockedIntervalGains
    inner: ClockedIntervalObserver
    kind: ClassVar[str] = "interval"

    @classmethod
    def from_gains(cls, gains: Entries) -> UncertainTimesObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        inner = ClockedIntervalObserver.from_gains(gains)
        return cls(inner.gains, inner)

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> UncertainState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        return UncertainState(self.inner.init(t, lower=lower, upper=upper))

    def reset(self, state: UncertainState, *, lower: ArrayLike, upper: ArrayLike) -> UncertainState:
        """The same instant with new bounds of x(t), whichever events have happened.

        Ends the refutation of a state; inputs, clocks and windows are kept. ValueError as for
        `init`.
        """
        clocked = self.inner.reset(state.clocked, lower=lower, upper=upper)
        return Branches(self, state).begun_anew(clocked)

    def run(self, state: UncertainState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples, each once no event behind it may come before it."""
        yield from super().run(state, announcing(samples, self.time_errors))

    def step(self, state: UncertainState, sample: Sample) -> tuple[UncertainState, Estimate]:
        """Move to the time of the sample, use its measurements, and open windows of its events.

        ValueError if time decreases, and for an event that may have happened before the last row
        and that no row announced.
        """
        row = self.inner.row_of(state.clocked, sample)
        windows = self._new_windows(state, sample, row.events)
        exact = [event for event in row.events if not self.time_errors[event[0]]]
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite bounds
            branches = Branches(self, state)
            branches.advance(row.t, windows)
            cut = branches.used(row.measured, exact)
        clocked, estimate = self.inner.after_row(state.clocked, row, cut)
        opened = tuple(Known(window.event, window.stamp) for window in windows)
        known = self._without_own((*state.known, *opened), sample)
        return branches.state(clocked, known), self._with_inputs_above(estimate, row)

    def _without_own(self, known: Iterable[Known], sample: Sample) -> tuple[Known, ...]:
        """Events behind a row: each of the row itself is one of those that were announced."""
        own = (Known(each.event, each.t) for each in uncertain(sample, self.time_errors))
        behind = (Counter(known) - Counter(own)).elements()
        return tuple(each for each in behind if each.stamp >= sample.t)

    def _with_inputs_above(self, estimate: Estimate, row: Row) -> Estimate:
        """An estimate, with a word on inputs for which no width is claimed."""
        reasons = []
        for place, w in row.events:
            event = self.gains.events[place]
            if event.input_bound is not None and (np.abs(w) > event.input_bound).any():
                reasons.append(f"{event.name}: input above input_bound")
        if not reasons:
            return estimate
        listed = tuple((estimate.t, text) for text in reasons)
        return estimate._replace(
            status=with_reasons(estimate.status, reasons), events=(*estimate.events, *listed)
        )

    def _new_windows(
        self, state: UncertainState, sample: Sample, events: Iterable[tuple[int, Matrix]]
    ) -> list[Window]:
        """Windows of events that no row before announced, in the order in which they open."""
        stamped = [(each, self._inputs(each)) for each in sample.ahead]
        own = dict(events)
        stamped += [(each, own[each.event]) for each in uncertain(sample, self.time_errors)]
        before = Counter((known.event, known.stamp) for known in state.known)
        windows = []
        for (event, stamp, _), w in stamped:
            before[event, stamp] -= 1
            if before[event, stamp] >= 0:
                continue
            error = self.time_errors[event]
            since = opening(stamp, error)
            if state.clocked.started and state.t - since > time_tolerance(error, state.t):
                raise ValueError(
                    f"{self.gains.events[event].name} at {stamp:.9g} may have happened before the "
                    f"last row, {state.t:.9g}: that row must have it in Sample.ahead."
                )
            u = None if since < state.t else state.clocked.u
            since = max(since, state.t)
            box = state.clocked.box  # of the state there once it is reached
            windows.append(Window(event, stamp, since, closing(stamp, error), w, box, u))
        return sorted(windows, key=lambda window: window.since)

    def _inputs(self, announced: Announced) -> Matrix:
        sample = Sample(announced.t, w=announced.w, events=(announced.event,))
        return self.inner.known_inputs(sample, announced.event)

    @cached_property
    def time_errors(self) -> tuple[float, ...]:
        """Errors of the time stamps of events, by their places."""
        return tuple(event.time_error or 0.0 for event in self.gains.events)

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """A guard for every event of the design."""
        return self.inner.guards

    @property
    def declared_bounds(self) -> DeclaredBounds:
        """Bounds of b and v that those of a row must not exceed."""
        return self.inner.declared_bounds

    def jump_in(self, window: Window, h: float, size: float) -> UncertainJump:
        """The maps of a window of length h between time stamps of this magnitude."""
        A, G = self.gains.A, self.gains.events[window.event].G
        cache = self._jumps.setdefault(window.event, OrderedDict())
        return shared_step(cache, h, size, lambda h, e: UncertainJump.from_window(A, G, h, e))

    def uncertain_box(
        self, window: Window, box: Matrix, h: float, size: float, held: Matrix, u: Matrix
    ) -> tuple[Matrix, Matrix]:
        """(body, curve) of the states at the end of a time h in which the event happens.

        box: of the states at its start; held (2, n): bounds of b in it; u: the input.
        """
        n, maps = self.n, self.jump_in(window, h, size)
        centre, radius = midpoint(box[:n], -box[n:])
        if not np.isfinite(centre).all():
            return np.full(2 * n, -np.inf), np.zeros((len(maps.terms) - 1, n))
        b_mid, b_rad = midpoint(*held)
        beta = exactly(b_mid[:, None])
        if self.gains.B is not None:
            beta = beta + exactly(self.gains.B) @ exactly(u[:, None])
        gamma, c_rad = self._jump_input(window)
        values, spread = maps.polynomial(centre, radius, beta, gamma)
        inputs = raised(maps.b_spread @ b_rad, 2 * n) + raised(maps.c_spread @ c_rad, 2 * n)
        spread = raised(spread + inputs, 3)
        body = np.nextafter(np.concatenate([values[0], -values[0]]) - np.tile(spread, 2), -np.inf)
        return body, values[1:]

    def uncertain_jump_alone(self, window: Window, h: float, size: float) -> tuple[Matrix, Matrix]:
        """(body, curve) of what an event with G = I adds to the state at the end of its window."""
        n, A = self.n, self.gains.A
        gamma, c_rad = self._jump_input(window)
        if not is_short(A, h):
            parts = parts_of(A, h)
            length, half = shared_length(h / parts, size)
            error = half + length_error(length, size)
            part = self.jump_in(window, h / parts, size)
            body, direction = added_in_parts(part, A, length, error, parts, (gamma, c_rad))
            return body, np.vstack([direction, np.zeros((DEGREE - 1, n))])
        zero, nothing = exactly(np.zeros((n, 1))), np.zeros(n)
        maps = self.jump_in(window, h, size)
        values, spread = maps.polynomial(nothing, nothing, zero, gamma)
        spread = raised(spread + raised(maps.c_spread @ c_rad, 2 * n), 2)
        body = np.concatenate([values[0], -values[0]]) - np.tile(spread, 2)
        return np.nextafter(body, -np.inf), values[1:]

    def _jump_input(self, window: Window) -> tuple[Enclosure, Matrix]:
        """Middle (n, 1) and radius of what the event adds."""
        event = self.gains.events[window.event]
        c_mid, c_rad = midpoint(*image_box(*event.disturbance))
        gamma = exactly(c_mid[:, None])
        if event.E is not None:
            gamma = gamma + exactly(event.E) @ exactly(window.w[:, None])
        return gamma, c_rad

    def flow(self, h: float, size: float) -> Enclosure:
        """e^(A h) of a step between time stamps of this magnitude."""
        A = exactly(self.gains.A)
        return shared_step(self._flows, h, size, lambda h, e: expm(A.scaled(h, e)))

    def tube(self, box: Matrix, h: float, held: Matrix, u: Matrix) -> Matrix:
        """Box of all states on a way of length h from a box."""
        n, A = self.n, np.abs(self.gains.A)
        if not np.isfinite(box).all():
            return np.full(2 * n, -np.inf)
        size = np.maximum(np.abs(box[:n]), np.abs(box[n:]))
        push = np.abs(held).max(axis=0)
        if self.gains.B is not None:
            push = push + raised(np.abs(self.gains.B) @ np.abs(u), 2 * len(u))
        Z = np.zeros((n + 1, n + 1))
        Z[:n, :n], Z[:n, n] = A, raised(push + raised(A @ size, 2 * n), 1)
        # |x(s) - x(0)| <= int_0^h e^{|A| s} ds (|A| |x(0)| + |b + B u|)
        way = expm(exactly(Z).scaled(h, 4 * np.spacing(h))).upper[:n, n]
        return plus(box, -np.tile(np.maximum(way, 0.0), 2))

    def box_of(self, body: Matrix, curve: Matrix) -> Matrix:
        """The box around a body and a curve."""
        return plus(body, ranges((curve,)))

    @cached_property
    def _jumps(self) -> dict[int, OrderedDict[tuple[float, int], UncertainJump]]:
        return {}

    @cached_property
    def _flows(self) -> OrderedDict[tuple[float, int], Enclosure]:
        return OrderedDict()
