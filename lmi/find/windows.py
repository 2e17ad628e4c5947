"""Windows of dwell times that a matrix P may depend on, and which can follow each other.

Offset -1 is the dwell time that has just passed, 0 the one about to start (the theta of the next
map), 1 the one after it. A window gives every offset an interval; all windows together divide the
set of all dwell-time sequences. They are built by bisecting one offset of one window at a time.

From window w the sequence may move on to w' when for every j the inside of I_w(j) meets that of
I_w'(j - 1). The next theta then lies in I_w(0) and in I_w'(-1): the range of that edge.
Ends are floats that stand for themselves; they are compared without tolerance. The verifier
(`lmi.prove.windows_proof`) has its own code for all of this.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix


@dataclass(frozen=True)
class Cutting:
    """One window is cut in two at `where`, in one of its offsets."""

    window: int
    offset: int
    where: float


@dataclass(frozen=True)
class Links:
    """Edges between windows: sources, targets, ranges (k,), and the combined intervals.

    lower, upper: (k, offsets + 1), for offsets `first` and up, seen from the source.
    """

    source: Indices
    target: Indices
    low: Matrix
    high: Matrix
    lower: Matrix
    upper: Matrix


@dataclass(frozen=True)
class Windows:
    """low, high: the range of all dwell times; lower, upper: (windows, offsets) intervals.

    Columns are the offsets first, first + 1, ...; first <= 0 <= first + columns.
    """

    low: float
    high: float
    first: int
    lower: Matrix
    upper: Matrix

    def __len__(self) -> int:
        return len(self.lower)

    @property
    def past_last(self) -> int:
        """One more than the last offset that has a column."""
        return self.first + int(self.lower.shape[1])

    def interval(self, window: int, offset: int) -> tuple[float, float]:
        """The interval of a window at any offset."""
        k = offset - self.first
        if not 0 <= k < self.lower.shape[1]:
            return self.low, self.high
        return float(self.lower[window, k]), float(self.upper[window, k])

    def knows(self, offset: int) -> NDArray[np.bool_]:
        """Which windows restrict this offset."""
        k = offset - self.first
        if not 0 <= k < self.lower.shape[1]:
            return np.zeros(len(self), dtype=bool)
        restricted: NDArray[np.bool_] = (self.lower[:, k] > self.low) | (
            self.upper[:, k] < self.high
        )
        return restricted

    def depths(self, window: int) -> tuple[int, int]:
        """Numbers of dwell times back and ahead that this window constrains."""
        row = (self.lower[window] > self.low) | (self.upper[window] < self.high)
        offsets = np.flatnonzero(row) + self.first
        return -int(offsets.min(initial=0)), int(offsets.max(initial=-1)) + 1

    def reaching(self, first: int, past_last: int) -> Windows:
        """The same windows, with columns for at least these offsets."""
        before, after = max(self.first - first, 0), max(past_last - self.past_last, 0)
        sides = ((0, 0), (before, after))
        lower = np.pad(self.lower, sides, constant_values=self.low)
        upper = np.pad(self.upper, sides, constant_values=self.high)
        return Windows(self.low, self.high, self.first - before, lower, upper)

    def cut(self, cuttings: Sequence[Cutting]) -> tuple[Windows, Indices]:
        """Windows after cutting (each at most once), and the old window of each new one."""
        offsets = [cutting.offset for cutting in cuttings]
        wide = self.reaching(min(offsets), max(offsets) + 1)
        rows, columns = [cutting.window for cutting in cuttings], np.array(offsets) - wide.first
        where = np.array([cutting.where for cutting in cuttings])
        lower = np.concatenate([wide.lower, wide.lower[rows]])
        upper = np.concatenate([wide.upper, wide.upper[rows]])
        upper[rows, columns] = where
        lower[len(self) + np.arange(len(rows)), columns] = where
        parents = np.concatenate([np.arange(len(self)), rows])
        return Windows(self.low, self.high, wide.first, lower, upper), parents

    def links(self, jitter: float = math.inf) -> Links:
        """All edges; jitter: largest change from one dwell time to the next."""
        sides = ((0, 0), (0, 1)), ((0, 0), (1, 0))
        lower, upper = (
            (np.pad(self.lower, side, constant_values=self.low) for side in sides),
            (np.pad(self.upper, side, constant_values=self.high) for side in sides),
        )
        (ahead_low, back_low), (ahead_high, back_high) = lower, upper
        low = np.maximum(ahead_low[:, None], back_low[None])
        high = np.minimum(ahead_high[:, None], back_high[None])
        # one dwell time only: nothing can be cut, and the only window follows itself
        meets = (low < high).all(axis=2) | (self.low == self.high)
        source, target = np.nonzero(meets)
        low, high = low[source, target], high[source, target]
        if math.isfinite(jitter):
            kept = np.array([passable(a, b, jitter) for a, b in zip(low, high, strict=True)])
            source, target, low, high = source[kept], target[kept], low[kept], high[kept]
        now = -self.first
        return Links(source, target, low[:, now], high[:, now], low, high)

    def document(self, window: int) -> dict[str, list[float | str]]:
        """Offset -> interval, as a file holds it: restricted offsets only, infinity as "inf"."""
        return {
            str(offset): [_word(end) for end in self.interval(window, offset)]
            for offset in range(self.first, self.past_last)
            if self.knows(offset)[window]
        }


def _word(end: float) -> float | str:
    return "inf" if math.isinf(end) else end


def passable(lower: Matrix, upper: Matrix, jitter: float) -> bool:
    """Decide exactly whether a sequence with steps up to `jitter` fits these intervals."""
    step = Fraction(jitter)
    low, high = _fraction(lower[0]), _fraction(upper[0])
    for a, b in zip(lower[1:], upper[1:], strict=True):
        low, high = max(low - step, _fraction(a)), min(high + step, _fraction(b))
        if not low < high and not (a == b and low <= high):
            return False
    return True


def _fraction(end: float) -> Fraction | float:
    return end if math.isinf(end) else Fraction(float(end))


def whole(low: float, high: float) -> Windows:
    """The one window that restricts nothing: a common P."""
    none = np.zeros((1, 0))
    return Windows(low, high, 0, none, none)
