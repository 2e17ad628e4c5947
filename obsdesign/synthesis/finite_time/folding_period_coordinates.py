"""Coordinates S x as triangles, whose rotations change no norm, and those in which A is normal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WORST_BASIS = 1e6


def triangular(entries: Array, n: int) -> Array:
    """S upper triangular from its entries row by row, logarithms on the diagonal."""
    S = np.zeros((n, n))
    S[np.triu_indices(n)] = entries
    np.fill_diagonal(S, np.exp(np.minimum(np.diag(S), 700.0)))
    return S


def triangle_of(S: Array) -> Array:
    """The reverse of `triangular` for any regular S: a rotation of S x changes no norm."""
    R = np.asarray(np.linalg.qr(S, mode="r"), dtype=np.float64)
    R = R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]
    np.fill_diagonal(R, np.log(np.diag(R)))
    return np.asarray(R[np.triu_indices(len(S))])


def normal_coordinates(A: Array) -> Array | None:
    """The triangle of an S with S A S^-1 normal; None where the eigenvectors hardly allow it."""
    _, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _WORST_BASIS:
        return None
    # V^-1 = Q R up to a unitary Q: R'R = (V V*)^-1 is real, as eigenvectors come in pairs
    inverse = np.linalg.inv(np.linalg.cholesky(np.real(V @ V.conj().T)))
    return triangle_of(inverse)
