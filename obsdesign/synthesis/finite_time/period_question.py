"""The question of the longest period of condition (13): what is given, and an answer in floats.

Coordinates S x as triangles, whose rotations change no norm, and those in which A is normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period

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


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Injection:
    """L (n, p), window T, log of the period below which (13) holds (in floats), S or None."""

    L: Array
    window: float
    log_period: float
    S: Array | None = None


@dataclass(frozen=True)
class Open:
    """A plant, and what of T, L and S is given; coordinates: is S to be found?

    tighter: with `tighter_sigma` in place of Sigma in (13).
    """

    A: Array
    C: Array
    window: float | None = None
    L: Array | None = None
    coordinates: bool = False
    tighter: bool = False

    @property
    def unknowns(self) -> str:
        """What is open, for a person."""
        names = ["L"] if self.L is None else []
        names += ["the window"] if self.window is None else []
        names += ["coordinates S"] if self.coordinates else []
        told = " and ".join([", ".join(names[:-1]), *names[-1:]] if len(names) > 1 else names)
        return told + (" for a tighter Lemma 2" if self.tighter else "")

    def rated(self, L: Array, T: float, S: Array | None = None) -> Injection:
        """As (13) allows, and short enough for the window to hold n / p samples."""
        value = approx_log_longest_period(self.A, self.C, L, T, S, self.tighter)
        most = math.log(T) - math.log(math.ceil(len(self.A) / len(self.C)))
        return Injection(L, T, -math.inf if math.isnan(value) else min(value, most), S)
