"""The problem of the longest period of condition (13), and its solutions in floats.

Coordinates S x as triangles, whose rotations change no norm, and those in which A is normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.solvers import Solvers
from lmi.time_budget import Remark
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.problem.problem import Problem

# eigenvectors with a larger condition number are of no use as coordinates
_LARGEST_CONDITION = 1e6


def triangular(entries: Matrix, n: int) -> Matrix:
    """Return S upper triangular from its entries row by row, logarithms on the diagonal."""
    S = np.zeros((n, n))
    S[np.triu_indices(n)] = entries
    np.fill_diagonal(S, np.exp(np.minimum(np.diag(S), 700.0)))
    return S


def triangle_of(S: Matrix) -> Matrix:
    """Return the entries of a triangle with the norms of S x, the inverse of `triangular`.

    S is regular; a rotation of S x changes no norm.
    """
    R = np.asarray(np.linalg.qr(S, mode="r"), dtype=np.float64)
    R = R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]
    np.fill_diagonal(R, np.log(np.diag(R)))
    return np.asarray(R[np.triu_indices(len(S))])


def normal_coordinates(A: Matrix) -> Matrix | None:
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
    the search for it. solvers: called in it.
    """

    L: Matrix
    window: float
    log_period: float
    S: Matrix | None = None
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


@dataclass(frozen=True)
class PeriodProblem:
    """A, C and whichever of L, T are fixed; coordinates: is S free?

    tighter: with `tighter_sigma` in place of Sigma in (13).
    """

    A: Matrix
    C: Matrix
    window: float | None = None
    L: Matrix | None = None
    coordinates: bool = False
    tighter: bool = False

    @classmethod
    def from_problem(cls, problem: Problem, window: float | None = None) -> Self:
        """The plant of a problem, with its L if it states one."""
        plant = problem.plant
        return cls(plant.flow.A, plant.output.C, window, problem.gains.get("L"))

    @property
    def has_zero_gain(self) -> bool:
        """Is L given, with L C = 0? Then (13) holds for no period."""
        return self.L is not None and not np.any(self.L @ self.C)

    @property
    def unknowns(self) -> str:
        """Names of the free variables, for messages."""
        names = ["L"] if self.L is None else []
        names += ["the window"] if self.window is None else []
        names += ["coordinates S"] if self.coordinates else []
        listed = " and ".join([", ".join(names[:-1]), *names[-1:]] if len(names) > 1 else names)
        return listed + (" for a tighter Lemma 2" if self.tighter else "")

    def rated(self, L: Matrix, T: float, S: Matrix | None = None) -> Injection:
        """Return L, T, S with the longest period that (13) and the number of samples allow."""
        value = approx_log_longest_period(self.A, self.C, L, T, S, tighter=self.tighter)
        most = math.log(T) - math.log(math.ceil(len(self.A) / len(self.C)))
        return Injection(L, T, -math.inf if math.isnan(value) else min(value, most), S)
