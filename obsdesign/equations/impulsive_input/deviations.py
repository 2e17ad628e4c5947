"""Deviations of times and weights in noise, counting the error of the state before; floats.

Impulses of weight 1 follow each other at the shortest dwell time. Noise enters a window through
independent sources z of unit variance: the error e(t_o), of covariance P, and the output's noise,
which enters features directly and through K. In features R = M z + b(age) g, e after the window is
N z beside the impulse, J = [b', b], the fit is a left inverse X of J, and to first order

    error of (age, g)   X M z
    e after the window  N z - W M z,   W = [D e^{D age} H, e^{D age} H] X + G (I - J X)

with G the gain of the state correction, if there is one. P is the limit of this and of what noise
adds through K until the next window. For an impulse of weight g the deviation of time is that over
|g|; P does not depend on g.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.evaluation_rule import (
    EVALUATED_AGE_SHARE,
    evaluation_rule,
    impulse_curve,
)
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_flows_at,
    feature_scales,
    filtered_system,
    window_matrix,
)
from obsdesign.equations.impulsive_input.fit import left_inverse
from obsdesign.equations.impulsive_input.gains import IntegralGains

# singular values of kernels below this part of the largest carry more rounding than signal
KERNEL_RANK_TOLERANCE = 1e-11
_NODES = 64  # of Gauss's rule on the window before and after the onset
_IMPULSES, _CONVERGED = 200, 1e-9  # until P is the same, relative to it


class Deviations(NamedTuple):
    """Deviations of time and weight of an impulse of weight 1."""

    time: float
    weight: float

    @property
    def size(self) -> float:
        """Geometric mean of both: a choice that does not depend on units."""
        return math.sqrt(self.time * self.weight)

    def at_most(self, other: Deviations) -> bool:
        """Whether neither is larger than the other's."""
        return self.time <= other.time and self.weight <= other.weight


