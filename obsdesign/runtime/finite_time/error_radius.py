"""Bounds around a finite-time estimate for disturbance, noise and rounding, outwards.

At a sample the state is within `radius` (proved, stored in the design) of the exact estimate. To
that come the bias of the stored gains, |state_error| |x - w| (at t_i, or where `reference` is
"start" at the window's start), the rounding of their product with the window, and the error of w,
rounding and time stamps, which acts like small kicks at the samples: what a period adds to it is
carried to the period's end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, expm, powers, raised
from lmi.arithmetic.exponential import expm as plain_expm
from obsdesign.equations.finite_time.gains import FiniteTimeGains
from obsdesign.equations.finite_time.rows import least_squares_gain, state_scales
from obsdesign.runtime.finite_time.flow_maps import flow_maps


@dataclass(frozen=True)
class StartError:
    """Bias against x(t_i - T), whose distance from w the residuals of the window bound.

    bias_per_level (n,): |bias| where |x(t_i - T) - w| is one unit of the window; it is at most
    per_length |window| + noise_level + per_w_rounding @ w_rounding.
    """

    bias_per_level: Matrix
    per_length: float
    noise_level: float
    per_w_rounding: Matrix
    last: Enclosure  # e^{A T}

    @classmethod
    def from_gains(cls, gains: FiniteTimeGains, rows: Enclosure) -> StartError:
        """Constants of the bias from rows C A_d^j (k p, n).

        X with X rows = I up to E inverts them: |X r| + |E| e bounds e.
        """
        A, C, k, n = gains.A, gains.C, gains.samples, gains.n
        units = state_scales(A, C, gains.window)
        X = least_squares_gain(rows.mid, np.ones(len(rows.mid)))
        missed = (Enclosure.exactly(X) @ rows - Enclosure.exactly(np.eye(n))).magnitude
        scaled = raised(np.abs(X) / units[:, None], 1)
        defect = float((missed * units / units[:, None]).sum(axis=1).max())
        factor = 1.01 / (1.0 - defect) if defect < 0.5 else np.inf
        inflow = flow_maps(gains, gains.period, 0.0).inflow
        with np.errstate(over="ignore", invalid="ignore"):
            # kicks of the periods before sample j reach it through sum_(l<j) |C A_d^l|
            sizes = rows.magnitude.reshape(k, -1, n)
            summed = np.cumsum(sizes, axis=0)[:-1]
            before = raised(np.concatenate([np.zeros_like(sizes[:1]), summed]), k)
            noise = before @ inflow + gains.noise
            w_rounding = scaled @ (before + np.abs(C)).reshape(-1, n)
            level = float((scaled @ noise.reshape(-1)).max())
            length = float(np.linalg.norm(scaled, axis=1).max())
        return cls(
            bias_per_level=raised(gains.bias_bound @ units, 2 * n),
            per_length=factor * length,
            noise_level=factor * level,
            per_w_rounding=factor * w_rounding.max(axis=0),
            last=expm(Enclosure.exactly(A).scaled(gains.window, 0.0)),
        )

    def radius(self, length: float, w_rounding: Matrix) -> Matrix:
        """Bound of the bias for a window of this length."""
        level = self.per_length * length + self.noise_level
        with np.errstate(invalid="ignore"):  # 0 times what has no bound: no bound
            level += float(self.per_w_rounding @ w_rounding)
        if not level < math.inf:
            return np.full(len(w_rounding), np.inf)
        return self.bias_per_level * level


@dataclass(frozen=True)
class WindowError:
    """Constants that turn the residuals of a window into a radius."""

    proved: Matrix
    state_error: Matrix
    gain_length: Matrix
    kicks: Matrix
    bias_factor: float
    gain: Matrix
    rows: Enclosure
    start: StartError | None
    outputs: int

    @classmethod
    def from_gains(cls, gains: FiniteTimeGains) -> WindowError:
        """Constants of a design with a radius.

        kicks (n, n) bounds the effect of errors of w, and of C w, on the estimate, its own rounding
        by a factor; bias_factor is the geometric series of the bias that acts on its own error.
        """
        rows, state_error = _rows(gains), gains.bias_bound
        largest = float(np.abs(state_error).sum(axis=1).max())
        return cls(
            proved=gains.error_bound,
            state_error=state_error,
            gain_length=_row_lengths(gains.window_gain),
            kicks=2.0 * _kicks(gains),
            bias_factor=1.0 / (1.0 - largest) if largest < 0.5 else np.inf,
            gain=gains.window_gain,
            rows=rows,
            start=StartError.from_gains(gains, rows) if gains.is_relative_to_start else None,
            outputs=gains.p,
        )

    def shifted(self, window: Matrix, change: Matrix, w: Matrix) -> tuple[Matrix, Matrix]:
        """Residuals for another w, and what their rounding may do while they are in the window.

        change: of w, at the window's end or at its start; w: the new one.
        """
        fresh = window - self.rows.mid @ change
        size = np.abs(change)
        terms = len(change) + 4
        rounding = terms * UNIT * (np.abs(self.rows.mid) @ size + np.abs(fresh))
        error = self.rows.rad @ size + rounding + 1e-300
        error = np.where(np.isnan(error), 0.0, error)  # missing samples have no error
        shift_rounding = _largest_while_inside(np.abs(self.gain), error, self.outputs)
        if self.start is not None:  # the shift of w itself is rounded
            last = self.start.last
            kick = last.rad @ size + terms * UNIT * (np.abs(last.mid) @ size + np.abs(w))
            shift_rounding = shift_rounding + self.kicks @ kick
        return fresh, raised(shift_rounding, len(error) + 2 * terms)

    def radius(
        self, length: float, w: Matrix, x: Matrix, w_rounding: Matrix, distance: Matrix
    ) -> Matrix:
        """Bound of |x - state| at a sample.

        length: of the window; |w|, |x|, |x - w|: at most w, x, distance.
        """
        terms = self.gain.shape[1] + 8
        # |G| |window| is below the product of lengths; every residual y - C w is itself rounded
        rounding = ((terms + 8) * UNIT * length) * self.gain_length
        inner = self.proved + rounding + 4 * UNIT * (w + x) + self.kicks @ w_rounding
        if self.start is not None:
            return raised(inner + self.start.radius(length, w_rounding), terms)
        return raised(inner + self.state_error @ (distance + inner) * self.bias_factor, terms)


def window_length(window: Matrix) -> float:
    """Bound the Euclidean length from above: squares may underflow or overflow."""
    size = math.sqrt(window.dot(window) + len(window) * 1e-307)
    return size if size < math.inf else float(np.abs(window).sum())


def _row_lengths(gain: Matrix) -> Matrix:
    """Bounds (n,) of the Euclidean lengths of the rows of a gain."""
    # sums of squares lose nothing that the factor does not cover
    bound = 1.001 * np.abs(gain).max(axis=1) * np.sqrt(gain.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        length = 1.001 * np.linalg.norm(gain, axis=1)
    return np.asarray(np.where((length > 1e-140) & (length < bound), length, bound))


def _rows(gains: FiniteTimeGains) -> Enclosure:
    """C A_d^(j-k), or relative to the start C A_d^j, enclosed, (k p, n)."""
    k, from_start = gains.samples, gains.is_relative_to_start
    step = expm(Enclosure.exactly(gains.A).scaled(gains.period if from_start else -gains.period))
    stack = Enclosure.exactly(gains.C) @ powers(step, k + 1)
    ordered = slice(0, k) if from_start else slice(k, 0, -1)
    return Enclosure(
        stack.mid[ordered].reshape(-1, gains.n), stack.rad[ordered].reshape(-1, gains.n)
    )


def _kicks(gains: FiniteTimeGains) -> Matrix:
    """sum_l |Q_l| + |G_l| |C|, (n, n): what errors of w at the ends of the periods do.

    Q_l as in `analysis.finite_time.error_radius`: R_l A_d^-1 where the rows speak of x(t_i).
    """
    G, C, n, p = gains.window_gain, gains.C, gains.n, gains.p
    terms = [G[:, j * p : (j + 1) * p] for j in range(gains.samples)]
    kicks = np.zeros((n, n))
    if gains.is_relative_to_start:
        weight, step = np.eye(n), plain_expm(gains.A * gains.period)
        for term in terms[::-1]:
            kicks = kicks + np.abs(weight) + np.abs(term) @ np.abs(C)
            weight = weight @ step - term @ C
        return kicks
    weight, step = np.zeros((n, n)), plain_expm(gains.A * -gains.period)
    for term in terms:
        weight = (weight + term @ C) @ step
        kicks = kicks + np.abs(weight) + np.abs(term) @ np.abs(C)
    return kicks


def _largest_while_inside(gain: Matrix, error: Matrix, p: int) -> Matrix:
    """Largest effect (n,) of errors of a window's residuals until newer ones replace them."""
    n, k = len(gain), len(error) // p
    weights, errors = gain.reshape(n, k, p), error.reshape(k, p)
    effects = [
        sum(np.correlate(errors[:, c], row[:, c], "full")[k - 1 :] for c in range(p))
        for row in weights
    ]
    return np.array([float(np.max(effect)) for effect in effects])
