"""Where an observer stands between two parts of a record."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.runtime.base import Row, Sample, Vector, samples_of
from obsdesign.runtime.bounds import Bounds
from obsdesign.runtime.columns import Columns
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


class InForce(NamedTuple):
    """What holds until a row changes it: u (m,), bounds (lower, upper) of b, the mode.

    since: time of the last change; b: None as declared, is_narrowed: was it ever narrower?
    """

    since: float = -math.inf  # up to the last row, which a delayed observer's state is before
    u: Inputs | None = None
    b: tuple[Vector, Vector] | None = None
    mode: str | None = None
    is_narrowed: bool = False

    def following(self, sample: Sample) -> InForce:
        """What holds from a row on; this itself if the row changes nothing."""
        pair = None if sample.bounds is None else sample.bounds.b
        if sample.u is None and sample.mode is None and pair is None and self.b is None:
            return self
        u = self.u if sample.u is None else np.asarray(sample.u, float)
        b = None if pair is None else (np.asarray(pair[0], float), np.asarray(pair[1], float))
        mode = self.mode if sample.mode is None else sample.mode
        pairs = ((u, self.u), (b, self.b))
        if mode == self.mode and all(np.array_equal(_table(x), _table(old)) for x, old in pairs):
            return self
        return InForce(float(sample.t), u, b, mode, self.is_narrowed or b is not None)

    def behind(self, record: Columns) -> InForce:
        """What holds behind rows of t, y, u, w and jumps alone: that of `following` in turn."""
        first = self.following(next(samples_of(record)))
        if record.u is None:
            return first
        changes = np.flatnonzero((record.u[1:] != record.u[:-1]).any(axis=1)) + 1
        if not changes.size:
            return first
        last = int(changes[-1])
        return first._replace(since=float(record.t[last]), u=record.u[last])

    def is_changed_by(self, sample: Sample) -> bool:
        """Is something else in force behind an earlier row than without it, as far as is known?"""
        if sample.t >= self.since:
            return self.following(sample) is not self
        return sample.u is not None or sample.mode is not None or self.is_narrowed


def _table(values: Value) -> Matrix:
    """Values as an array; an empty one for None."""
    return np.zeros(0) if values is None else np.asarray(values, float)


@dataclass(frozen=True)
class Progress:
    """The state of an observer, and rows (t, y, u) since then that are taken again.

    state: None before the first row, which begins with the numbers `initial`. given: number of
    estimates of these rows that were written already. late: rows behind them that an earlier one
    may still precede, in the order of time; now: time of the last arrival. left_out: was a row left
    out on which bounds depend? in_force: what holds behind the last row that was taken.
    """

    state: Value
    waiting: tuple[Row, ...] = ()
    given: int = 0
    late: tuple[WaitingRow, ...] = ()
    now: float = -math.inf
    initial: tuple[float, ...] | None = None
    left_out: bool = False
    in_force: InForce = field(default_factory=InForce)
    first: float = math.inf

    @property
    def t(self) -> float:
        """Time of the last row that the observer has taken; -inf without any."""
        if self.state is None:
            return -math.inf
        return float(self.waiting[-1][0] if self.waiting else self.state.t)
