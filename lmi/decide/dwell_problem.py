"""The problem of the shortest or the longest dwell time of a pair."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from lmi.arithmetic.balls import Exact
from lmi.find.splitting import Limits
from lmi.time_budget import TimeBudget
from lmi.window_memory import Memory

Direction = Literal["shortest", "longest"]


def dwell_range(direction: Direction, x: float, kept: float) -> tuple[float, float]:
    """The range (shortest, longest) whose searched end is x, and whose other end is kept."""
    return (x, kept) if direction == "shortest" else (kept, x)


@dataclass(frozen=True)
class DwellProblem:
    """Ranges of dwell times with the end `kept`, the other one as far from it as can be proved.

    F, H: (n, n) exact. direction: which end is searched for. kept: the longest dwell time of the
    ranges where that is the shortest one, else the shortest. accuracy: relative width of the
    bracket. memory, jitter: as in `lmi.decide.stability`.
    """

    F: Exact
    H: Exact
    direction: Direction
    kept: float
    accuracy: float
    memory: Memory
    jitter: float
    budget: TimeBudget

    @property
    def is_shortest(self) -> bool:
        """Is the shortest dwell time searched for, with the longest one kept?"""
        return self.direction == "shortest"

    @property
    def extreme(self) -> float:
        """The end of the largest range there is."""
        return 0.0 if self.is_shortest else math.inf

    @property
    def limits(self) -> Limits:
        """How many dwell times windows may look back and ahead."""
        return Limits.from_memory(self.memory)

    def ends(self, x: float) -> tuple[float, float]:
        """The range (shortest, longest) whose searched end is x."""
        return dwell_range(self.direction, x, self.kept)

    def inward(self, x: float, relative: float) -> float:
        """x moved towards the end that is kept, so far and not past it."""
        if self.is_shortest:
            return min(x * (1 + relative), self.kept)
        return max(x * (1 - relative), self.kept)

    def stepped(self, x: float, step: float) -> float:
        """x moved by a step towards the end that is kept, and not past it."""
        return min(x + step, self.kept) if self.is_shortest else max(x - step, self.kept)
