"""What a design can be expected to do, in numbers; floats, nothing is proved here.

Deviations are those of an impulse of weight 1 at the age where it is evaluated, the state known:
plain norm J^+ N J^+' with N the covariance of the features, whitened features (J' N^-1 J)^-1
without forming N, and the same for all samples of the window (the Cramer-Rao bound).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import (
    OLD,
    feature_scales,
    filtered_system,
    neglected_ratio,
    window_taps,
)
from obsdesign.equations.impulsive_input.fit import left_inverse

Array = NDArray[Any]

_MOST_SAMPLES = 20_000


def expectations(D: Array, gains: Any) -> dict[str, float]:
    """Peak of |b|, ratio of (15), deviations of time and weight; for operator `integral`."""
    C, H, exponents = gains["C"], gains["H"], np.asarray(gains["exponents"])
    tau, margin, n = float(gains["window"]), float(gains["margin"]), len(D)
    scales = feature_scales(exponents, tau)
    curve = ImpulseCurve.of(filtered_system(D, C, exponents, scales), H, tau)
    size = np.linalg.norm(curve.states[:, n:], axis=(1, 2))
    top = int(np.argmax(size))
    age = float(curve.ages[top]) if gains["rule"] == "peak" else OLD * curve.oldest
    found = {"peak_age": float(curve.ages[top]), "peak": float(size[top]), "evaluated_at_age": age,
             "latency": tau}  # fmt: skip
    if "threshold" in gains and H.shape[1] == 1:
        # the smallest that exceeds it at all, the largest that does not before it is evaluable
        early = float(size[curve.ages <= margin].max())
        found["smallest_weight"] = float(gains["threshold"]) / float(size.max())
        found["largest_weight"] = float(gains["threshold"]) / early if early > 0 else np.inf
    worst, _ = neglected_ratio(D, C, H, exponents, tau, margin)
    if np.isfinite(worst):
        found["neglected_ratio"] = worst
    period, std = gains.get("period"), np.asarray(gains["noise_std"])
    if period is None or not std.all() or H.shape[1] > 1 or tau / period > _MOST_SAMPLES:
        return found
    return found | _deviations(D, C, H, exponents, std, tau, float(period), age)


def _deviations(
    D: Array,
    C: Array,
    H: Array,
    exponents: Array,
    std: Array,
    tau: float,
    period: float,
    age: float,
) -> dict[str, float]:
    times = period * np.arange(int(tau / period) + 1)
    taps = window_taps(exponents, times)
    ages = times - (times[-1] - age)
    flows = expm(D * np.maximum(ages, 0.0)[:, None, None]) @ H
    shown = (ages >= 0)[:, None]
    h, rate = (C @ flows)[..., 0] * shown, (C @ D @ flows)[..., 0] * shown
    whole = [np.column_stack([rate[:, j], h[:, j]]) / std[j] for j in range(len(C))]
    features, whitened = [], []
    noise = []
    for j in range(len(C)):
        U = np.linalg.svd(taps * std[j], full_matrices=False)[0]
        whitened.append(U.T @ whole[j])
        features.append(taps.T @ whole[j] * std[j])
        noise.append(taps * std[j])
    names = ("time", "weight")
    found: dict[str, float] = {}
    back = left_inverse(np.vstack(features))
    m = taps.shape[1]
    spread = [
        np.linalg.norm(noise[j] @ back[:, j * m : (j + 1) * m].T, axis=0) for j in range(len(C))
    ]
    plain = np.linalg.norm(spread, axis=0)
    for label, J in (("gls", np.vstack(whitened)), ("bound", np.vstack(whole))):
        R = np.linalg.qr(J)[1]
        deviation = np.linalg.norm(left_inverse(R), axis=1)
        found |= {f"{name}_std_{label}": float(v) for name, v in zip(names, deviation, strict=True)}
    return found | {f"{name}_std_plain": float(v) for name, v in zip(names, plain, strict=True)}
