"""Noise of the samples in the features of a window: made white, tested; evidence of onsets.

As it enters directly: with taps Psi and noise deviations s_k of the samples, the singular vectors
U of diag(s) Psi give features U'(e / s) with unit covariance, of which b and V are the same linear
map T; no Gramian is formed or inverted. T divides by singular values, down to 1e-11 of the largest:
where digits count, features are made by the taps U / s themselves. What enters through K is that of
`window_noise`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.deviations import KERNEL_RANK_TOLERANCE
from obsdesign.equations.impulsive_input.gains import ImpulsiveInputGains

# proportional noise is no smaller than at this part of the largest output, that of an output
# no smaller than at this part of the others, in units of like size
_LEAST_LEVEL_SHARE = 1e-3
# part of an output that rounding of sums of squares hides: no noise counts as smaller
_LEAST_CV = 1e-7
# of rows by which a window is judged where a mean would be that of an outlier
USUAL_SHARE = 0.75
# |r|^2 of a fit that noise alone explains is below this, once in a thousand windows: chi-squared
# quantiles by Wilson and Hilferty, z = 3.0902
Z_SCORE = 3.090232306167813


class Weighted(NamedTuple):
    """Features R (r,), and the map T (r, p m) that makes b and V features of the same kind."""

    R: Matrix
    T: Matrix


class Whitening(NamedTuple):
    """Taps (rows, p, r) of features of unit covariance, and the map T (r, p m) of raw ones."""

    taps: Matrix
    T: Matrix

    def features(self, error: Matrix) -> Matrix:
        """Those of a residual (rows, p), (r,)."""
        return np.asarray(np.tensordot(error, self.taps, 2))


def raw_taps(taps: Matrix, p: int) -> Matrix:
    """Taps (rows, p, p m) of features of each output by itself, from taps (rows, m)."""
    return np.asarray(np.einsum("km,ij->kijm", taps, np.eye(p)).reshape(len(taps), p, -1))


def whitening(taps: Matrix, spread: Matrix) -> Whitening:
    """Features of unit covariance, from taps (rows, m) and the noise's deviations (rows, p)."""
    white, maps, (rows, p), m = [], [], spread.shape, taps.shape[1]
    for j in range(p):
        U, sizes, right = np.linalg.svd(taps * spread[:, j, None], full_matrices=False)
        kept = sizes > KERNEL_RANK_TOLERANCE * sizes[0]
        own = np.zeros((rows, p, int(kept.sum())))
        own[:, j] = U[:, kept] / spread[:, j, None]
        white.append(own)
        block = np.zeros((int(kept.sum()), m * p))
        block[:, j * m : (j + 1) * m] = right[kept] / sizes[kept, None]
        maps.append(block)
    return Whitening(np.concatenate(white, axis=2), np.vstack(maps))


def noise_deviation(gains: ImpulsiveInputGains, y: Matrix, level: Matrix, usual: Matrix) -> Matrix:
    """Deviations of the noise of outputs y (..., p) of a `noise_level` (p,).

    usual (..., p): the size of outputs of which rounding hides a part. That of y = 0 is none where
    std and level are zero: nothing shows how large noise may be.
    """
    std, rounding = gains.noise_std, _LEAST_CV * usual if gains.noisy else 0.0 * usual
    size = np.where(std > 0, np.abs(y), np.maximum(np.abs(y), _LEAST_LEVEL_SHARE * level))
    return np.asarray(np.hypot(np.hypot(std, gains.noise_cv * size), rounding))


def usual_size(y: Matrix) -> Matrix:
    """Size (p,) below which three of four outputs (rows, p) are: of no outlier."""
    return np.asarray(np.quantile(np.abs(y), USUAL_SHARE, axis=0))


def noise_level(largest: Matrix) -> Matrix:
    """Level (..., p) of outputs whose largest are (..., p), in units of like size."""
    others = _LEAST_LEVEL_SHARE * largest.max(axis=-1, keepdims=True)
    return np.asarray(np.maximum(largest, others))


def least_cv(gains: ImpulsiveInputGains) -> Matrix:
    """Proportional deviations (p,) with what rounding adds; zero where no noise is stated."""
    return np.hypot(gains.noise_cv, _LEAST_CV if gains.noisy else 0.0)


def chi_squared_limit(freedom: int) -> float:
    """0.999 quantile of chi-squared (Wilson, Hilferty 1931); infinite without freedom."""
    if freedom < 1:
        return math.inf
    ninth = 2.0 / (9.0 * freedom)
    return float(freedom * (1 - ninth + Z_SCORE * math.sqrt(ninth)) ** 3)


def log_evidence(ratio: Matrix, directions: int) -> Matrix:
    """Logarithm of the likelihood of onsets, up to a constant, over all weights.

    ratio: twice the logarithm of that of the best weights against none, for each onset.
    """
    return np.asarray(ratio / 2 + log_prior(ratio, directions))


def log_prior(ratio: Matrix, directions: int) -> Matrix:
    """What weights of every size add to the logarithm of the likelihood of the best ones.

    What an impulse leaves is before as likely to be of one size as of another, uniform in its
    logarithm and its direction: under a flat prior of weights those onsets would be more likely
    which take larger weights to leave the same. Laplace's approximation; what is smaller than noise
    does not count.
    """
    return np.asarray(-directions / 2 * np.log(np.maximum(ratio, directions)))
