"""The graph of the clocks of a plant in discrete time, on which widths are bounded.

A node is the age of every clock after a step: the steps since the last sample of each sensor that
is silent for a bounded time, and since the last event of each name. Ages are whole numbers, so that
nothing is lost: arcs are all that the clocks allow in the next step. A sample must come when its
sensor has been silent for its longest time, and may come earlier; an event may come after its
shortest time and must after its longest one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from lmi.bounds.graph_tube import Least
from lmi.bounds.step_tube import StepGraph
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.equations.time_grid import steps_of

# nodes, and arcs, of a graph that is proved
_MOST_NODES, _MOST_ARCS = 2000, 40_000


@dataclass(frozen=True)
class _Clock:
    """Ages 0 ... ages - 1 after a step; from `first` on it may happen, at `due` it must.

    due: None where it never must, and the last age stands for all older ones.
    """

    ages: int
    first: int
    due: int | None

    def choices(self, age: int) -> tuple[tuple[bool, int], ...]:
        """(does it happen, age after it) in the step after an age."""
        older = age + 1
        stays = (False, min(older, self.ages - 1))
        if older == self.due:
            return ((True, 0),)
        return ((True, 0), stays) if older >= self.first else (stays,)


def step_graph(system: ClockSystem) -> StepGraph | str:
    """The graph of a system in discrete time, or the reason for which there is none."""
    clocks = _clocks(system)
    if isinstance(clocks, str):
        return clocks
    nodes = math.prod(clock.ages for clock in clocks)
    if nodes > _MOST_NODES:
        return f"the clocks have {nodes} states between them, more than {_MOST_NODES}"
    places = {ages: k for k, ages in enumerate(product(*(range(c.ages) for c in clocks)))}
    kinds, arcs = dict[tuple[bool, ...], int](), list[tuple[int, int, int]]()
    for ages, source in places.items():
        for choice in product(*(c.choices(age) for c, age in zip(clocks, ages, strict=True))):
            happens = tuple(one for one, _ in choice)
            kind = kinds.setdefault(happens, len(kinds))
            arcs.append((source, kind, places[tuple(age for _, age in choice)]))
        if len(arcs) > _MOST_ARCS:
            return f"the clocks allow more than {_MOST_ARCS} different steps between them"
    stages = tuple(_stages(system, happens) for happens in kinds)
    return StepGraph(stages, np.array(arcs, dtype=np.intp), nodes, len(system.f))


def _stages(system: ClockSystem, happens: tuple[bool, ...]) -> tuple[Least, ...]:
    count = len(system.counted)
    sensors = [k for k, one in zip(system.counted, happens[:count], strict=True) if one]
    return system.step_stages(sensors, [k for k, one in enumerate(happens[count:]) if one])


def _clocks(system: ClockSystem) -> list[_Clock] | str:
    """The clocks of the counted sensors, then of the events."""
    gains = system.gains
    assert gains.dt is not None
    clocks = []
    for k in system.counted:
        gap = steps_of(gains.sensors[k].gap, gains.dt)
        if not gap:
            return f"sensor {gains.sensors[k].name} has a time between two steps"
        clocks.append(_Clock(gap, 1, gap))
    for event in gains.events:
        ends = event.dwell_range
        first = steps_of(ends[0], gains.dt)
        due = None if math.isinf(ends[1]) else steps_of(ends[1], gains.dt)
        if not first or (math.isfinite(ends[1]) and due is None):
            return (
                f"event {event.name} may happen any number of times in one step: its shortest time "
                "is zero, or not stated"
            )
        clocks.append(_Clock(first if due is None else due, first, due))
    return clocks
