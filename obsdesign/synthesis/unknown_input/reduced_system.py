"""The reduced system of an unknown-input observer.

    x1' = A x1 + ...,   Z y = C x1        the state that d does not drive, and what is seen of it

Its unseen modes are the invariant zeros of the plant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from obsdesign.analysis.units import own_units
from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.problem.problem import Problem

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Reduced:
    """A (k, k), C (p - q, k) of the reduced system, k = n - q, of a plant in `own_units`.

    sizes: of the terms whose sums A and C are, a number and one per row. T (k, n), Z (p - q, p):
    from x and y to x1 and Z y; coupling (k, q): how x2 drives x1. visible, hidden: orthonormal,
    what C sees and what it never does.
    """

    A: Matrix
    C: Matrix
    sizes: tuple[float, Matrix]
    T: Matrix
    Z: Matrix
    coupling: Matrix
    visible: Matrix
    hidden: Matrix

    @classmethod
    def of(
        cls,
        A: Matrix,
        C: Matrix,
        D: Matrix,
        Ta: Matrix,
        T: Matrix,
        N: Matrix,
        Z: Matrix,
        hidden: Matrix,
    ) -> Reduced:
        """The reduced system of a plant in the coordinates [Ta, D].

        hidden (k, h): basis of what is exactly unseen, columns of any size.
        """
        back = Ta - D @ (N @ C @ Ta)
        inner, seen = T @ A @ back, Z @ C @ Ta
        rows = np.abs(Z) @ np.abs(C) @ np.abs(Ta)
        sizes = float(np.linalg.norm(T @ A) * np.linalg.norm(back)), np.linalg.norm(rows, axis=1)
        largest = np.linalg.norm(hidden, axis=0)
        unseen = np.linalg.qr(hidden / np.where(largest > 0, largest, 1.0))[0]
        return cls(inner, seen, sizes, T, Z, T @ A @ D, _complement(unseen), unseen)

    def nearly(self) -> Reduced:
        """The same with everything hidden that floats cannot tell from it."""
        hidden = _unseen(self.A, self.C, self.sizes)
        return replace(self, visible=_complement(hidden), hidden=hidden)

    def first_state(self) -> Matrix:
        """x1 of least norm that agrees with the first y: (k, p)."""
        return equations.first_state(self.C, self.Z, self.sizes[1])


def _complement(basis: Matrix) -> Matrix:
    return np.asarray(np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :])


def output_variances(problem: Problem) -> Matrix:
    """Variances of the measurement noise: weights.output, else from noise_std up to a factor.

    Without either, each output counts by the length of its row of C in `own_units`, so that units
    drop out.
    """
    given = problem.options.get("weights", {}).get("output")
    if given is not None:
        return np.asarray(given, dtype=np.float64)
    flow, output = problem.plant.flow, problem.plant.output
    assert flow.D is not None
    lengths = np.sum((output.C * own_units(flow.A, output.C, flow.D)[0]) ** 2, axis=1)
    lengths = np.where(lengths > 0, lengths, 1.0)
    if not np.all(output.noise_std > 0):
        return np.asarray(lengths)
    variances = output.noise_std**2
    return np.asarray(variances / np.mean(variances / lengths))


def left_inverse(CD: Matrix, variances: Matrix) -> tuple[Matrix, Matrix]:
    """N = (CD' V^-1 CD)^-1 CD' V^-1 by QR, and R with N V N' = (R' R)^-1.

    Noise of variances V disturbs no other left inverse less; with this one the noise that enters
    the reduced state is independent of the one in Z y.
    """
    weights = 1 / np.sqrt(variances)
    Q, R = np.linalg.qr(weights[:, None] * CD)
    return np.asarray(np.linalg.solve(R, Q.T * weights)), np.asarray(R)


def annihilator(CD: Matrix, units: Matrix) -> Matrix:
    """Z, (p - q, p), full rank, Z C D = 0; the unit matrix at the leftmost columns that allow it.

    units: factors (p,) that bring the outputs to one size. The normal form depends on the
    plant alone, so that a given L means the same everywhere.
    """
    p, q = CD.shape
    Z = np.linalg.qr(units[:, None] * CD, mode="complete")[0][:, q:].T
    tolerance = 1e-3
    while True:
        columns: list[int] = []
        basis = np.zeros((p - q, 0))
        for j in range(p):
            rest = Z[:, j] - basis @ (basis.T @ Z[:, j])
            if len(columns) < p - q and np.linalg.norm(rest) > tolerance:
                columns.append(j)
                basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
        if len(columns) == p - q:
            normal = np.linalg.solve(Z[:, columns], Z)
            return np.asarray(normal * units / units[columns][:, None] + 0.0)
        tolerance /= 10


def _unseen(A: Matrix, C: Matrix, sizes: tuple[float, Matrix]) -> Matrix:
    """Orthonormal basis of the subspace that A keeps and C sees by no more than rounding."""
    basis = _null(C / np.maximum(sizes[1], 1e-300)[:, None])
    while basis.shape[1]:
        moved = A @ basis
        inside = _null((moved - basis @ (basis.T @ moved)) / max(sizes[0], 1e-300))
        if inside.shape[1] == basis.shape[1]:
            break
        basis = basis @ inside
    return basis


def _null(X: Matrix) -> Matrix:
    if not X.size:
        return np.eye(X.shape[1])
    _, values, V = np.linalg.svd(X)
    return np.asarray(V[int((values > equations.UNSEEN).sum()) :].T)
