"""Instants of named events in a simulation, in the modes in which they happen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.jump_times import jump_times, spacings_of
from obsdesign.data.mode_times import ModeTimes
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
    if changes is None:
        return [jump_times(event, dwell, until, rng, plant.flow.dt) for event in plant.events]
    names = [mode.name for mode in plant.modes]
    stays = _Stays(changes, names, until, rng if dwell == "random" else None)
    return [_in_modes(event, dwell, stays, rng) for event in plant.events]


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


def _in_modes(
    event: Jump,
    dwell: str | float | Sequence[float],
    stays: _Stays,
    rng: np.random.Generator,
) -> Matrix:
    t, times = 0.0, list[float]()
    for theta in spacings_of(event, dwell, stays.until, rng):
        t = stays.admissible(event, t + theta)
        if not t <= stays.until:
            break
        times.append(t)
    return np.array(times)
