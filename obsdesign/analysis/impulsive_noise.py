"""Estimates, not proofs, of the noise and the speed of convergence of an impulsive observer.

Random spacings, uniform in their range; the covariance of the error just after an impulse follows
Sigma+ = F Sigma F' + L V L', F = (G + L C) e^{A delta}, without any random noise. Synthesis and
verification share it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.formulas import Core, window_gains
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.problem.problem import Problem

_SEQUENCES, _IMPULSES, _SEED = 48, 80, 20092


@dataclass(frozen=True)
class Estimate:
    """std: of each error just after an impulse, (n,); per_impulse: factor that errors shrink by."""

    std: Matrix
    per_impulse: float


@np.errstate(all="ignore")
def simulated(
    gains: ImpulsiveGains,
    noise: Matrix,
    *,
    sequences: int = _SEQUENCES,
    impulses: int = _IMPULSES,
    seed: int = _SEED,
) -> Estimate:
    """Estimate for a design's gains and the standard deviations of its measurements, (p,)."""
    (low, high), window = gains.dwell_range, gains.window_length
    A, G = gains.A, gains.jump_matrix
    C = seen_before_jump(G, gains.C, gains.jump_measurement)
    rng = np.random.default_rng(seed)
    spacings = rng.uniform(low, high, (sequences, impulses + window))
    L = _gains(gains, spacings, window)
    flows = expm(A * spacings[:, window - 1 :, None, None])[:, : L.shape[1]]
    F = (G + L @ C) @ flows
    n = len(A)
    sigma = np.zeros((sequences, n, n))
    error = np.broadcast_to(np.eye(n), (sequences, n, n))
    total, shrunk, settled = np.zeros(n), 0.0, impulses // 2
    weight = noise[:, None] * np.swapaxes(L, -1, -2)
    for k in range(L.shape[1]):
        sigma = F[:, k] @ sigma @ np.swapaxes(F[:, k], -1, -2)
        sigma = sigma + np.swapaxes(weight[:, k], -1, -2) @ weight[:, k]
        error = F[:, k] @ error
        size = np.linalg.norm(error, axis=(1, 2))
        error = error / np.maximum(size, 1e-300)[:, None, None]
        if k >= settled:
            total += np.diagonal(sigma, axis1=1, axis2=2).mean(axis=0)
            shrunk += float(np.log(np.maximum(size, 1e-300)).mean())
    count = L.shape[1] - settled
    # errors at the level of rounding shrink no further: dead-beat
    per_impulse = math.exp(shrunk / count)
    return Estimate(np.sqrt(total / count), per_impulse if per_impulse > 1e-6 else 0.0)


def _gains(gains: ImpulsiveGains, spacings: Matrix, window: int) -> Matrix:
    """L for every impulse whose window lies in the record, (sequences, impulses, n, p)."""
    if not gains.has_window:
        return gains.table_gain(spacings)
    core = Core.from_gains(gains, np.asarray)
    m = core.spacings(window)
    flows = expm(core.A * spacings[:, :, None, None])
    count = spacings.shape[1] - window + 1
    # the last spacing of each window is number window - 1 + k
    first = window - m
    index = first + np.arange(count)[:, None] + np.arange(m)
    L = window_gains(core, flows[:, index], gains.window_weight)
    L = np.broadcast_to(L, (len(spacings), count, *L.shape[-2:]))
    return L if core.lift is None else core.lift @ L


def noise_of(problem: Problem) -> Matrix:
    """Standard deviations of the measurements; ones where none are given at all."""
    given = problem.plant.output.noise_std
    return np.array(given) if np.any(given) else np.ones(problem.plant.p)


def estimate(problem: Problem, gains: ImpulsiveGains) -> dict[str, object]:
    """The estimate as evidence of a design: convergence per impulse, and errors from noise."""
    noise = noise_of(problem)
    estimated = simulated(gains, noise)
    return {
        "per_impulse": estimated.per_impulse,
        "std_after_impulse": estimated.std.tolist(),
        "measurement_std": noise.tolist(),
        "spacings": "independent, uniform in their range",
    }


def missed_target(problem: Problem, gains: ImpulsiveGains) -> dict[str, object]:
    """Evidence that a design misses its noise target: the reason, and the numbers."""
    reached = simulated(gains, noise_of(problem)).std
    shown = ", ".join(f"{value:.4g}" for value in reached)
    reason = (
        f"with a window of {gains.window_length} and alpha {gains.window_weight:g} the "
        f"estimated standard deviations are ({shown}); a longer window, a slower alpha or better "
        "measurements are needed"
    )
    return {"reason": reason, "estimated": {"std": reached.tolist()}}
