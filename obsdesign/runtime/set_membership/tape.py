"""The tape: stages that bounds look back at, and what a measurement alone makes of a box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT
from obsdesign.runtime.boxes import BoundsFault
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.status import Reason

# beside the narrowest one, a box of which the search for multipliers resolves nothing
_WIDE = 1e6
_MOST_NAMED = 8


class Tape(NamedTuple):
    """Stages, oldest first; start and box (2, n): bounds before the first and after the last."""

    start: Matrix
    stages: tuple[Stage, ...]
    box: Matrix

    @staticmethod
    def beginning(box: Matrix) -> Tape:
        """A tape without stages."""
        return Tape(box, (), box)

    def within(self, box: Matrix) -> Tape | None:
        """The tape, its last box cut with another (2, n); None if that is empty."""
        cut = intersection(self.box, box)
        if (cut[0] > cut[1]).any():
            return None
        last = tuple(stage._replace(box=cut) for stage in self.stages[-1:])
        return Tape(self.start if last else cut, (*self.stages[:-1], *last), cut)

    @property
    def sampled(self) -> tuple[float, ...]:
        """Times of all its measurements."""
        return tuple(stage.t for stage in self.stages if stage.strip is not None)

    def before_idle(self, stage: Stage) -> Tape | None:
        """The tape before its last stage, where a flow goes on without a sample in between.

        None where it does not, or where the time before the last stage is not known.
        """
        if len(self.stages) < 2 or not stage.continues(self.stages[-1]):
            return None
        return Tape(self.start, self.stages[:-1], self.stages[-2].box)

    def widest_place(self) -> tuple[int, float] | None:
        """The first stage, -1 the start, behind which the state was uselessly wide; None if none.

        With its width, beside the narrowest box or the size of the state now.
        """
        boxes = np.array([self.start, *(stage.box for stage in self.stages)])
        with np.errstate(invalid="ignore"):
            widths = (boxes[:, 1] - boxes[:, 0]).max(axis=1)
            limit = max(_WIDE * widths.min(), np.abs(boxes[-1]).max())
        spreads = [float(widths[0]), *(stage.spread for stage in self.stages[:-1])]
        for k, spread in enumerate(spreads):
            if not spread <= limit or spread == np.inf:
                return k - 1, spread
        return None


class Contradiction(NamedTuple):
    """Samples, the times of which are listed, that model, bounds and start box exclude together."""

    times: tuple[float, ...]

    @property
    def reason(self) -> Reason:
        """The reason of bounds that crossed, with the samples that prove the contradiction."""
        times = [f"{t:.9g}" for t in self.times]
        if len(times) > _MOST_NAMED:
            times = [*times[:3], "...", *times[-3:]]
        samples = f"samples at {' '.join(times)}" if times else "no sample"
        text = f"{BoundsFault.CROSSED}: {samples} contradict plant and declared bounds"
        return Reason(text, BoundsFault.CROSSED)


def intersection(first: Matrix, second: Matrix) -> Matrix:
    """The intersection of two boxes, possibly crossed."""
    return np.stack([np.maximum(first[0], second[0]), np.minimum(first[1], second[1])])


def strip_cut(box: Matrix, C: Matrix, strip: Matrix) -> Matrix | None:
    """The box around the part of a box with C z in the strip (2, p); None if it is empty."""
    n, blind = C.shape[1], ~C.any(axis=1)  # outputs that see nothing: zero but for noise
    if (strip[0][blind] > 0).any() or (strip[1][blind] < 0).any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        # C_ri z_i <= high_r - sum over j != i of the least C_rj z_j
        ends = np.where(C == 0, 0.0, C * box[:, None, :])
        low, high = ends.min(axis=0), ends.max(axis=0)
        own = np.eye(n, dtype=bool)

        def others(values: Matrix) -> Matrix:
            """Sums over j != i, (p, n); an unbounded z_i leaves the bounds of z_i itself."""
            return np.asarray(np.where(own, 0.0, values[:, None, :]).sum(axis=2))

        size = others(np.maximum(np.abs(low), np.abs(high))) + np.abs(strip).max(axis=0)[:, None]
        pad = (2 * n + 12) * UNIT * size + TINY
        top = strip[1][:, None] - others(low) + pad
        bottom = strip[0][:, None] - others(high) - pad
        lower = np.where(C > 0, bottom, top) / C
        upper = np.where(C > 0, top, bottom) / C
    # no bound where C is zero, or from a box that is not finite
    lower = np.where((C == 0) | np.isnan(lower), -np.inf, np.nextafter(lower, -np.inf))
    upper = np.where((C == 0) | np.isnan(upper), np.inf, np.nextafter(upper, np.inf))
    strips = np.stack([lower.max(axis=0), upper.min(axis=0)])
    result = intersection(box, strips)
    return None if (result[0] > result[1]).any() else result
