"""What observers with bounds of the state have in common: columns, first bounds, whole records."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.errors import InputError
from obsdesign.runtime.base import Batch, State, Stepped, collect, first_time, rows_of


class BoundObserver(Stepped[State]):
    """A kind says how many states there are, how bounds begin, and what moves them."""

    kind: ClassVar[str] = "interval"

    @property
    @abstractmethod
    def n(self) -> int:
        """Number of states."""

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, x1_hi, ..."""
        return tuple(f"x{i + 1}_{end}" for i in range(self.n) for end in ("lo", "hi"))

    @abstractmethod
    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> State:
        """State at time t from bounds of x(t), before the first sample and its jump.

        ValueError if a lower bound exceeds its upper one or a bound is not finite.
        """

    def start(self, t: float, initial: Sequence[float] | None) -> State:
        """State from x1_lo, x1_hi, x2_lo, ...; InputError if they are not bounds."""
        if initial is None or len(initial) != 2 * self.n:
            arrived = "nothing" if initial is None else f"{len(initial)} numbers"
            raise InputError(
                f"--initial must be the {2 * self.n} numbers {','.join(self.names)}; got {arrived}."
            )
        try:
            return self.init(t, lower=initial[0::2], upper=initial[1::2])
        except ValueError as error:
            raise InputError(f"--initial: {error}") from None

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
    ) -> Batch:
        """The whole record at once: a loop over `step` from bounds of x at its first row."""
        times = np.asarray(t, dtype=np.float64)
        state = self.init(first_time(times), lower=lower, upper=upper)
        return collect(self.run(state, rows_of(times, y, u, w, jump)))
