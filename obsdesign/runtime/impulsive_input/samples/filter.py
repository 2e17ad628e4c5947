"""Kalman filter from sample to sample without process noise, with its innovations.

Between impulses this is the observer of operator `samples`. The innovations of the filter, scaled
by their deviations, are the samples of a window made white; all statistics of a window
follow from them, in time proportional to its samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.impulsive_input.plant import HeldPlant
from obsdesign.runtime.state_marks import Axes, Inputs, Outputs, Past, Square, States


@dataclass(frozen=True, slots=True)
class Row:
    """One row: time, measurement (None: missing), known input from then on, deviations (p,).

    A sample of deviation zero, whose noise nothing shows yet, is left out.
    """

    t: Past
    y: Outputs | None
    u: Inputs
    spread: Outputs


@dataclass(frozen=True, slots=True)
class Filtered:
    """The filter at a row, its sample used: x (n,), P (n, n), and how the row was reached.

    factor (n, n): P = factor factor', which no rounding makes indefinite, however large P was.
    flow (n, n): of an error since the row before; kept (n, n): what the sample leaves of it.
    shown (p, n), innovation (p,): rows of C and the innovation, over the deviation of the latter.
    """

    row: Row
    x: States
    factor: Square
    flow: Square
    kept: Square
    shown: Annotated[Matrix, Axes("rows n")]
    innovation: Annotated[Matrix, Axes("rows")]

    @property
    def P(self) -> Matrix:
        """Covariance of x."""
        return np.asarray(self.factor @ self.factor.T)

    @property
    def cost(self) -> float:
        """Square of the scaled innovation."""
        return float(self.innovation @ self.innovation)

    @classmethod
    def without_sample(
        cls, row: Row, x: Matrix, factor: Matrix, flow: Matrix | None = None
    ) -> Filtered:
        """The filter at a row that has no sample, or whose sample was used already."""
        n = len(x)
        return cls(
            row=row,
            x=x,
            factor=factor,
            flow=np.eye(n) if flow is None else flow,
            kept=np.eye(n),
            shown=np.zeros((0, n)),
            innovation=np.zeros(0),
        )


@dataclass(frozen=True, kw_only=True)
class SampledPlant(HeldPlant):
    """The plant of the filter."""

    def start(self, t: float, x: Matrix, factor: Matrix, u: Matrix, row: Row) -> Filtered:
        """The filter at its first row, from a guess x of covariance factor factor' at time t."""
        flow = self.step(row.t - t)[0] if row.t > t else np.eye(len(x))
        return self._used(row, self.free(t, x, self.forcing(u), row.t), flow @ factor, flow)

    def after(self, before: Filtered, row: Row, jump: Matrix | None = None) -> Filtered:
        """The filter at the next row; `jump` is added to the state just before that row."""
        since = before.row
        flow = self.step(row.t - since.t)[0]
        x = self.free(since.t, before.x, self.forcing(since.u), row.t)
        x = x if jump is None else x + jump
        return self._used(row, x, flow @ before.factor, flow)

    def _used(self, row: Row, x: Matrix, factor: Matrix, flow: Matrix) -> Filtered:
        """After the sample of a row: the array form of the filter, an orthogonal transformation.

        Kailath, Sayed, Hassibi, Linear Estimation, section 12.3: no difference of covariances.
        """
        n, p = len(x), len(self.C)
        if row.y is None or not row.spread.all():
            return Filtered.without_sample(row, x, factor, flow)
        array = np.block([[np.diag(row.spread), self.C @ factor], [np.zeros((n, p)), factor]])
        lower = triangular(array)
        S, gain = lower[:p, :p], lower[p:, :p]
        residual = row.y - self.C @ x
        white = np.asarray(np.linalg.solve(S, np.column_stack([self.C, residual])))
        return Filtered(
            row=row,
            x=x + gain @ white[:, -1],
            factor=lower[p:, p:],
            flow=flow,
            kept=np.eye(n) - gain @ white[:, :-1],
            shown=white[:, :-1],
            innovation=white[:, -1],
        )


def triangular(columns: Matrix) -> Matrix:
    """Lower triangular L (n, n) with L L' = M M' for M (n, m), its diagonal not negative."""
    L = np.asarray(np.linalg.qr(columns.T, mode="r")).T
    return np.asarray(L * np.where(np.diag(L) < 0, -1.0, 1.0))
