"""Maps of whole steps of discrete time, for the tables of a multiplier observer.

    z+ = A^k z + (I + A + ... + A^(k-1)) known + sum over the steps of A^i b w,   i < k

Each step has a w of its own: a piece with its column A^i b alone, as that of a jump. Of more steps
than there is room for, the oldest are taken together in a box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, powers
from obsdesign.equations.set_membership.pattern import MOST_COUNTED
from obsdesign.runtime.clocks.time_grid import power_and_sum, reach
from obsdesign.runtime.set_membership.model import Model


@dataclass(frozen=True)
class CountedStep:
    """A^k, the columns (n, inputs) of what is known, and those of every w, (pieces, n, active)."""

    Phi: Enclosure
    forced: Enclosure
    pieces: Enclosure

    @property
    def generators(self) -> Matrix:
        """The columns side by side, (n, pieces * active)."""
        return self.pieces.mid.transpose(1, 0, 2).reshape(self.pieces.mid.shape[1], -1)


def counted_step(model: Model, count: int) -> CountedStep:
    """The map of so many steps, count >= 1."""
    A, b = Enclosure.exactly(model.A), model.flow
    entering, known = b.matrix[:, b.active], np.hstack([model.inputs, b.matrix])
    Phi, total = power_and_sum(A, count)
    single = min(count, MOST_COUNTED)
    own = powers(A, single) @ Enclosure.exactly(entering)
    exact_first = Enclosure.exactly(entering[None])
    own = _joined(exact_first, Enclosure(own.mid[1:], own.rad[1:]))
    if count > single:
        before, _ = power_and_sum(A, single)
        own = _joined(own, _box(before.magnitude @ reach(A, count - single, entering)))
    forced = Enclosure.exactly(known) if count == 1 else total @ Enclosure.exactly(known)
    return CountedStep(Phi, forced, own)


def _box(sizes: Matrix) -> Enclosure:
    """Pieces for a box of sizes (n, r): one for each entry, whatever the sign."""
    n = len(sizes)
    return Enclosure.exactly(np.where(np.eye(n, dtype=bool)[:, :, None], sizes[None], 0.0))


def _joined(first: Enclosure, second: Enclosure) -> Enclosure:
    return Enclosure(
        np.concatenate([first.mid, second.mid]), np.concatenate([first.rad, second.rad])
    )
