"""One step of a plant, enclosed: its matrices, their rounding, and the comparison system."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, expm, powers, raised
from obsdesign.equations.finite_time.gains import FiniteTimeGains

# parts of a step, by the norm of A times their length
_PART, _MOST_PARTS = 0.25, 2.0**14


@dataclass(frozen=True)
class FlowMaps:
    """One step: e^{A h}, int e^{A s} ds, their errors; how a radius grows, and what Delta adds.

    inputs: number of known inputs, whose sum B u is rounded.
    """

    flow: Matrix
    once: Matrix
    flow_error: Matrix
    once_error: Matrix
    growth: Matrix
    inflow: Matrix
    inputs: int = 0

    def error(self, x: Matrix, forced: Matrix) -> Matrix:
        """Bound of the rounding in flow @ x + once @ (B u + b_mid), matrices included.

        forced: |B| |u| + |b_mid|, as terms that cancel are rounded too.
        """
        terms = 2 * len(x) + self.inputs + 4
        size = np.abs(x)
        rounding = np.abs(self.flow) @ size + np.abs(self.once) @ forced
        total = self.flow_error @ size + self.once_error @ forced + terms * UNIT * rounding
        return raised(total, terms)

    def carried(self, error: Matrix) -> Matrix:
        """Bound of |e^{A h}| error."""
        with np.errstate(over="ignore", invalid="ignore"):
            bound = raised(self.growth @ error, len(error))
        return np.where(np.isnan(bound), np.inf, bound)

    def spread(self, radius: Matrix) -> Matrix:
        """Bound of |e^{A h}| rho + int |e^{A s}| ds Delta, the radius after the step."""
        if not np.isfinite(radius).all():
            return np.full_like(radius, np.inf)
        with np.errstate(over="ignore"):  # an overflow is no bound
            return raised(self.growth @ radius + self.inflow, 2 * len(radius))


def flow_maps(gains: FiniteTimeGains, h: float, error: float) -> FlowMaps:
    """Matrices of a step of length h, known to `error`."""
    A = gains.A
    n = len(A)
    Delta = raised((gains.flow_upper - gains.flow_lower) / 2, 1)
    whole = _enclosed(A, np.eye(n), h, error)
    growth, inflow = _compared(A, Delta, h, error)
    # the comparison system forgets signs, and with them how fast coupled modes decay
    growth = np.fmin(growth, whole.magnitude[:n, :n])
    return FlowMaps(
        whole.mid[:n, :n], whole.mid[:n, n:], whole.rad[:n, :n], whole.rad[:n, n:],
        growth, np.fmin(inflow, _reach(A, Delta, h, error)), gains.m,
    )  # fmt: skip


def _compared(A: Matrix, Delta: Matrix, h: float, error: float) -> tuple[Matrix, Matrix]:
    """Bound |e^{A h}| and int_0^h |e^{A s}| ds Delta by e^{Mz(A) h} and its integral."""
    n = len(A)
    metzler = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    top = _enclosed(metzler, Delta[:, None], h, error).magnitude[:n]
    return top[:, :n], top[:, n]


def _reach(A: Matrix, Delta: Matrix, h: float, error: float) -> Matrix:
    """Bound int_0^h |e^{A s}| ds Delta by the comparison system over parts of the step."""
    size = float(np.abs(A).sum(axis=1).max(initial=0.0)) * h
    if not (np.any(Delta) and size < _MOST_PARTS):
        return np.full(len(A), np.inf) if np.any(Delta) else Delta
    parts = 1 << max(0, math.ceil(math.log2(max(size / _PART, 1.0))))
    step = expm(Enclosure.exactly(A).scaled(h / parts, error / parts))
    inflow = _compared(A, Delta, h / parts, error / parts)[1]
    with np.errstate(over="ignore", invalid="ignore"):
        total = powers(step, parts).magnitude.sum(axis=0) @ inflow
    return raised(np.where(np.isnan(total), np.inf, total), parts + len(A))


def _enclosed(A: Matrix, inflow: Matrix, h: float, error: float) -> Enclosure:
    n, m = len(A), inflow.shape[1]
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, inflow
    return expm(Enclosure.exactly(block).scaled(h, error))
