"""Instants of named events in a simulation, in the modes in which they happen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation.event_spacings import jump_times, spacings_of
from obsdesign.data.simulation.stays import ModeTimes
from obsdesign.errors import InputError
from obsdesign.problem.plant import Jump, Plant

# of a stay, after which an event that was due before it comes where dwell times are short
_SOON = 1e-3


def event_times(
    plant: Plant,
    dwell: str | float | Sequence[float],
    until: float,
    rng: np.random.Generator,
    changes: ModeTimes | None = None,
) -> list[Matrix]:
    """Instants of every event in (0, until], as `jump_times`.

    changes: of mode; an event that is due in a mode in which it does not happen comes in the next
    stay in which it does.
    """
    if not plant.events:
        return []
    if changes is None and not plant.timing.spacing:
        return [jump_times(event, dwell, until, rng, plant.flow.dt) for event in plant.events]
    stays = None
    if changes is not None:
        names = [mode.name for mode in plant.modes]
        stays = _Stays(changes, names, until, rng if dwell == "random" else None)
    clocks = [_Clock(event, iter(spacings_of(event, dwell, 2 * until, rng)), stays is None)
              for event in plant.events]  # fmt: skip
    return _Schedule(clocks, plant.timing.spacing, stays).times(until)


@dataclass(frozen=True)
class _Stays:
    """Stays of a simulation; rng: None where events that were due before one come soon."""

    changes: ModeTimes
    names: Sequence[str]
    until: float
    rng: np.random.Generator | None

    def each(self) -> Iterator[tuple[float, float, str]]:
        """(begin, end, mode) in order."""
        ends = [0.0, *self.changes.times.tolist(), math.inf]
        modes = [self.changes.first, *self.changes.modes]
        for begin, end, mode in zip(ends[:-1], ends[1:], modes, strict=True):
            yield begin, end, self.names[mode]

    def admissible(self, event: Jump, t: float) -> float:
        """The time at which an event that is due at t comes; infinite for never."""
        for begin, end, mode in self.each():
            if t > end or not (event.modes is None or mode in event.modes):
                continue
            if t > begin:
                return t
            share = _SOON if self.rng is None else float(self.rng.uniform(_SOON, 1.0))
            return round(begin + share * (min(end, self.until) - begin), 12)
        return math.inf


@dataclass
class _Clock:
    """An event: when it is due, and when its last one was.

    has_deadline: is its longest time kept? is_forced: is it due early, so that another one may come
    after it?
    """

    event: Jump
    spacings: Iterator[float]
    has_deadline: bool
    due: float = 0.0
    last: float = -math.inf
    is_forced: bool = False

    def __post_init__(self) -> None:
        self.advance(0.0)

    def advance(self, t: float) -> None:
        """It happens at t, or all begins there."""
        self.due, self.is_forced = t + next(self.spacings, math.inf), False

    @property
    def deadline(self) -> float:
        """The latest time at which it is admissible."""
        if not self.has_deadline or self.event.dwell_time is None:
            return math.inf
        return max(self.last, 0.0) + self.event.dwell_time[1]


@dataclass(frozen=True)
class _Schedule:
    """Events of a simulation, that come in turn, a spacing apart."""

    clocks: Sequence[_Clock]
    spacing: float
    stays: _Stays | None

    def times(self, until: float) -> list[Matrix]:
        """Instants of every event in (0, until]; InputError where a deadline is missed."""
        times: list[list[float]] = [[] for _ in self.clocks]
        while (clock := min(self.clocks, key=lambda own: own.due)).due <= until:
            earliest = max(clock.due, self._free_from(clock))
            if self.stays is not None:
                earliest = self.stays.admissible(clock.event, earliest)
            if earliest > clock.deadline:
                raise InputError(
                    f"timing.spacing = {self.spacing:g} leaves no time for an event "
                    f"{clock.event.name} by t = {clock.deadline:g}; try another seed."
                )
            if earliest > clock.due:
                clock.due = earliest
            elif not self._goes_first(clock):
                times[self.clocks.index(clock)].append(clock.due)
                clock.last = clock.due
                clock.advance(clock.last)
        return [np.round(own, 12) for own in times]

    def _free_from(self, clock: _Clock) -> float:
        """The first time that is a spacing after all other events."""
        others = [own.last for own in self.clocks if own is not clock]
        return max((last + self.spacing for last in others), default=-math.inf)

    def _goes_first(self, clock: _Clock) -> bool:
        """Is another event made due before one, since it could not come after it in time?"""
        for other in self.clocks if not clock.is_forced else ():
            if other is clock or other.deadline >= clock.due + self.spacing:
                continue
            shortest, _ = other.event.dwell_time or (0.0, math.inf)
            first = max(other.last + shortest, self._free_from(other), 0.0)
            due = max(first, min(clock.due, clock.deadline - self.spacing))
            if due + self.spacing <= clock.deadline:
                other.due, other.is_forced = due, True
                clock.due = max(clock.due, due + self.spacing)
                return True
        return False
