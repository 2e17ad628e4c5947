"""Width maps of an interval observer with one event at uncertain times, any G; upper bounds.

How far a state moves in the window then depends on the state: y(sigma) = sum_k eta^k K_k X with
X = (x, b, gamma) (`equations.interval.uncertain_jump`). The middle of a box of width w that holds a
state |x| <= r is at most r + w / 2, so that the box behind the window has the width

    (N + sum_k |K_k^x|) w + 2 sum_k (|K_k^x| r + |K_k^b| |b| + |K_k^gamma| |gamma|) + ...,   k >= 1,

N a bound of |D| w for all linear parts D, the dots what b, c and the remainder add. r is a tube of
|x| itself: |x|' <= W |x| + |b|, |x|+ <= |G| |x| + |gamma + c|. Samples may narrow the window: all
of this is the largest over its lengths.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, exact
from lmi.arithmetic.enclosure import Enclosure, raised
from lmi.bounds.graph_tube import Least
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.uncertain_widths import UncertainSystem, times
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.equations.interval.uncertain_jump import UncertainJump

_LENGTHS = 16  # cells of the length of a window


def turns(gains: ClockedIntervalGains) -> bool:
    """Does the event do more than add to the state?"""
    return not np.array_equal(gains.events[0].G, np.eye(gains.n))


@dataclass(frozen=True)
class SizeSystem(UncertainSystem):
    """The size of the state, without any sensor; just before it an event may happen."""

    @cached_property
    def f(self) -> Exact:
        """Largest |b| (n,)."""
        return exact(np.maximum(np.abs(self.gains.flow_lower), np.abs(self.gains.flow_upper)))

    @cached_property
    def counted(self) -> tuple[int, ...]:
        """None of the sensors."""
        return ()

    def dwell(self, event: int) -> tuple[float, float]:
        """From an event to any time in the window of the next one, not later than that event."""
        low, high = ClockSystem(self.gains).dwell(event)
        shortest = Fraction(low) - 2 * Fraction(self.delta)
        return math.nextafter(float(shortest), 0.0), math.nextafter(high + 2 * self.delta, math.inf)

    def happened(self, events: Sequence[int]) -> tuple[Least, ...]:
        """What an event makes of it."""
        lower, upper = image_box(*self.event.disturbance)
        added = np.maximum(np.abs(lower), np.abs(upper))
        if self.event.E is not None:
            added = raised(added + times(np.abs(self.event.E), self.event.counted_inputs), 2)
        return (Least(((abs(exact(self.event.G)), exact(added)),)),)


@dataclass(frozen=True)
class UncertainGeneralSystem(UncertainSystem):
    """Width maps for states of at most this size; sizes (n,): from a tube of a `SizeSystem`."""

    sizes: Sequence[float] = ()

    def reason_against(self) -> str | None:
        """Reason why widths are not bounded, or None."""
        if reason := self.reason_against_clocks():
            return reason
        if self.gains.B is not None:
            return (
                f"event.{self.event.name}.G is not the identity and flow.B is there: how far the "
                "state moves in time_error depends on the state, which known inputs may take "
                "anywhere"
            )
        return None

    def happened(self, events: Sequence[int]) -> tuple[Least, ...]:
        """What a window makes of the width of the bounds."""
        N, h = self._window_map
        flow, delta = exact(self.window_flow), exact(np.array(self.delta))[()]
        before = 2 * delta * (flow @ self.f)
        return (Least(((exact(N) @ flow, exact(N) @ before + exact(h)),)),)

    @cached_property
    def _window_map(self) -> tuple[Matrix, Matrix]:
        """(N, h): the width w becomes at most N w + h, whatever the length of the window."""
        half = math.nextafter(self.delta / _LENGTHS, math.inf)
        cells = [
            UncertainJump.from_window(
                self.gains.A, self.event.G, (2 * k + 1) * half, half * (1 + 1e-12)
            )
            for k in range(_LENGTHS)
        ]
        maps = [self._map(cell) for cell in cells]
        return np.max([N for N, _ in maps], axis=0), np.max([h for _, h in maps], axis=0)

    def _map(self, jump: UncertainJump) -> tuple[Matrix, Matrix]:
        """The same for one length."""
        n = self.gains.n
        b_lower, b_upper = self.gains.flow_lower, self.gains.flow_upper
        c_lower, c_upper = image_box(*self.event.disturbance)
        b = np.maximum(np.abs(b_lower), np.abs(b_upper))[:, None]
        curve = raised(np.sum([x.magnitude for x in jump.terms[1:]], axis=0), len(jump.terms))
        moves = times(curve[:, :n], np.array(self.sizes)[:, None])
        moves = moves + times(curve[:, n : 2 * n], b)
        added = Enclosure.exactly(self.added)
        for term in jump.terms[1:]:
            part = Enclosure(term.mid[:, 2 * n :], term.rad[:, 2 * n :]) @ added
            moves = moves + part.magnitude.sum(axis=1, keepdims=True)
        remainder = times(jump.remainder[:, :n], np.array(self.sizes)[:, None])
        remainder = remainder + times(jump.remainder[:, n : 2 * n], b)
        remainder = remainder + times(jump.remainder[:, 2 * n :], np.abs(self.added)).sum(
            axis=1, keepdims=True
        )
        inputs = times(jump.b_spread, (b_upper - b_lower)[:, None])
        inputs = inputs + times(jump.c_spread, (c_upper - c_lower)[:, None])
        h = raised(2 * (moves + remainder) + inputs, 64 + 4 * n)[:, 0]
        return raised(jump.x_spread + curve[:, :n] + jump.remainder[:, :n], 4), h
