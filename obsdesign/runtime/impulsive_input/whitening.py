"""Noise of the samples in the features of a window: made white, bounded, tested.

With taps Psi and noise deviations s_k of the samples, the singular vectors U of diag(s) Psi give
features U'(e / s) with unit covariance, of which b and V are the same linear map T; no Gramian is
formed or inverted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.deviations import KERNEL_RANK_TOLERANCE
from obsdesign.equations.impulsive_input.gains import ImpulsiveInputGains

# proportional noise is no smaller than at this part of the largest output
_LEAST_LEVEL_SHARE = 1e-3
# |r|^2 of a fit that noise alone explains is below this, once in a thousand windows: chi-squared
# quantiles by Wilson and Hilferty, z = 3.0902
Z_SCORE = 3.090232306167813


class Weighted(NamedTuple):
    """Features R (r,), and the map T (r, p m) that makes b and V features of the same kind."""

    R: Matrix
    T: Matrix


def whitened(taps: Matrix, error: Matrix, spread: Matrix) -> Weighted:
    """Features of unit covariance, from taps (rows, m) and the residual (rows, p)."""
    features, maps, m = [], [], taps.shape[1]
    for j in range(error.shape[1]):
        U, sizes, right = np.linalg.svd(taps * spread[:, j, None], full_matrices=False)
        kept = sizes > KERNEL_RANK_TOLERANCE * sizes[0]
        features.append(U[:, kept].T @ (error[:, j] / spread[:, j]))
        block = np.zeros((int(kept.sum()), m * error.shape[1]))
        block[:, j * m : (j + 1) * m] = right[kept] / sizes[kept, None]
        maps.append(block)
    return Weighted(np.concatenate(features), np.vstack(maps))


def feature_deviation(taps: Matrix, spread: Matrix) -> float:
    """sigma_R: the largest deviation of R in any direction, from the noise of the samples."""
    sizes = [np.linalg.norm(taps * column[:, None], 2) for column in spread.T]
    return float(max(sizes))


def noise_deviation(gains: ImpulsiveInputGains, y: Matrix, level: Matrix) -> Matrix:
    """Deviation of the noise of outputs y whose largest so far is `level`: y = 0 is not exact."""
    std, cv = gains.noise_std, gains.noise_cv
    size = np.where(std > 0, np.abs(y), np.maximum(np.abs(y), _LEAST_LEVEL_SHARE * level))
    return np.asarray(np.hypot(std, np.where((size > 0) | (std > 0), cv * size, cv)))


def chi_squared_limit(freedom: int) -> float:
    """0.999 quantile of chi-squared (Wilson, Hilferty 1931); infinite without freedom."""
    if freedom < 1:
        return math.inf
    ninth = 2.0 / (9.0 * freedom)
    return float(freedom * (1 - ninth + Z_SCORE * math.sqrt(ninth)) ** 3)


def noise_covariance(taps: Matrix, spread: Matrix) -> Matrix:
    """N, (p m, p m): covariance of R from noise of deviations `spread` (rows, p)."""
    p, m = spread.shape[1], taps.shape[1]
    N = np.zeros((p * m, p * m))
    for j in range(p):
        weighted = taps * spread[:, j, None]
        N[j * m : (j + 1) * m, j * m : (j + 1) * m] = weighted.T @ weighted
    return N
