"""The error of an observer across an event on a surface of states, by who triggers it.

With x+ = G x on the surface s x = const, flows f- before and f+ after it, and the correction
M (y - C x) of the observer, a small error is multiplied by Xi - M C where the observer jumps first
and by Xi + M C where the plant does,

    Xi = G + (f+ - G f-) s / (s f-),

the saltation matrix, and by G - M C at reported times: of two nearby states the one that is later
at the surface by dt = -s e / (s f-) goes on with f- for dt, the other one with f+.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm


class Impact(NamedTuple):
    """Flow A (n, n) and drift b (n,); jump G (n, n), c (n,); normal (n,); state (n,) before it."""

    A: Matrix
    b: Matrix
    G: Matrix
    c: Matrix
    normal: Matrix
    state: Matrix

    @property
    def saltation(self) -> Matrix:
        """Xi (n, n)."""
        before = self.A @ self.state + self.b
        after = self.A @ (self.G @ self.state + self.c) + self.b
        slope = np.outer(after - self.G @ before, self.normal)
        return np.asarray(self.G + slope / float(self.normal @ before))


class Radii(NamedTuple):
    """Spectral radii of the error's map over a flow and an event, by who triggers it."""

    reported: float
    observer_first: float
    plant_first: float

    @classmethod
    def from_gains(cls, impact: Impact, C: Matrix, L: Matrix, M: Matrix, period: float) -> Radii:
        """Those of gains L (n, p) in the flow and M (n, p) at events a period apart."""
        flow, Xi = expm((impact.A - L @ C) * period), impact.saltation
        maps = (impact.G - M @ C, Xi - M @ C, Xi + M @ C)
        return cls(*(float(np.abs(np.linalg.eigvals(each @ flow)).max()) for each in maps))
