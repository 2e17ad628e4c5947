"""Bounds around a finite-time estimate: what disturbance, noise and rounding may do, outwards.

At a sample the state is within `radius` (proved, stored in the design) of the exact estimate. To
that come the stored gains' own rounding, |state_error| |x - w| (now, or at the window's start where
the design says so), the rounding of their product with
the window, and the rounding of w, which acts like small kicks between samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.enclosure import UNIT, Enclosure, expm, powers, raised
from lmi.arithmetic.exponential import expm as plain_expm
from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import Vector
from obsdesign.runtime.finite_time.flow_maps import flow_maps


@dataclass(frozen=True)
class StartError:
    """Bias against x(t_i - T): the window itself tells how far that is from w.

    per_level (n,): |bias| where |x(t_i - T) - w| is one unit of the window; it is at most
    of_length |window| + of_noise + of_slip @ slip.
    """

    per_level: Vector
    of_length: float
    of_noise: float
    of_slip: Vector
    last: Enclosure  # e^{A T}

    @classmethod
    def of(cls, gains: Mapping[str, Any], rows: Enclosure) -> StartError:
        """rows: C A_d^j; X with X rows = I up to E inverts them, |X r| + |E| e bounds e."""
        A, C, k = gains["A"], gains["C"], int(gains["samples"])
        n = len(A)
        units = equations.state_scales(A, C, k * float(gains["period"]))
        X = equations.least_squares_gain(rows.mid, np.ones(len(rows.mid)))
        missed = (Enclosure.exactly(X) @ rows - Enclosure.exactly(np.eye(n))).magnitude
        scaled = raised(np.abs(X) / units[:, None], 1)
        left = float((missed * units / units[:, None]).sum(axis=1).max())
        kept = 1.01 / (1.0 - left) if left < 0.5 else np.inf
        inflow = flow_maps(gains, float(gains["period"]), 0.0).inflow
        with np.errstate(over="ignore", invalid="ignore"):
            # what a kick in one of the periods before has become: sum_(l<j) |C A_d^l|
            seen = rows.magnitude.reshape(k, -1, n)
            summed = np.cumsum(seen, axis=0)[:-1]
            before = raised(np.concatenate([np.zeros_like(seen[:1]), summed]), k)
            noise = before @ inflow + gains["noise_bound"]
            slips = (before + np.abs(C)).reshape(-1, n)
            most = scaled @ slips
            level = float((scaled @ noise.reshape(-1)).max())
            length = float(np.linalg.norm(scaled, axis=1).max())
        per_level = raised(np.asarray(gains["state_error"]) @ units, 2 * n)
        last = expm(Enclosure.exactly(A).scaled(k * float(gains["period"]), 0.0))
        return cls(per_level, kept * length, kept * level, kept * most.max(axis=0), last)

    def radius(self, size: float, slip: Vector) -> Vector:
        """Bound of the bias; size: length of the window."""
        level = self.of_length * size + self.of_noise + float(self.of_slip @ slip)
        return self.per_level * level if level < math.inf else np.full(len(slip), np.inf)


@dataclass(frozen=True)
class WindowError:
    """What turns a window into a radius."""

    proved: Vector
    state_error: Vector
    gain_length: Vector
    kicks: Vector
    kept: float
    gain: Vector
    rows: Enclosure
    start: StartError | None
    outputs: int

    @classmethod
    def of(cls, gains: Mapping[str, Any]) -> WindowError:
        """kicks: what errors of w, and of C w, do to the estimate, at most."""
        G, of_start = np.asarray(gains["window_gain"]), "reference" in gains
        rows = _rows(gains, of_start)
        state_error = np.asarray(gains["state_error"])
        # what rounding leaves of the recursion is far below this factor
        largest = float(np.abs(state_error).sum(axis=1).max())
        kept = 1.0 / (1.0 - largest) if largest < 0.5 else np.inf
        # sums of squares lose nothing that the factor does not cover
        length = 1.001 * np.abs(G).max(axis=1) * np.sqrt(G.shape[1])
        with np.errstate(over="ignore", invalid="ignore"):
            exact = 1.001 * np.linalg.norm(G, axis=1)
        length = np.where((exact > 1e-140) & (exact < length), exact, length)
        start = StartError.of(gains, rows) if of_start else None
        kicks = 2.0 * _kicks(gains, of_start)
        radius = np.asarray(gains["radius"])
        return cls(radius, state_error, length, kicks, kept, G, rows, start, len(gains["C"]))

    def moved(self, window: Vector, away: Vector, w: Vector) -> tuple[Vector, Vector]:
        """Residuals for another w, and what their rounding may do while they are in the window.

        away: by how much w changes, at the window's end or at its start; w: the new one.
        """
        fresh = window - self.rows.mid @ away
        size = np.abs(away)
        terms = len(away) + 4
        rounding = terms * UNIT * (np.abs(self.rows.mid) @ size + np.abs(fresh))
        error = self.rows.rad @ size + rounding + 1e-300
        error = np.where(np.isnan(error), 0.0, error)  # samples that are missing count nothing
        lift = _while_inside(np.abs(self.gain), error, self.outputs)
        if self.start is not None:  # w has not followed exactly
            last = self.start.last
            kick = last.rad @ size + terms * UNIT * (np.abs(last.mid) @ size + np.abs(w))
            lift = lift + self.kicks @ kick
        return fresh, raised(lift, len(error) + 2 * terms)

    def radius(self, size: float, w: Vector, x: Vector, slip: Vector, away: Vector) -> Vector:
        """Bound of |x - state| at a sample.

        size: length of the window; |w|, |x|, |x - w|: at most w, x, away.
        """
        terms = self.gain.shape[1] + 8
        # |G| |window| is below the product of lengths; every residual y - C w is itself rounded
        rounding = ((terms + 8) * UNIT * size) * self.gain_length
        inner = self.proved + rounding + 4 * UNIT * (w + x) + self.kicks @ slip
        if self.start is not None:
            return raised(inner + self.start.radius(size, slip), terms)
        return raised(inner + self.state_error @ (away + inner) * self.kept, terms)


def window_length(window: Vector) -> float:
    """Not below the Euclidean length: squares may underflow or overflow."""
    size = math.sqrt(window.dot(window) + len(window) * 1e-307)
    return size if size < math.inf else float(np.abs(window).sum())


def _rows(gains: Mapping[str, Any], of_start: bool) -> Enclosure:
    """C A_d^(j-k), or C A_d^j, enclosed, (k p, n)."""
    period, k = float(gains["period"]), int(gains["samples"])
    step = expm(Enclosure.exactly(gains["A"]).scaled(period if of_start else -period))
    found = Enclosure.exactly(gains["C"]) @ powers(step, k + 1)
    ordered = slice(0, k) if of_start else slice(k, 0, -1)
    n = len(step.mid)
    return Enclosure(found.mid[ordered].reshape(-1, n), found.rad[ordered].reshape(-1, n))


def _kicks(gains: Mapping[str, Any], of_start: bool) -> Vector:
    """sum_l |R_l| + |G_l| |C|, or of |Q_l|, (n, n): see `window_bounds`."""
    G, C, k = np.asarray(gains["window_gain"]), np.asarray(gains["C"]), int(gains["samples"])
    n, p, period = len(gains["A"]), len(C), float(gains["period"])
    step = plain_expm(gains["A"] * (period if of_start else -period))
    terms = [G[:, j * p : (j + 1) * p] for j in range(k)]
    weight, kicks = np.eye(n) if of_start else np.zeros((n, n)), np.zeros((n, n))
    for term in terms[::-1] if of_start else terms:
        if not of_start:
            weight = weight @ step + term @ C
        kicks = kicks + np.abs(weight) + np.abs(term) @ np.abs(C)
        if of_start:
            weight = weight @ step - term @ C
    return kicks


def _while_inside(gain: Vector, error: Vector, p: int) -> Vector:
    """(n,): the most that errors of a window's residuals do while newer ones push them out."""
    n, k = len(gain), len(error) // p
    weights, errors = gain.reshape(n, k, p), error.reshape(k, p)
    after = [
        sum(np.correlate(errors[:, c], row[:, c], "full")[k - 1 :] for c in range(p))
        for row in weights
    ]
    return np.array([float(np.max(one)) for one in after])