@dataclass(frozen=True, kw_only=True)
class NoisyImpulses:
    """Windows with noise, whatever their exponents; one direction H.

    intensity (p,): variance of the noise of each output times the spacing of its samples; K (n, p);
    dwell: time between impulses.
    """

    window: FeatureWindow
    K: Matrix
    intensity: Matrix
    dwell: float
    weighting: str
    state_correction: bool

    @classmethod
    def from_gains(cls, D: Matrix, gains: IntegralGains) -> NoisyImpulses | None:
        """Those of a design, D = A - K C; None where deviations cannot be foreseen.

        Without a period of the samples the intensity is known up to a factor: that of the output
        with the largest noise is then 1.
        """
        gains = gains.in_output_units()
        std = gains.noise_std
        if not std.all() or gains.directions > 1 or not np.linalg.eigvals(D).real.max() < 0:
            return None
        spacing = 1 / float(std.max()) ** 2 if gains.period is None else gains.period
        window = FeatureWindow(
            D, gains.C, gains.H, exponents=gains.exponents, tau=gains.window, margin=gains.margin
        )
        return cls(
            window=window, K=gains.K, intensity=std**2 * spacing, dwell=gains.shortest_dwell,
            weighting=gains.weighting, state_correction=bool(gains.state_correction),
        )  # fmt: skip

    def with_exponents(self, exponents: Matrix) -> NoisyImpulses:
        """The same with other exponents."""
        return replace(self, window=replace(self.window, exponents=exponents))

    def age(self) -> float:
        """Age at which an impulse is evaluated. ValueError where features cannot be followed."""
        rule, oldest = evaluation_rule(self.window, noisy=True)
        return (
            peak_age(impulse_curve(self.window))
            if rule == "peak"
            else (EVALUATED_AGE_SHARE * oldest)
        )

    def deviations(self) -> Deviations:
        """Of an impulse in the limit of many; infinite where they do not converge.

        ValueError where the features cannot be followed.
        """
        return self.limit(self.age())[0]

    @np.errstate(over="ignore", invalid="ignore")  # what does not converge is not finite
    def limit(self, age: float) -> tuple[Deviations, Matrix]:
        """(deviations, P (n, n)) in the limit of many impulses, each evaluated at an age."""
        features, window = self._features(age), self.window
        D, n = window.D, len(window.D)
        Q = self.K @ np.diag(self.intensity) @ self.K.T
        pause = max(self.dwell - window.tau, 0.0)
        between, state = expm(D * pause), expm(D * age) @ window.H
        growth, moves = error_growth(D, Q, pause), np.hstack([D @ state, state])
        P = np.zeros((n, n))
        for _ in range(_IMPULSES):
            sources = features.sources(P)
            X, W = sources.fit(self.weighting), np.zeros((n, len(features.V)))
            if self.state_correction:
                W = sources.state_gain()
            W = moves @ X + W @ (np.eye(len(X.T)) - features.J @ X)
            left = between @ (sources.after - sources.shown @ W.T).T
            after = left @ left.T + growth
            change, P = np.abs(after - P), (after + after.T) / 2
            if not np.isfinite(P).all() or (change <= _CONVERGED * np.abs(P).max()).all():
                break
        else:
            P = np.full((n, n), math.inf)
        if not np.isfinite(P).all():
            return Deviations(math.inf, math.inf), P
        sources = features.sources(P)
        spread = np.linalg.norm(sources.shown @ sources.fit(self.weighting).T, axis=0)
        return Deviations(*spread.tolist()), P

    def distinct_kernels(self) -> int:
        """Number of kernels that floats tell apart: features of a window that carry a signal."""
        return len(_singular_kernels(self.window, self.window.tau / 2)[0])

    def _features(self, age: float) -> _WhiteFeatures:
        """Features of unit noise, the kernels' singular vectors of the window."""
        window = self.window
        D, C, lams, tau = window.D, window.C, window.exponents, window.tau
        scales, n, m = feature_scales(lams, tau), len(window.D), len(lams)
        F = filtered_system(D, C, lams, scales)
        b = ImpulseCurve.from_system(F, window.H, tau).value(age)
        raw = np.hstack([window_matrix(D, C, lams, tau, scales), (F @ b)[n:], b[n:]])
        sizes, right = _singular_kernels(window, age)
        T, roots = right / sizes[:, None], np.sqrt(self.intensity)
        parts = [T @ raw[j * m : (j + 1) * m] / roots[j] for j in range(len(C))]
        back = [right.T * sizes * root for root in roots]
        rows = np.vstack(parts)
        noise, ends = self._noise(F, age)
        white = [noise[:, j * m : (j + 1) * m] @ T.T / roots[j] for j in range(len(C))]
        flow = expm(D * tau)
        return _WhiteFeatures(rows[:, :n], rows[:, n:], flow, np.hstack(white), ends, back)

    def _noise(self, F: Matrix, age: float) -> tuple[Matrix, Matrix]:
        """(in the features (s, p m), in the state after the window (s, n)) of noise at nodes.

        Noise of an output moves the estimate by K, and features as an error of the state of its age
        does; and it stands in them as it is.
        """
        window, (p, n) = self.window, self.window.C.shape
        ages, weights = window_nodes(window.tau, age)
        scales = feature_scales(window.exponents, window.tau)
        kernels = np.exp(np.outer(ages, window.exponents)) * scales
        flows = -feature_flows_at(F, n, ages) @ self.K  # (nodes, n + p m, p)
        for j in range(p):
            rows = slice(n + j * kernels.shape[1], n + (j + 1) * kernels.shape[1])
            flows[:, rows, j] += kernels
        flows *= np.sqrt(weights[:, None, None] * self.intensity)
        sources = flows.transpose(0, 2, 1).reshape(-1, len(F))
        return sources[:, n:], sources[:, :n]


