"""One step of a plant, enclosed: its matrices, their rounding, and the comparison system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.enclosure import UNIT, Enclosure, expm, raised
from obsdesign.runtime.base import Vector


@dataclass(frozen=True)
class FlowMaps:
    """One step: e^{A h}, int e^{A s} ds, their errors, and the comparison system of a radius."""

    flow: Vector
    once: Vector
    flow_error: Vector
    once_error: Vector
    growth: Vector
    inflow: Vector

    def error(self, x: Vector, forced: Vector) -> Vector:
        """Bound of the rounding in flow @ x + once @ forced, matrices included."""
        terms = 2 * len(x) + 4
        size, push = np.abs(x), np.abs(forced)
        rounding = np.abs(self.flow) @ size + np.abs(self.once) @ push
        total = self.flow_error @ size + self.once_error @ push + terms * UNIT * rounding
        return raised(total, terms)

    def spread(self, radius: Vector) -> Vector:
        """Radius after the step: rho' = Mz(A) rho + Delta bounds every path's distance."""
        if not np.isfinite(radius).all():
            return np.full_like(radius, np.inf)
        return raised(self.growth @ radius + self.inflow, 2 * len(radius))


def flow_maps(gains: Mapping[str, Any], h: float, error: float) -> FlowMaps:
    """Matrices of a step of length h, known to `error`."""
    A = np.asarray(gains["A"])
    n = len(A)
    Delta = (gains["flow_upper"] - gains["flow_lower"]) / 2
    metzler = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    whole = _enclosed(A, np.eye(n), h, error)
    compared = _enclosed(metzler, raised(Delta, 1)[:, None], h, error)
    top = compared.magnitude[:n]
    return FlowMaps(
        whole.mid[:n, :n], whole.mid[:n, n:], whole.rad[:n, :n], whole.rad[:n, n:],
        top[:, :n], top[:, n],
    )  # fmt: skip


def _enclosed(A: Vector, inflow: Vector, h: float, error: float) -> Enclosure:
    n, m = len(A), inflow.shape[1]
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, inflow
    return expm(Enclosure.exactly(block).scaled(h, error))
