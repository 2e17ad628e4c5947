"""Point observers of plants with modes: the estimate passes from mode to mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.modes import SwitchedGains
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.luenberger.observer import LuenbergerObserver, LuenbergerState
from obsdesign.runtime.modes import Entry, SwitchedObserver, SwitchedState


class SwitchedPoint(SwitchedState[LuenbergerState]):
    """State of a point observer of modes."""

    inner: LuenbergerState


@dataclass(frozen=True)
class SwitchedPointObserver(SwitchedObserver[LuenbergerState, LuenbergerGains]):
    """Executes a design of kind `luenberger` with modes."""

    gains: SwitchedGains[LuenbergerGains]
    kind: ClassVar[str] = "luenberger"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Entries) -> SwitchedPointObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(SwitchedGains.from_document(gains, LuenbergerGains))

    @cached_property
    def observers(self) -> tuple[LuenbergerObserver, ...]:
        """One observer for each mode."""
        return tuple(map(self._observer, self.gains.gains))

    def _observer(self, gains: LuenbergerGains) -> LuenbergerObserver:
        """The observer of one mode, or of an event in it."""
        return LuenbergerObserver(gains)

    def _at_same_time(self, inner: LuenbergerState) -> LuenbergerState:
        """The state of an observer, from which a row of the same time may follow."""
        return inner._replace(started=False, is_usual=False)

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> SwitchedPoint:
        """State at time t from a guess of x(t), before the first sample and its mode."""
        inner = self.observers[0].init(t, x=x)
        return SwitchedPoint(t, inner, guards=self._named.first_guards())

    def start(self, t: float, initial: Sequence[float] | None) -> SwitchedPoint:
        """State from x1, ..., xn; InputError unless n finite numbers."""
        inner = self.observers[0].start(t, initial)
        return SwitchedPoint(t, inner, guards=self._named.first_guards())

    def _entered(
        self, inner: LuenbergerState, estimate: Estimate, before: int, after: int
    ) -> Entry[LuenbergerState]:
        """The estimate in the new mode: the same, or that of the map on entry."""
        y = inner.y if self.keeps_measurement(before, after) else None
        G = self.gains.gains[after].G
        x = inner.x if G is None else np.asarray(G @ inner.x)
        return Entry(inner._replace(x=x, y=y, is_usual=False), estimate._replace(x=x))
