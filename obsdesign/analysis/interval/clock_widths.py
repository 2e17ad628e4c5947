"""Width maps of an interval observer for several clocks, exact, and what its clocks imply.

w = upper - lower: w' <= W w + f, W = Mz(A), between rows, in discrete time w+ <= |A| w + f; at an
event w+ <= |G| w + h, or what its correction makes of it; at a sample the least of w,
|I - L C| w + 2 |L| V and of the strips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import Exact, exact
from lmi.bounds.graph_tube import Least
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.equations.interval.splits import metzler_split


@dataclass(frozen=True)
class ClockSystem:
    """Width maps of a design with several clocks, exact.

    left_out: places of sensors that a proof does without. A further sample never widens, so that
    widths without them hold with them.
    """

    gains: ClockedIntervalGains
    left_out: tuple[int, ...] = field(default=(), kw_only=True)

    @cached_property
    def W(self) -> Exact:
        """Mz(A) (n, n)."""
        plus, minus = metzler_split(exact(self.gains.A))
        W: Exact = plus + minus
        return W

    @cached_property
    def f(self) -> Exact:
        """Width of b (n,)."""
        f: Exact = exact(self.gains.flow_upper) - exact(self.gains.flow_lower)
        return f

    @cached_property
    def counted(self) -> tuple[int, ...]:
        """Places of the sensors that are silent for a bounded time."""
        return tuple(
            k
            for k, sensor in enumerate(self.gains.sensors)
            if sensor.event is None and 0.0 < sensor.gap < math.inf and k not in self.left_out
        )

    @property
    def never_widens(self) -> bool:
        """Does a further sample never widen the bounds? Silence, where it counts, ends with one."""
        return all(sensor.sends_on_change is None for sensor in self.gains.sensors)

    @property
    def not_counted(self) -> tuple[str, ...]:
        """Names of the sensors that no proof counts on, whose times are not bounded."""
        sensors = self.gains.sensors
        return tuple(
            sensor.name
            for k, sensor in enumerate(sensors)
            if k not in self.counted and sensor.event is None
        )

    def dwell(self, event: int) -> tuple[float, float]:
        """(shortest, longest) time between two events of a name."""
        return self.gains.events[event].dwell_range

    def carried_age(self, events: Sequence[int], cell: int) -> int:
        """Cell of the time since a sensor was due, after events, for that of its last sample."""
        return cell

    @property
    def spacing(self) -> Fraction:
        """Least time between two events of different names."""
        return Fraction(self.gains.spacing or 0.0)

    def gap(self, sensor: int) -> Fraction:
        """Longest time between two samples of a sensor."""
        return Fraction(self.gains.sensors[sensor].gap)

    def sampled(self, sensor: int) -> Least:
        """What a sample of a sensor makes of the width."""
        own = self.gains.outputs[sensor]
        C, L = exact(self.gains.C[own]), exact(self.gains.L[:, own])
        V, unit = exact(self.gains.noise_bound[own]), exact(np.eye(self.gains.n))
        maps = [(unit, 0 * self.f), (abs(unit - L @ C), abs(L) @ V * 2)]
        maps += [_strips(unit, c, v) for c, v in zip(C, V, strict=True)]
        return Least(tuple(maps))

    def touched(self, sensor: int) -> tuple[bool, ...]:
        """Which states a sample of a sensor may bound better than they are."""
        own = self.gains.outputs[sensor]
        C, L = self.gains.C[own], self.gains.L[:, own]
        return tuple(((C != 0).any(axis=0) | (L != 0).any(axis=1)).tolist())

    def is_read(self, event: int) -> bool:
        """Is a sensor read at an event alone?"""
        return any(x.event == self.gains.events[event].name for x in self.gains.sensors)

    def step_stages(self, sensors: Sequence[int], events: Sequence[int]) -> tuple[Least, ...]:
        """What a step of discrete time makes of it: its map, samples, events, samples after them.

        sensors: those that are read on clocks of their own, in order; a gain acts at the first
        event alone.
        """
        step = Least(((abs(exact(self.gains.A)), self.f),))
        names = {self.gains.events[k].name for k in events}
        read = [k for k, x in enumerate(self.gains.sensors) if k in sensors or x.event in names]
        after = [k for k in read if events and self.gains.sensors[k].sees == "after"]
        before = [k for k in read if k not in after]
        stages = [step, *(self.sampled(k) for k in before)]
        for place, event in enumerate(events):
            stages.append(self._jump(event, [] if place else before))
        return (*stages, *(self.sampled(k) for k in after))

    def counts(self, event: int) -> bool:
        """Does an event matter for stability: may it widen or narrow, or happen without end?

        One that does not may as well not happen: without what it adds no width is the larger for
        it, and what it adds is bounded in every time. Ahead of an event in its row it takes the
        gain M of that event away, and so matters.
        """
        size = abs(self.gains.events[event].G)
        may_widen = bool((size > np.eye(len(size))).any())
        may_precede_gain = not self.spacing and any(M.any() for M in self.gains.event_gains)
        matters = may_widen or may_precede_gain or self.is_read(event)
        return matters or self.dwell(event)[0] == 0.0

    def happened(self, events: Sequence[int]) -> tuple[Least, ...]:
        """What events of a row make of it: samples before them, their maps, samples after them.

        A correction is that of the first event: the others no longer have the state that was seen.
        """
        names = [self.gains.events[e].name for e in events]
        read = [k for k, x in enumerate(self.gains.sensors) if x.event in names]
        stages = [self.sampled(k) for k in read if self.gains.sensors[k].sees == "before"]
        own = [k for k in read if self.gains.sensors[k].event == names[0]]
        seen_before = [k for k in own if self.gains.sensors[k].sees == "before"]
        stages += [self._jump(e, [] if place else seen_before) for place, e in enumerate(events)]
        return (*stages, *(self.sampled(k) for k in read if self.gains.sensors[k].sees == "after"))

    def _jump(self, event: int, measured: Sequence[int]) -> Least:
        """The map of an event; measured: sensors with a sample of the state before it."""
        own = self.gains.events[event]
        lower, upper = image_box(*own.disturbance)
        G, h = exact(own.G), exact(upper) - exact(lower)
        M, C = self.gains.event_gains[event], exact(self.gains.C)
        read = np.zeros(self.gains.p, dtype=bool)
        for k in measured:
            read[self.gains.outputs[k]] = True
        maps = [(abs(G), h)]
        if M.any() and not M[:, ~read].any():
            noise = abs(exact(M)) @ exact(self.gains.noise_bound) * 2
            maps.append((abs(G - exact(M) @ C), h + noise))
        return Least(tuple(maps))


def _strips(unit: Exact, c: Array, v: Array) -> tuple[Exact, Exact]:
    """Rows of the states that an output is about, from its strip; those of the others unchanged."""
    N, k = unit.copy(), unit[0] * 0
    for i in range(len(c)):
        if c[i] != 0:
            N[i] = abs(c) / abs(c[i])
            N[i, i] = N[i, i] * 0
            k[i] = 2 * v / abs(c[i])
    return N, k
