"""What observers with a point estimate have in common: columns, initial states, whole records."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Generic

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.errors import InputError
from obsdesign.runtime.base import (
    Batch,
    State,
    Stepped,
    collect,
    columns_read,
    first_time,
    rows_of,
)


class PointObserver(ABC, Generic[State]):
    """Frozen parameters `gains`; a kind says how a state begins, and what moves it."""

    gains: Mapping[str, Any]

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.gains["A"])

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return tuple(f"x{i + 1}" for i in range(self.n))

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        return columns_read(self.gains)

    @abstractmethod
    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> State:
        """State at time t from a guess of x(t), before the first sample."""

    def start(self, t: float, initial: Sequence[float] | None) -> State:
        """State from x1, ..., xn, or as `init` has it; InputError unless n finite numbers."""
        if initial is not None and (len(initial) != self.n or not np.isfinite(initial).all()):
            names = ",".join(f"x{i + 1}" for i in range(self.n))
            raise InputError(
                f"--initial must be the {self.n} finite numbers {names}; got {len(initial)} "
                "numbers."
            )
        return self.init(t, x=None if initial is None else list(initial))


class SteppedObserver(PointObserver[State], Stepped[State]):
    """One estimate for every sample, and a record is a loop over `step`."""

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        x: ArrayLike | None = None,
    ) -> Batch:
        """The whole record at once: a loop over `step` from a guess of x at its first row."""
        times = np.asarray(t, dtype=np.float64)
        state = self.init(first_time(times), x=x)
        return collect(self.run(state, rows_of(times, y, u, w, jump)))
