"""Expected peaks and deviations of a design, in floats; nothing is proved.

Deviations are those of an impulse of weight 1 at the age where it is evaluated, the state known:
plain norm J^+ N J^+' with N the covariance of the features, whitened features (J' N^-1 J)^-1
without forming N, and the same for all samples of the window (the Cramer-Rao bound).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.deviations import NoisyImpulses
from obsdesign.equations.impulsive_input.evaluation_rule import EVALUATED_AGE_SHARE
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
    neglected_ratio,
    window_taps,
)
from obsdesign.equations.impulsive_input.fit import left_inverse
from obsdesign.equations.impulsive_input.gains import IntegralGains

_MOST_SAMPLES = 20_000


@dataclass(frozen=True, kw_only=True)
class Expectations:
    """Numbers to judge a design of operator `integral` by; None where they mean nothing.

    peak, peak_age: largest |b| and the age where it is; evaluated_at_age: of an impulse;
    smallest_weight, largest_weight: that a threshold evaluates at the right age; neglected_ratio:
    of (15); deviations: of time and weight, by the name of the estimate.
    """

    peak_age: float
    peak: float
    evaluated_at_age: float
    latency: float
    smallest_weight: float | None = None
    largest_weight: float | None = None
    neglected_ratio: float | None = None
    deviations: Mapping[str, float] = field(default_factory=dict)

    def to_evidence(self) -> dict[str, float]:
        """Entries of the evidence of claim `uniqueness`."""
        entries = {name.name: getattr(self, name.name) for name in fields(self)[:-1]}
        return {name: value for name, value in entries.items() if value is not None} | dict(
            self.deviations
        )


def expectations(D: Matrix, gains: IntegralGains) -> Expectations:
    """Peak of |b|, ratio of (15), deviations of time and weight; D = A - K C."""
    gains = gains.in_output_units()
    window = FeatureWindow(
        D, gains.C, gains.H, exponents=gains.exponents, tau=gains.window, margin=gains.margin
    )
    tau, n = gains.window, gains.n
    scales = feature_scales(gains.exponents, tau)
    F = filtered_system(D, gains.C, gains.exponents, scales)
    curve = ImpulseCurve.from_system(F, gains.H, tau)
    size = np.linalg.norm(curve.states[:, n:], axis=(1, 2))
    top = int(np.argmax(size))
    age = float(curve.ages[top]) if gains.rule == "peak" else EVALUATED_AGE_SHARE * curve.oldest
    smallest = largest = None
    if gains.threshold is not None and gains.directions == 1:
        # the smallest that exceeds it at all, the largest that does not before it is evaluable
        early = float(size[curve.ages <= gains.margin].max())
        smallest = gains.threshold / float(size.max())
        largest = gains.threshold / early if early > 0 else np.inf
    worst, _ = neglected_ratio(window)
    return Expectations(
        peak_age=float(curve.ages[top]),
        peak=float(size[top]),
        evaluated_at_age=age,
        latency=tau,
        smallest_weight=smallest,
        largest_weight=largest,
        neglected_ratio=worst if np.isfinite(worst) else None,
        deviations=_deviations(window, gains, age) | _own_deviations(D, gains),
    )


def _deviations(window: FeatureWindow, gains: IntegralGains, age: float) -> dict[str, float]:
    """Deviations of time and weight at an age; none without noise or a period of the samples."""
    period, std, tau = gains.period, gains.noise_std, gains.window
    if period is None or not std.all() or gains.directions > 1 or tau / period > _MOST_SAMPLES:
        return {}
    D, C, H = window.D, window.C, window.H
    times = period * np.arange(int(tau / period) + 1)
    taps = window_taps(window.exponents, times)
    ages = times - (times[-1] - age)
    flows = expm(D * np.maximum(ages, 0.0)[:, None, None]) @ H
    shown = (ages >= 0)[:, None]
    h, rate = (C @ flows)[..., 0] * shown, (C @ D @ flows)[..., 0] * shown
    whole = [np.column_stack([rate[:, j], h[:, j]]) / std[j] for j in range(len(C))]
    features, whitened, noise = [], [], []
    for j in range(len(C)):
        U = np.linalg.svd(taps * std[j], full_matrices=False)[0]
        whitened.append(U.T @ whole[j])
        features.append(taps.T @ whole[j] * std[j])
        noise.append(taps * std[j])
    names = ("time", "weight")
    deviations: dict[str, float] = {}
    for label, J in (("gls", np.vstack(whitened)), ("bound", np.vstack(whole))):
        R = np.linalg.qr(J)[1]
        sizes = np.linalg.norm(left_inverse(R), axis=1)
        deviations |= {
            f"{name}_std_{label}": float(v) for name, v in zip(names, sizes, strict=True)
        }
    plain = _plain_deviations(np.vstack(features), noise)
    return deviations | {
        f"{name}_std_plain": float(v) for name, v in zip(names, plain, strict=True)
    }


def _own_deviations(D: Matrix, gains: IntegralGains) -> dict[str, float]:
    """Deviations of impulses at the shortest dwell time; none without noise or a period."""
    impulses = NoisyImpulses.from_gains(D, gains)
    if impulses is None or gains.period is None or gains.rule == "threshold":
        return {}
    deviations = impulses.deviations()
    if not np.isfinite(deviations.size):
        return {}
    return {"time_std": deviations.time, "weight_std": deviations.weight}


def _plain_deviations(J: Matrix, noise: list[Matrix]) -> Matrix:
    """Roots of the diagonal of J^+ N J^+', N given by its factors, one for each output."""
    back, m = left_inverse(J), noise[0].shape[1]
    blocks = [back[:, j * m : (j + 1) * m].T for j in range(len(noise))]
    parts = [
        np.linalg.norm(part @ block, axis=0) for part, block in zip(noise, blocks, strict=True)
    ]
    return np.asarray(np.linalg.norm(parts, axis=0))
