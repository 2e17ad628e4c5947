"""The problem of the longest period of condition (13), and its solutions in floats.

Coordinates S x as triangles, whose rotations change no norm, and those in which A is normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmi.time_budget import Remark
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.equations.gains import Array

# eigenvectors with a larger condition number are of no use as coordinates
_LARGEST_CONDITION = 1e6


def triangular(entries: Array, n: int) -> Array:
    """Return S upper triangular from its entries row by row, logarithms on the diagonal."""
    S = np.zeros((n, n))
    S[np.triu_indices(n)] = entries
    np.fill_diagonal(S, np.exp(np.minimum(np.diag(S), 700.0)))
    return S


def triangle_of(S: Array) -> Array:
    """Return the entries of a triangle with the norms of S x, the inverse of `triangular`.

    S is regular; a rotation of S x changes no norm.
    """
    R = np.asarray(np.linalg.qr(S, mode="r"), dtype=np.float64)
    R = R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]
    np.fill_diagonal(R, np.log(np.diag(R)))
    return np.asarray(R[np.triu_indices(len(S))])


def normal_coordinates(A: Array) -> Array | None:
    """Triangle of an S with S A S^-1 normal; None if the eigenvectors are nearly dependent."""
    _, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _LARGEST_CONDITION:
        return None
    # V^-1 = Q R up to a unitary Q: R'R = (V V*)^-1 is real, as eigenvectors come in pairs
    inverse = np.linalg.inv(np.linalg.cholesky(np.real(V @ V.conj().T)))
    return triangle_of(inverse)


@dataclass(frozen=True)
class Injection:
    """L (n, p), window T, log of the period below which (13) holds (in floats), S or None.

    An upper bound of the period that keeps n / p samples in the window is included. remarks: of
    the search for it.
    """

    L: Array
    window: float
    log_period: float
    S: Array | None = None
    remarks: tuple[Remark, ...] = ()


@dataclass(frozen=True)
class PeriodProblem:
    """A, C and whichever of L, T are fixed; coordinates: is S free?

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
        """Names of the free variables, for messages."""
        names = ["L"] if self.L is None else []
        names += ["the window"] if self.window is None else []
        names += ["coordinates S"] if self.coordinates else []
        listed = " and ".join([", ".join(names[:-1]), *names[-1:]] if len(names) > 1 else names)
        return listed + (" for a tighter Lemma 2" if self.tighter else "")

    def rated(self, L: Array, T: float, S: Array | None = None) -> Injection:
        """Return L, T, S with the longest period that (13) and the number of samples allow."""
        value = approx_log_longest_period(self.A, self.C, L, T, S, tighter=self.tighter)
        most = math.log(T) - math.log(math.ceil(len(self.A) / len(self.C)))
        return Injection(L, T, -math.inf if math.isnan(value) else min(value, most), S)
