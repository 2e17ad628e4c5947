"""The centre of a box from row to row, and a bound of what rounding has added to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, raised
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.state import ends_of


@dataclass(frozen=True)
class PathMap:
    """m+ = X [m; y0; y1; u; 1], and r+ = R r + error |[m; y0; y1; u; 1]| for what rounding adds."""

    X: Matrix
    R: Matrix
    error: Matrix

    @classmethod
    def from_map(cls, step: BoxMap) -> PathMap:
        """The map of a step without its disturbance and its noise."""
        X, terms = step.X.mid, 4 * step.X.mid.shape[1] + 8
        return cls(X, step.R, raised(step.X.rad + terms * UNIT * np.abs(X), terms))

    def after(self, path: Matrix, y: Matrix | None, known: Matrix) -> Matrix:
        """[r; m] after the step; y: the measurement at its end, known: u, or w of a jump."""
        n, columns = self.X.shape
        v = np.zeros(columns)
        v[:n], v[-1 - len(known) : -1], v[-1] = path[n:], known, 1.0
        if y is not None:
            v[n + len(y) : n + 2 * len(y)] = y
        added = self.R @ path[:n] + self.error @ np.abs(v)
        return np.concatenate([raised(added, 2 * (n + columns)), self.X @ v])


def around_path(path: Matrix, R: Matrix, g: Matrix, radius: Matrix) -> Matrix:
    """[lower; -upper] of all points within R radius + g of the centre of a path."""
    n = len(radius)
    reach = raised(R @ radius + g, 2 * n)
    return ends_of(np.concatenate([raised(reach + path[:n], 1), path[n:]]))
