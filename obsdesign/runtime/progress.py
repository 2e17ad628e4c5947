"""Where an observer stands between two parts of a record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Value
from obsdesign.runtime.base import Row, Sample, Vector
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.state_marks import Inputs, Measured, MeasuredRow


class WaitingRow(NamedTuple):
    """A sample as a state file keeps it, with bounds of b, c and v."""

    t: float
    y: MeasuredRow | None
    u: Inputs | None
    w: Measured | None
    jump: bool
    bounds: tuple[tuple[Vector, Vector] | None, ...]
    events: tuple[int, ...]
    received: float | None
    mode: str | None

    @classmethod
    def from_sample(cls, sample: Sample) -> WaitingRow:
        """The row of a sample."""
        y, u, w = (None if x is None else np.asarray(x, float) for x in sample[1:4])
        pairs = tuple(
            None if pair is None else (np.asarray(pair[0], float), np.asarray(pair[1], float))
            for pair in sample.bounds or ()
        )
        return cls(
            float(sample.t),
            y,
            u,
            w,
            sample.jump,
            pairs,
            sample.events,
            sample.received,
            sample.mode,
        )

    @property
    def sample(self) -> Sample:
        """The sample of the row; ValueError where it has more bounds than those of b, c and v."""
        if len(self.bounds) > len(Bounds._fields):
            raise ValueError(f"bounds must be of b, c and v; got {len(self.bounds)} of them.")
        bounds = Bounds(*self.bounds) if self.bounds else None
        return Sample(self.t, self.y, self.u, self.w, self.jump, bounds, self.events, self.received,
                      self.mode)  # fmt: skip


@dataclass(frozen=True)
class Progress:
    """The state of an observer, and rows (t, y, u) since then that are taken again.

    state: None before the first row, which begins with the numbers `initial`. given: number of
    estimates of these rows that were written already. late: rows behind them that an earlier one
    may still precede, in the order of time; now: time of the last arrival. left_out: was a row left
    out that may have held an event or an input?
    """

    state: Value
    waiting: tuple[Row, ...] = ()
    given: int = 0
    late: tuple[WaitingRow, ...] = ()
    now: float = -math.inf
    initial: tuple[float, ...] | None = None
    left_out: bool = False

    @property
    def t(self) -> float:
        """Time of the last row that the observer has taken; -inf without any."""
        if self.state is None:
            return -math.inf
        return float(self.waiting[-1][0] if self.waiting else self.state.t)
