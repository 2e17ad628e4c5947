"""Stays in modes and their successors in a simulation, drawn or as short as can be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.errors import InputError
from obsdesign.problem.modes import Mode, spans_of

_MOST_CHANGES = 1e5


@dataclass(frozen=True)
class ModeTimes:
    """The first mode, and (time, mode) of each change in (0, until]; modes by their places."""

    first: int
    times: Matrix
    modes: tuple[int, ...]

    def modes_before(self, rows: Matrix) -> list[int]:
        """The mode that leads up to each row; rows (k,) in order."""
        places = np.searchsorted(self.times, rows, side="left")
        listed = (self.first, *self.modes)
        return [listed[k] for k in places.tolist()]

    def modes_of(self, rows: Matrix) -> list[int]:
        """The mode from each row on."""
        places = np.searchsorted(self.times, rows, side="right")
        listed = (self.first, *self.modes)
        return [listed[k] for k in places.tolist()]


def mode_times(
    modes: Sequence[Mode],
    dwell: str | float | Sequence[float],
    until: float,
    rng: np.random.Generator,
) -> ModeTimes:
    """Changes of mode from t = 0, where the first mode of the problem begins.

    dwell: random or shortest stays; successors are random. InputError for anything else.
    """
    if dwell not in ("random", "shortest"):
        raise InputError(f"dwell must be random or shortest for modes; got {dwell!r}.")
    spans = spans_of(modes)
    names = [span.name for span in spans]
    t, mode, times, listed = 0.0, 0, list[float](), list[int]()
    while spans[mode].successors:
        low, high = spans[mode].every.tolist()
        top = high if math.isfinite(high) else max(3 * low, until / 10)
        t = round(t + (low if dwell == "shortest" else float(rng.uniform(low, top))), 12)
        if t > until:
            break
        if len(times) > _MOST_CHANGES:
            raise InputError(
                f"until = {until:g} makes more than {_MOST_CHANGES:g} changes of mode."
            )
        mode = names.index(str(rng.choice(spans[mode].successors)))
        times.append(t)
        listed.append(mode)
    return ModeTimes(0, np.array(times), tuple(listed))


def longest_stay(modes: Sequence[Mode]) -> float:
    """The longest finite end of a stay: what a default simulation lasts for."""
    return max(end for mode in modes for end in mode.every if math.isfinite(end))
