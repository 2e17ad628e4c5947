"""Noise of the samples in the features of a window: made white, tested; evidence of onsets.

As it enters directly: with taps Psi and noise deviations s_k of the samples, the singular vectors
U of diag(s) Psi give features U'(e / s) with unit covariance, of which b and V are the same linear
map T; no Gramian is formed or inverted. What enters through K is that of `window_noise`.
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


def log_evidence(ratio: Matrix, directions: int) -> Matrix:
    """Logarithm of the likelihood of onsets, up to a constant, over all weights.

    ratio: twice the logarithm of that of the best weights against none, for each onset. What an
    impulse leaves is before as likely to be of one size as of another, uniform in its logarithm and
    its direction: under a flat prior of weights those onsets would be more likely which take larger
    weights to leave the same. Laplace's approximation; what is smaller than noise does not count.
    """
    return np.asarray(ratio / 2 - directions / 2 * np.log(np.maximum(ratio, directions)))
