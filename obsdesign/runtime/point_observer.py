"""Common part of observers with a point estimate: columns and initial states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import numbered
from obsdesign.equations.gains import Gains
from obsdesign.errors import InputError
from obsdesign.runtime.base import Estimate, Sample, State, Stepped, centred_measurement, later
from obsdesign.runtime.columns import Event, axis_sizes


class Timed(Protocol):
    """A state that knows its time, and whether a sample was taken."""

    @property
    def t(self) -> float:
        """Time of the last sample, or of the start."""

    @property
    def started(self) -> bool:
        """Was a sample taken?"""


TimedState = TypeVar("TimedState", bound=Timed)


class PointObserver(ABC, Generic[State]):
    """Frozen parameters `gains`; a kind defines `init` and how a state is updated."""

    gains: Gains

    @property
    def n(self) -> int:
        """Number of states."""
        return self.gains.n

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes: n states, p outputs, m known inputs, and y of a row."""
        return axis_sizes(self.n, self.reads)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return numbered("x", self.n)

    @property
    def reads(self) -> dict[str, int | bool]:
        """Numbers of y, u and w in a sample, and whether jumps are reported."""
        return self.gains.columns

    @property
    def event_names(self) -> tuple[str, ...]:
        """Columns of an event file; none where the kind has no events."""
        return ()

    def event_cells(self, event: Event) -> Sequence[float | str]:
        """Cells of an event in an event file; TypeError where the kind has no events."""
        raise TypeError(f"{type(self).__name__} has no events; got {event!r}")

    @abstractmethod
    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> State:
        """State at time t from a guess of x(t), before the first sample."""

    def start(self, t: float, initial: Sequence[float] | None) -> State:
        """State from x1, ..., xn, or as `init` has it; InputError unless n finite numbers."""
        if initial is not None and (len(initial) != self.n or not np.isfinite(initial).all()):
            names = ",".join(self.names[: self.n])
            raise InputError(
                f"--initial must be the {self.n} finite numbers {names}; got {len(initial)} "
                "numbers."
            )
        return self.init(t, x=None if initial is None else list(initial))


class SteppedObserver(PointObserver[TimedState], Stepped[TimedState]):
    """One estimate for every sample."""

    @abstractmethod
    def advance(
        self, state: TimedState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[TimedState, Estimate]:
        """The state and the estimate at t; y: less the middle of its noise, None if missing."""

    def step(self, state: TimedState, sample: Sample) -> tuple[TimedState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        t = later(sample, state.t, state.started)
        y = centred_measurement(sample.y, self.gains)
        with np.errstate(over="ignore", invalid="ignore"):  # the status names what is not finite
            return self.advance(state, t, y, sample)