@dataclass(frozen=True)
class _WhiteFeatures:
    """V (r, n), J (r, 2) of features that are white but for noise through K.

    flow (n, n): of the error over the window; noise (s, r), ends (s, n): what the output's noise
    leaves in features and in the error after the window; unwhitening: back to R, for each output.
    """

    V: Matrix
    J: Matrix
    flow: Matrix
    noise: Matrix
    ends: Matrix
    unwhitening: list[Matrix]

    def sources(self, P: Matrix) -> _Sources:
        """Those of an error of covariance P before the window, and of noise within it."""
        root = square_root(P)
        shown = np.vstack([(self.V @ root).T, self.noise])
        after = np.vstack([(self.flow @ root).T, self.ends])
        return _Sources(self, shown, after, *np.linalg.qr(shown))


@dataclass(frozen=True)
class _Sources:
    """Rows of independent sources in features, shown (s, r) = Q upper, and in the error after."""

    features: _WhiteFeatures
    shown: Matrix
    after: Matrix
    Q: Matrix
    upper: Matrix

    def fit(self, weighting: str) -> Matrix:
        """X (2, r): age and weight from features, by the norm of the fit."""
        J, unwhitening = self.features.J, self.features.unwhitening
        if weighting == "plain":
            parts = np.split(J, len(unwhitening))
            raw = [back @ part for back, part in zip(unwhitening, parts, strict=True)]
            inverse = np.split(left_inverse(np.vstack(raw)), len(raw), axis=1)
            return np.hstack([x @ y for x, y in zip(inverse, unwhitening, strict=True)])
        white = np.asarray(np.linalg.solve(self.upper.T, J), dtype=np.float64)
        return np.asarray(np.linalg.solve(self.upper, left_inverse(white).T).T)

    def state_gain(self) -> Matrix:
        """The error after the window that features make likely, (n, r)."""
        return np.asarray(np.linalg.solve(self.upper, self.Q.T @ self.after).T)


def _singular_kernels(window: FeatureWindow, age: float) -> tuple[Matrix, Matrix]:
    """(singular values (r,), right singular vectors (r, m)) of the kernels that stand out."""
    ages, weights = window_nodes(window.tau, age)
    scales = feature_scales(window.exponents, window.tau)
    kernels = np.exp(np.outer(ages, window.exponents)) * scales * np.sqrt(weights)[:, None]
    _, sizes, right = np.linalg.svd(kernels, full_matrices=False)
    kept = sizes > KERNEL_RANK_TOLERANCE * sizes[0]
    return sizes[kept], right[kept]


def window_nodes(tau: float, age: float) -> tuple[Matrix, Matrix]:
    """Nodes and weights of Gauss's rule: ages on both sides of an onset at `age`."""
    x, w = np.polynomial.legendre.leggauss(_NODES)
    x, w = (x + 1) / 2, w / 2
    ages = np.concatenate([age * x, age + (tau - age) * x])
    return ages, np.concatenate([age * w, (tau - age) * w])


def peak_age(curve: ImpulseCurve) -> float:
    """Age at which |b| is largest, on the grid of the curve refined by a parabola."""
    size = np.linalg.norm(curve.states[:, curve.n :, 0], axis=1)
    k = int(np.clip(np.argmax(size), 1, len(size) - 2))
    low, mid, high = size[k - 1 : k + 2]
    bend = low - 2 * mid + high
    shift = 0.5 * (low - high) / bend if bend < 0 else 0.0
    return float((k + np.clip(shift, -1, 1)) * curve.step)


def square_root(P: Matrix) -> Matrix:
    """F (n, n) with F F' = P for a covariance P, of units as different as they may be."""
    sizes = np.sqrt(np.diag(P))
    sizes = np.where(sizes > 0, sizes, 1.0)
    values, vectors = np.linalg.eigh(P / sizes / sizes[:, None])
    return np.asarray(sizes[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def error_growth(D: Matrix, Q: Matrix, elapsed: float) -> Matrix:
    """Covariance of e' = D e + w after a time from e = 0, w white of intensity Q; D is stable."""
    n = len(D)
    operator = np.kron(np.eye(n), D) + np.kron(D, np.eye(n))
    limit = np.linalg.solve(operator, -Q.reshape(-1)).reshape(n, n)
    flow = expm(D * elapsed)
    added = limit - flow @ limit @ flow.T
    return np.asarray((added + added.T) / 2)
