"""Graphs of modes: flows that take turns, each for a time in a range of its own.

    x' = F_i x  during a stay in mode i, theta in stays_i;    x+ = G_j x  on entry into mode j

A word is a cycle of (mode, stay), repeated without end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.families import Edge

Stay = tuple[float, float]  # shortest, longest, which may be infinite
StayWord = tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Modes:
    """Modes with the ranges of their stays, and which can follow each other.

    flows: (n, n) exact, each mode's; stays: their ranges; following: modes that can come next;
    entry: (n, n) exact, the map on entry into each mode; names: of the modes, for messages.
    """

    flows: tuple[Exact, ...]
    stays: tuple[Stay, ...]
    following: tuple[tuple[int, ...], ...]
    entry: tuple[Exact, ...]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        """ValueError where ranges are none, or a mode that ends has no other to follow it."""
        for i, (low, high) in enumerate(self.stays):
            if not 0 <= low <= high or math.isinf(low):
                raise ValueError(
                    f"0 <= low <= high is required of stays in mode {self.names[i]}; got "
                    f"[{low}, {high}]"
                )
            if not self.following[i] and math.isfinite(high):
                raise ValueError(f"mode {self.names[i]} ends, and none follows it")

    def __len__(self) -> int:
        return len(self.flows)

    @classmethod
    def from_flows(
        cls,
        flows: Sequence[ArrayLike | Exact],
        stays: Sequence[Stay],
        following: Sequence[Sequence[int]] | None = None,
        entry: Sequence[ArrayLike | Exact | None] | None = None,
        names: Sequence[str] | None = None,
    ) -> Modes:
        """From floats or exact matrices; any other mode can follow, no map on entry by default."""
        numbers = tuple(exact(F) for F in flows)
        count, unit = len(numbers), exact(np.eye(len(numbers[0])))
        after = following or [[j for j in range(count) if j != i] for i in range(count)]
        maps = [None] * count if entry is None else entry
        return cls(
            numbers,
            tuple((float(low), float(high)) for low, high in stays),
            tuple(tuple(own) for own in after),
            tuple(unit if G is None else exact(G) for G in maps),
            tuple(names or (str(i + 1) for i in range(count))),
        )

    def before(self, mode: int) -> tuple[int, ...]:
        """Modes after which this one can come."""
        return tuple(i for i in range(len(self)) if mode in self.following[i])

    def with_stays(self, stays: Sequence[Stay]) -> Modes:
        """The same modes with other ranges of their stays."""
        return replace(self, stays=tuple(stays))

    @property
    def horizons(self) -> tuple[float, ...]:
        """Ends of the ranges of stays, or where an infinite one has nothing left to show."""
        return tuple(
            Edge(to_float(F), np.eye(len(F)), low, high).last
            for F, (low, high) in zip(self.flows, self.stays, strict=True)
        )

    def has_entry_map(self, mode: int) -> bool:
        """Does the state change on entry into this mode?"""
        return not np.array_equal(self.entry[mode], exact(np.eye(len(self.flows[0]))))
