"""What systems of widths with one event at uncertain times have in common.

Times count outside windows: stamps T1 to T2 apart leave T1 - 2 delta to T2 from the end of one
window to the beginning of the next. Other events are exact and add to the state alone: one that
happens in a window counts as just before it, since the bound of the window is one of all times left
in it. Windows take at most floor(t / T1) 2 delta + min(2 delta, t mod T1) of a time t.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import to_float
from lmi.arithmetic.enclosure import Enclosure, expm, raised
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.equations.boxes import image_box
from obsdesign.equations.clocks import EventGains, SensorGains
from obsdesign.equations.interval.uncertain_jump import is_short

CELLS = 64  # of a window


def reason_against_events(
    events: Sequence[EventGains], sensors: Sequence[SensorGains]
) -> str | None:
    """Reason why no width is proved for several events, one at uncertain times; or None."""
    uncertain = [event for event in events if event.time_error]
    if len(uncertain) > 1:
        listed = ", ".join(event.name for event in uncertain)
        return f"widths are proved for one event with time_error; the plant has several ({listed})"
    names = [x.name for x in events if x.changes_state or x.name in {y.event for y in sensors}]
    if len(events) > 1 and names:
        return (
            "widths with several events, one of them with time_error, are proved where all have "
            f"G = I and no sensor is read at one; it is otherwise for {', '.join(names)}"
        )
    window = 2 * (uncertain[0].time_error or 0.0)
    for event in events:
        if event not in uncertain and event.dwell_range[0] <= window:
            return (
                f"event.{event.name}.every does not say that {event.name} happens once at most in "
                f"the window of {uncertain[0].name}: its shortest time must be above {window:g}"
            )
    return None


@dataclass(frozen=True)
class UncertainSystem(ClockSystem):
    """Clocks between windows, and the flow in them."""

    @cached_property
    def place(self) -> int:
        """Place of the one event at uncertain times."""
        return next(k for k, event in enumerate(self.gains.events) if event.time_error)

    @property
    def event(self) -> EventGains:
        """The one event at uncertain times."""
        return self.gains.events[self.place]

    @property
    def delta(self) -> float:
        """Largest time between it and its stamp."""
        return self.event.time_error or 0.0

    def reason_against_clocks(self) -> str | None:
        """Reason why widths are not bounded: what the file does not state; or None."""
        event, name = self.event, self.event.name
        if event.dwell_time is None:
            return f"event.{name}.every is not stated"
        if not is_short(self.gains.A, 2 * self.delta):
            return (
                f"event.{name}.time_error is long against the fastest mode of the flow, where no "
                "width is proved"
            )
        return None

    @cached_property
    def counted(self) -> tuple[int, ...]:
        """Sensors with a sample in every time from the end of a window to the next one."""
        shortest = self.dwell(self.place)[0]
        return tuple(k for k in ClockSystem(self.gains).counted if self.gap(k) <= shortest)

    def carried_age(self, events: Sequence[int], cell: int) -> int:
        """The first cell behind a window: a sample in it is not used, a full gap may come."""
        return 0 if self.place in events else cell

    def dwell(self, event: int) -> tuple[float, float]:
        """(shortest, longest) time between two events of a name, outside windows."""
        low, high = super().dwell(event)
        between, window = Fraction(super().dwell(self.place)[0]), 2 * Fraction(self.delta)
        whole, part = divmod(Fraction(low), between)
        shortest = Fraction(low) - whole * window - min(window, part)
        return math.nextafter(float(shortest), 0.0), high

    @cached_property
    def added(self) -> Matrix:
        """Columns (n, k): their sum, each with any sign, is what an event adds beside c."""
        lower, upper = image_box(*self.event.disturbance)
        middle = (lower + 0.5 * (upper - lower))[:, None]
        if self.event.E is None:
            return middle
        scaled = self.event.E * self.event.counted_inputs
        return np.hstack([middle, np.where(scaled == 0, 0.0, scaled * (1 + 4e-16))])

    @cached_property
    def window_flow(self) -> Matrix:
        """Upper bound of e^{W s} for s from 0 to the length of the window, (n, n)."""
        W, h = to_float(self.W), 2 * self.delta / CELLS
        step = expm(product(W, h))
        short = expm(product(np.maximum(W, 0.0), h)).upper
        flow, largest = Enclosure.exactly(np.eye(len(W))), short
        for _ in range(CELLS - 1):
            flow = step @ flow
            largest = np.maximum(largest, times(short, np.maximum(flow.upper, 0.0)))
        return largest


def product(A: Matrix, h: float) -> Enclosure:
    """A h, enclosed."""
    return Enclosure.exactly(A).scaled(h, 2.0**-52 * abs(h))


def times(X: Matrix, Y: Matrix) -> Matrix:
    """A product of matrices >= 0, rounded up."""
    return raised(X @ Y, 2 * X.shape[1])
