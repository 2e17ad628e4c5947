"""Bounds around a finite-time estimate: what disturbance, noise and rounding may do, outwards.

At a sample the state is within `radius` (proved, stored in the design) of the exact estimate. To
that come the stored gains' own rounding, |state_error| |x - w|, the rounding of their product with
the window, and the rounding of w, which acts like small kicks between samples.
"""

from __future__ import annotations

import math
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


@dataclass(frozen=True)
class WindowError:
    """What turns a window into a radius."""

    proved: Vector
    state_error: Vector
    gain_length: Vector
    kicks: Vector
    kept: float

    @classmethod
    def of(cls, gains: Mapping[str, Any]) -> WindowError:
        """kicks = sum_l |R_l| + |G_l| |C|: what errors of w, and of C w, do to the estimate."""
        G, C = np.asarray(gains["window_gain"]), np.asarray(gains["C"])
        n, p = len(gains["A"]), len(C)
        back = expm(Enclosure.exactly(gains["A"]).scaled(-float(gains["period"]))).mid
        R, kicks = np.zeros((n, n)), np.zeros((n, n))
        for j in range(int(gains["samples"])):
            term = G[:, j * p : (j + 1) * p]
            R = R @ back + term @ C
            kicks = kicks + np.abs(R) + np.abs(term) @ np.abs(C)
        state_error = np.asarray(gains["state_error"])
        # what rounding leaves of the recursion is far below this factor
        largest = float(np.abs(state_error).sum(axis=1).max())
        kept = 1.0 / (1.0 - largest) if largest < 0.5 else np.inf
        # sums of squares lose nothing that the factor does not cover
        length = 1.001 * np.abs(G).max(axis=1) * np.sqrt(G.shape[1])
        with np.errstate(over="ignore", invalid="ignore"):
            exact = 1.001 * np.linalg.norm(G, axis=1)
        length = np.where((exact > 1e-140) & (exact < length), exact, length)
        return cls(np.asarray(gains["radius"]), state_error, length, 2.0 * kicks, kept)

    def radius(self, window: Vector, w: Vector, x: Vector, slip: Vector) -> Vector:
        """Bound of |x - state| at a sample."""
        terms = len(window) + 8
        # |G| |window| is below the product of lengths; squares may underflow or overflow
        size = math.sqrt(window.dot(window) + len(window) * 1e-307)
        if not size < math.inf:
            size = float(np.abs(window).sum())
        # every residual y - C w is itself rounded
        rounding = ((terms + 8) * UNIT * size) * self.gain_length
        rounding = rounding + 4 * UNIT * (np.abs(w) + np.abs(x))
        inner = self.proved + rounding + self.kicks @ slip
        away = self.state_error @ (np.abs(x - w) + inner) * self.kept
        return raised(inner + away, terms)
