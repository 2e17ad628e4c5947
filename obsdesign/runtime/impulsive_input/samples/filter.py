"""A Kalman filter from sample to sample without process noise, and what each sample told it.

Between impulses this is the observer of operator `samples`. The innovations of the filter, scaled
by their deviations, are the samples of a window made white; so whatever is asked of a window
follows from them, in time proportional to its samples.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Vector
from obsdesign.runtime.flow_response import responses
from obsdesign.runtime.step_cache import cached_step

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Row:
    """One row: time, measurement (None: missing), known input from then on, deviations (p,)."""

    t: float
    y: Vector | None
    u: Vector
    spread: Vector


@dataclass(frozen=True, slots=True)
class Filtered:
    """The filter at a row, its sample used: x (n,), P (n, n), and how the row was reached.

    factor (n, n): P = factor factor', which no rounding makes indefinite, however large P was.
    flow (n, n): of an error since the row before; kept (n, n): what the sample leaves of it.
    shown (p, n), surprise (p,): the row of C, and the innovation, over the deviation of the latter.
    """

    row: Row
    x: Vector
    factor: Array
    flow: Array
    kept: Array
    shown: Array
    surprise: Vector

    @property
    def P(self) -> Array:
        """Covariance of x."""
        return np.asarray(self.factor @ self.factor.T)

    @property
    def cost(self) -> float:
        """Square of the scaled innovation."""
        return float(self.surprise @ self.surprise)

    @classmethod
    def given(cls, row: Row, x: Vector, factor: Array) -> Filtered:
        """A filter that begins at a row whose sample was used already."""
        unit = np.eye(len(x))
        return cls(row, x, factor, unit, unit, np.zeros((0, len(x))), np.zeros(0))


@dataclass(frozen=True)
class SampledPlant:
    """The plant as the filter sees it; steps of equal length share their matrices."""

    A: Array
    B: Array
    C: Array
    H: Array
    drift: Vector
    _steps: OrderedDict[float, tuple[Array, Array]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    def step(self, since: float, until: float) -> tuple[Array, Array]:
        """(e^{A h}, its integral over h) for h = until - since."""
        return cached_step(self._steps, until - since, lambda h: responses(self.A, h)[:2])

    def free(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        """The state at `until` from x at t, input u held, no impulse."""
        if until <= t:
            return x
        flow, once = self.step(t, until)
        return np.asarray(flow @ x + once @ (self.B @ u + self.drift))

    def start(self, t: float, x: Vector, factor: Array, u: Vector, row: Row) -> Filtered:
        """The filter at its first row, from a guess x of covariance factor factor' at time t."""
        flow = self.step(t, row.t)[0] if row.t > t else np.eye(len(x))
        return self._used(row, self.free(t, x, u, row.t), flow @ factor, flow)

    def after(self, before: Filtered, row: Row, jump: Vector | None = None) -> Filtered:
        """The filter at the next row; `jump` is added to the state just before that row."""
        since = before.row
        flow, once = self.step(since.t, row.t)
        x = flow @ before.x + once @ (self.B @ since.u + self.drift)
        x = x if jump is None else x + jump
        return self._used(row, x, flow @ before.factor, flow)

    def along(self, first: Filtered, rows: Iterable[Row]) -> list[Filtered]:
        """The filter at each of the rows that follow `first`."""
        found, at = [], first
        for row in rows:
            at = self.after(at, row)
            found.append(at)
        return found

    def _used(self, row: Row, x: Vector, factor: Array, flow: Array) -> Filtered:
        """After the sample of a row: the array form of the filter, an orthogonal transformation.

        Kailath, Sayed, Hassibi, Linear Estimation, section 12.3: no difference of covariances.
        """
        n, p = len(x), len(self.C)
        if row.y is None:
            return Filtered(row, x, factor, flow, np.eye(n), np.zeros((0, n)), np.zeros(0))
        array = np.block([[np.diag(row.spread), self.C @ factor], [np.zeros((n, p)), factor]])
        lower = triangular(array)
        S, gain = lower[:p, :p], lower[p:, :p]
        miss = row.y - self.C @ x
        white = np.linalg.solve(S, np.column_stack([self.C, miss]))
        return Filtered(
            row, x + gain @ white[:, -1], lower[p:, p:], flow, np.eye(n) - gain @ white[:, :-1],
            white[:, :-1], white[:, -1],
        )  # fmt: skip


def triangular(columns: Array) -> Array:
    """Lower triangular L (n, n) with L L' = M M' for M (n, m), its diagonal not negative."""
    L = np.asarray(np.linalg.qr(columns.T, mode="r")).T
    return np.asarray(L * np.where(np.diag(L) < 0, -1.0, 1.0))


def square_root(P: Array) -> Array:
    """F (n, n) with F F' = P for a covariance P, of units as different as they may be."""
    sizes = np.sqrt(np.diag(P))
    sizes = np.where(sizes > 0, sizes, 1.0)
    values, vectors = np.linalg.eigh(P / sizes / sizes[:, None])
    return np.asarray(sizes[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
