"""Spectral radii of matrices in floats."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix


def spectral_radii(maps: Matrix) -> Matrix:
    """Spectral radius of each matrix of (..., n, n), 0 for n = 0; NaN where it is not finite."""
    finite = np.asarray(np.isfinite(maps).all(axis=(-2, -1), keepdims=True))
    radii = np.abs(np.linalg.eigvals(np.where(finite, maps, 0.0))).max(axis=-1, initial=0.0)
    return np.where(finite[..., 0, 0], radii, np.nan)


def finite_spectral_radii(maps: Matrix) -> Matrix:
    """Spectral radius of each matrix of (..., n, n); 0 of those that are not finite."""
    return np.nan_to_num(spectral_radii(maps), nan=0.0, posinf=np.inf)


def spectral_radius(matrix: Matrix) -> float:
    """Spectral radius of one matrix, 0 for n = 0; NaN where the matrix is not finite."""
    return float(spectral_radii(matrix))
