"""An impulse somewhere in a window of few samples: filter, likelihood of onsets, what follows.

The exact relation of samples, onset and weight that `runtime.impulse_samples` states; everything
here is about one window, and nothing about when to look.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm
from obsdesign.runtime.base import Vector
from obsdesign.runtime.luenberger import responses

Array = NDArray[Any]

ONSETS = 40  # per interval between samples
_REFINEMENTS = 12  # of the grid of onsets, tenfold each
_CROWDED = 0.95  # probability of three neighbours from which a grid is too coarse
_CACHED = 64


@dataclass(frozen=True, slots=True)
class Row:
    """One row: time, measurement (None: missing), known input from then on, deviations (p,)."""

    t: float
    y: Vector | None
    u: Vector
    spread: Vector


@dataclass(frozen=True)
class Fit:
    """A posterior over onsets: times, probabilities, weights, what remains; shapes (G,)."""

    onsets: Array
    probability: Array
    weights: Array
    precision: Array
    ratio: Array
    cost: float


@dataclass(frozen=True)
class OnsetModel:
    """The plant, seen through samples; weight_std: prior deviation of weights, inf for none."""

    A: Array
    B: Array
    C: Array
    H: Array
    drift: Vector
    nonnegative: bool
    weight_std: float = math.inf
    _responses: OrderedDict[tuple[float, ...], Array] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    # --- filter ---------------------------------------------------------------------------------

    def free(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        """The state at `until` from x at t, input u held, no impulse."""
        if until <= t:
            return x
        flow, once, _ = responses(self.A, until - t)
        return np.asarray(flow @ x + once @ (self.B @ u + self.drift))

    def filtered(self, x: Vector, P: Array, one: Row, other: Row) -> tuple[Vector, Array]:
        """Kalman filter from one row to the next: state and covariance, its sample used."""
        flow = expm(self.A * (other.t - one.t))
        return self.updated(self.free(one.t, x, one.u, other.t), flow @ P @ flow.T, other)

    def updated(self, x: Vector, P: Array, row: Row) -> tuple[Vector, Array]:
        """State and covariance after the sample of a row, if there is one."""
        if row.y is None:
            return x, P
        S = self.C @ P @ self.C.T + np.diag(row.spread**2)
        gain = np.linalg.solve(S, self.C @ P).T
        P = P - gain @ self.C @ P
        return x + gain @ (row.y - self.C @ x), (P + P.T) / 2

    def fitted(
        self, rows: tuple[Row, ...], x: Vector, P: Array, low: float, high: float, interval: float
    ) -> Fit:
        """Likelihood ratios and posterior over onsets in [low, high), from rows after the first.

        The likelihood of (onset, g) with eps_o ~ (0, P) part of the noise; g ~ (0, weight_std).
        """
        step = interval / ONSETS
        return self._posterior(rows, x, P, low + step * np.arange(round((high - low) / step)))

    def refined(self, rows: tuple[Row, ...], x: Vector, P: Array, fit: Fit) -> Fit:
        """The posterior on finer and finer grids, while a few onsets hold all of it."""
        for _ in range(_REFINEMENTS):
            top = int(np.argmax(fit.probability))
            if fit.probability[max(top - 1, 0) : top + 2].sum() < _CROWDED:
                break
            low, high = fit.onsets[max(top - 2, 0)], fit.onsets[min(top + 2, len(fit.onsets) - 1)]
            fit = self._posterior(rows, x, P, np.linspace(low, high, ONSETS + 1))
        return fit

    def _posterior(self, rows: tuple[Row, ...], x: Vector, P: Array, onsets: Array) -> Fit:
        _, error, S, _ = self.residuals(rows, x, P)
        half = np.linalg.cholesky(S)
        b = np.linalg.solve(half, self.responses_at(rows, onsets).T)  # (K p, G)
        e = np.linalg.solve(half, error)
        num, den = e @ b, (b * b).sum(axis=0)
        if self.nonnegative:
            num = np.maximum(num, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(den > 0, num**2 / den, 0.0)
            d = den + self.weight_std**-2
            log_p = np.where((den > 0) & ((num > 0) | (not self.nonnegative)),
                             0.5 * num**2 / d - 0.5 * np.log(d), -math.inf)  # fmt: skip
        p = np.exp(log_p - log_p.max()) if np.isfinite(log_p).any() else np.ones_like(log_p)
        weights = np.where(den > 0, num / np.where(d > 0, d, 1.0), 0.0)
        return Fit(onsets, p / p.sum(), weights, d, ratio, float(e @ e - ratio.max()))

    def residuals(
        self, rows: tuple[Row, ...], x: Vector, P: Array
    ) -> tuple[float, Array, Array, Array]:
        """(t_o, residuals (K p,), their covariance without impulse, C e^{A (t - t_o)} (K p, n))."""
        t_o, at, t, u = rows[0].t, x, rows[0].t, rows[0].u
        error, noise, seen = [], [], []
        for row in rows[1:]:
            at, t, u = self.free(t, at, u, row.t), row.t, row.u
            if row.y is not None:
                error.append(row.y - self.C @ at)
                noise.append(row.spread**2)
                seen.append(row.t - t_o)
        if not seen:
            n = len(x)
            return t_o, np.zeros(0), np.zeros((0, 0)), np.zeros((0, n))
        flows = expm(self.A * np.array(seen)[:, None, None])
        shown = (self.C @ flows).reshape(-1, len(x))
        S = np.diag(np.concatenate(noise)) + shown @ P @ shown.T
        return t_o, np.concatenate(error), S, shown

    def responses_at(self, rows: tuple[Row, ...], onsets: Array) -> Array:
        """C e^{A (t_k - t)} H of an impulse at each onset t, (G, K p)."""
        seen = np.array([row.t for row in rows[1:] if row.y is not None])
        ends = np.concatenate([seen, onsets[:2], onsets[-1:]]) - rows[0].t
        key = (*np.round(ends, 12).tolist(), float(len(onsets)))
        if key not in self._responses:
            ages = seen[None, :] - onsets[:, None]
            live = ages >= -1e-12
            flows = expm(self.A * np.maximum(ages, 0.0)[:, :, None, None])
            found = (self.C @ flows @ self.H)[..., 0] * live[:, :, None]
            self._responses[key] = found.reshape(len(onsets), -1)
            if len(self._responses) > _CACHED:
                self._responses.popitem(last=False)
        return self._responses[key]

    def collapsed(
        self, fit: Fit, rows: tuple[Row, ...], x: Vector, P: Array
    ) -> tuple[list[Vector], Vector, Array]:
        """(means at the rows, mean and covariance at the last), over the posterior of onsets."""
        t_o, error, S, seen = self.residuals(rows, x, P)
        gain = np.linalg.solve(S, seen @ P).T
        b = self.responses_at(rows, fit.onsets)  # (G, K p)
        p, g = fit.probability, fit.weights
        eps = gain @ (error[:, None] - b.T * g)  # (n, G): error at t_o for each onset
        means, t, u, free = [], t_o, rows[0].u, x
        moved = eps
        for row in rows:
            free, t, u = self.free(t, free, u, row.t), row.t, row.u
            flow = expm(self.A * (row.t - t_o))
            ages = row.t - fit.onsets
            jumps = expm(self.A * np.maximum(ages, 0.0)[:, None, None]) @ self.H
            jumps = jumps[..., 0].T * (ages >= -1e-12)  # (n, G)
            moved = free[:, None] + flow @ eps + jumps * g
            means.append(moved @ p)
        onto = jumps - flow @ gain @ b.T
        rest = flow @ (P - gain @ seen @ P) @ flow.T
        away = moved - means[-1][:, None]
        covariance = rest + (onto * (p / fit.precision)) @ onto.T + (away * p) @ away.T
        covariance = (covariance + covariance.T) / 2
        # rounding must not leave it indefinite
        floor = 1e-9 * float(np.trace(covariance)) / len(x)
        return means, means[-1], covariance + floor * np.eye(len(x))
