"""Sets of states that events at uncertain times leave: a box and a curve for each event.

x = x_b + sum_k p_k(eta_k): x_b in a box, p_k(eta) = sum_i curve_k[i] eta^i for some eta in [-1, 1],
which stands for the time of the event. A flow or a jump moves a curve by its own matrix, so that
what is missing in one state stays what another one has too much; a box does not remember that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised
from obsdesign.equations.interval.uncertain_jump import MOST_CURVES, curve_range
from obsdesign.runtime.interval.kernel import crossed
from obsdesign.runtime.state_marks import Bounded


class Spread(NamedTuple):
    """body (2n,): [lower; -upper] of x_b; curves: (d, n) each, oldest first."""

    body: Bounded
    curves: tuple[Matrix, ...] = ()

    def with_curve(self, curve: Matrix) -> Spread:
        """The set with a further curve; the oldest one goes into the box where there are many."""
        curves = (*self.curves, curve)
        if len(curves) <= MOST_CURVES:
            return self._replace(curves=curves)
        return Spread(plus(self.body, ranges(curves[:1])), curves[1:])

    def transported(self, body: Matrix, flow: Enclosure) -> Spread:
        """The set after a linear map of the curves; body: the box after it."""
        if not self.curves:
            return Spread(body)
        after = flow @ Enclosure.exactly(np.concatenate(self.curves).T)
        error = raised(after.rad.sum(axis=1), after.rad.shape[1] + 2)
        curves = np.split(np.ascontiguousarray(after.mid.T), len(self.curves))
        return Spread(_lowered(body, np.concatenate([error, error])), tuple(curves))

    @property
    def box(self) -> Matrix:
        """[lower; -upper] of x."""
        return plus(self.body, ranges(self.curves))

    def outputs(self, C: Matrix) -> tuple[Matrix, Matrix]:
        """Bounds (lower, upper) of C times the curves, (p,) each."""
        low, high = np.zeros(len(C)), np.zeros(len(C))
        for curve in self.curves:
            image = Enclosure.exactly(C) @ Enclosure.exactly(curve.T)
            ends = curve_range(image.mid.T)
            error = image.rad.sum(axis=1)
            low, high = low + (ends[0] - error), high + (ends[1] + error)
        margin = raised(np.maximum(np.abs(low), np.abs(high)) * 1e-13, 2)
        return low - margin, high + margin

    def within(self, box: Matrix) -> Spread | None:
        """The set with x_b cut to what may lead into a box of x; None where nothing can."""
        low, minus_high = np.split(ranges(self.curves), 2)
        cut = plus(box, np.concatenate([minus_high, low]))  # x_b = x - p
        body = np.maximum(self.body, cut)
        return None if crossed(body) else self._replace(body=body)


def ranges(curves: Sequence[Matrix]) -> Matrix:
    """[lower; -upper] of a sum of curves."""
    if not curves:
        return np.zeros(0)
    ends = [np.concatenate([low, -high]) for low, high in map(curve_range, curves)]
    total = ends[0]
    for end in ends[1:]:
        total = plus(total, end)
    return total


def plus(box: Matrix, other: Matrix) -> Matrix:
    """[lower; -upper] of a sum, rounded outward."""
    return np.nextafter(box + other, -np.inf) if other.size else box


def _lowered(box: Matrix, error: Matrix) -> Matrix:
    return np.where(error > 0, np.nextafter(box - error, -np.inf), box)
