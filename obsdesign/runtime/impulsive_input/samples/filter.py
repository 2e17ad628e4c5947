"""Kalman filter from sample to sample without process noise, with its innovations.

Between impulses this is the observer of operator `samples`. The innovations of the filter, scaled
by their deviations, are the samples of a window made white; all statistics of a window
follow from them, in time proportional to its samples.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np

from obsdesign.equations.gains import Array
from obsdesign.runtime.base import Vector
from obsdesign.runtime.flow_response import responses
from obsdesign.runtime.step_cache import cached_step


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

    flow (n, n): of an error since the row before; kept (n, n): what the sample leaves of it.
    shown (p, n), innovation (p,): rows of C and the innovation, over the deviation of the latter.
    """

    row: Row
    x: Vector
    P: Array
    flow: Array
    kept: Array
    shown: Array
    innovation: Vector

    @property
    def cost(self) -> float:
        """Square of the scaled innovation."""
        return float(self.innovation @ self.innovation)

    @classmethod
    def from_posterior(cls, row: Row, x: Vector, P: Array) -> Filtered:
        """A filter that begins at a row whose sample was used already."""
        unit = np.eye(len(x))
        return cls(
            row=row, x=x, P=P, flow=unit, kept=unit,
            shown=np.zeros((0, len(x))), innovation=np.zeros(0),
        )  # fmt: skip


@dataclass(frozen=True)
class SampledPlant:
    """The plant of the filter; steps of equal length share their matrices."""

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

    def start(self, t: float, x: Vector, P: Array, u: Vector, row: Row) -> Filtered:
        """The filter at its first row, from a guess x of covariance P at time t."""
        flow = self.step(t, row.t)[0] if row.t > t else np.eye(len(x))
        return self._used(row, self.free(t, x, u, row.t), flow @ P @ flow.T, flow)

    def after(self, before: Filtered, row: Row, jump: Vector | None = None) -> Filtered:
        """The filter at the next row; `jump` is added to the state just before that row."""
        since = before.row
        flow, once = self.step(since.t, row.t)
        x = flow @ before.x + once @ (self.B @ since.u + self.drift)
        x = x if jump is None else x + jump
        return self._used(row, x, flow @ before.P @ flow.T, flow)

    def _used(self, row: Row, x: Vector, P: Array, flow: Array) -> Filtered:
        unit = np.eye(len(x))
        if row.y is None:
            return Filtered(
                row=row, x=x, P=P, flow=flow, kept=unit,
                shown=np.zeros((0, len(x))), innovation=np.zeros(0),
            )  # fmt: skip
        R, CP = np.diag(row.spread**2), self.C @ P
        S, residual = CP @ self.C.T + R, row.y - self.C @ x
        gain = np.linalg.solve(S, CP).T
        kept = unit - gain @ self.C
        P = kept @ P @ kept.T + gain @ R @ gain.T  # Joseph's form: stays positive
        white = np.linalg.solve(np.linalg.cholesky(S), np.column_stack([self.C, residual]))
        return Filtered(
            row=row,
            x=x + gain @ residual,
            P=(P + P.T) / 2,
            flow=flow,
            kept=kept,
            shown=white[:, :-1],
            innovation=white[:, -1],
        )
