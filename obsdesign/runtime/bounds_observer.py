"""Common part of observers with bounds: columns, events and initial states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

from numpy.typing import ArrayLike

from obsdesign.equations.gains import Gains
from obsdesign.runtime.base import State, Stepped
from obsdesign.runtime.boxes import bound_names, stated_bounds
from obsdesign.runtime.columns import axis_sizes


class BoundsObserver(Stepped[State], ABC):
    """Frozen parameters `gains`; a kind defines `init` and `step`."""

    gains: Gains
    finds_events: ClassVar[bool] = True
    event_names: ClassVar[tuple[str, ...]] = ("t", "event")

    @cached_property
    def n(self) -> int:
        """Number of states."""
        return self.gains.n

    @cached_property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        return self.gains.columns

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes: n states, p outputs, m known inputs, and y of a row."""
        return axis_sizes(self.n, self.reads)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, x1_hi, ..."""
        return bound_names(self.n)

    def event_cells(self, event: tuple[float | str, ...]) -> Sequence[float | str]:
        """Cells of an event in an event file."""
        return event

    @abstractmethod
    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> State:
        """State at time t from bounds of x(t), before the first sample and its jump.

        ValueError if a lower bound exceeds its upper one or a bound is not finite.
        """

    def start(self, t: float, initial: Sequence[float] | None) -> State:
        """State from x1_lo, x1_hi, x2_lo, ...; InputError if they are not bounds."""
        lower, upper = stated_bounds(self.n, initial)
        return self.init(t, lower=lower, upper=upper)
