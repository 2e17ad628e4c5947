"""The reduced system of an unknown-input observer.

    x1' = A x1 + ...,   Z y = C x1        the state that d does not drive, and its outputs

Its unobservable modes are the invariant zeros of the plant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.balancing import balancing_units
from obsdesign.equations.unknown_input import formulas as equations
from obsdesign.problem.options import UnknownInputOptions
from obsdesign.problem.problem import Problem


@dataclass(frozen=True)
class Reduced:
    """A (k, k), C (p - q, k) of the reduced system, k = n - q, of a plant in `balancing_units`.

    sizes: of the terms whose sums A and C are, a number and one per row. T (k, n), Z (p - q, p):
    from x and y to x1 and Z y; coupling (k, q): how x2 drives x1. visible, hidden: orthonormal
    bases of the observable and the unobservable directions.
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
    def from_plant(
        cls,
        plant: tuple[Matrix, Matrix, Matrix],
        *,
        Ta: Matrix,
        T: Matrix,
        N: Matrix,
        Z: Matrix,
        hidden: Matrix,
    ) -> Reduced:
        """The reduced system of a plant (A, C, D) in the coordinates [Ta, D].

        hidden (k, h): basis of what is exactly unobservable, columns of any size.
        """
        A, C, D = plant
        back = Ta - D @ (N @ C @ Ta)
        flow, output = T @ A @ back, Z @ C @ Ta
        rows = np.abs(Z) @ np.abs(C) @ np.abs(Ta)
        sizes = float(np.linalg.norm(T @ A) * np.linalg.norm(back)), np.linalg.norm(rows, axis=1)
        largest = np.linalg.norm(hidden, axis=0)
        unobservable = np.linalg.qr(hidden / np.where(largest > 0, largest, 1.0))[0]
        return cls(
            A=flow,
            C=output,
            sizes=sizes,
            T=T,
            Z=Z,
            coupling=T @ A @ D,
            visible=_complement(unobservable),
            hidden=unobservable,
        )

    def with_nearly_hidden(self) -> Reduced:
        """The same system, everything hidden that is unobservable up to rounding."""
        hidden = _unobservable(self.A, self.C, self.sizes)
        return replace(self, visible=_complement(hidden), hidden=hidden)

    def first_state(self) -> Matrix:
        """x1 of least norm that agrees with the first y: (k, p)."""
        return equations.first_state(self.C, self.Z, self.sizes[1])


def _complement(basis: Matrix) -> Matrix:
    return np.asarray(np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :])


def output_variances(problem: Problem) -> Matrix:
    """Variances of the measurement noise: weights.output, else from noise_std up to a factor.

    Without either, each output counts by the length of its row of C in `balancing_units`, so that
    units drop out.
    """
    given = (problem.options_as(UnknownInputOptions).weights or {}).get("output")
    if given is not None:
        return np.asarray(given, dtype=np.float64)
    flow, output = problem.plant.flow, problem.plant.output
    assert flow.D is not None
    lengths = np.sum((output.C * balancing_units(flow.A, output.C, flow.D)[0]) ** 2, axis=1)
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
    """Z, (p - q, p), full rank, Z C D = 0; the unit matrix at the leftmost possible columns.

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
            residual = Z[:, j] - basis @ (basis.T @ Z[:, j])
            if len(columns) < p - q and np.linalg.norm(residual) > tolerance:
                columns.append(j)
                basis = np.column_stack([basis, residual / np.linalg.norm(residual)])
        if len(columns) == p - q:
            normal = np.linalg.solve(Z[:, columns], Z)
            return np.asarray(normal * units / units[columns][:, None] + 0.0)
        tolerance /= 10


def _unobservable(A: Matrix, C: Matrix, sizes: tuple[float, Matrix]) -> Matrix:
    """Orthonormal basis of the subspace that is invariant under A, and 0 under C up to rounding."""
    basis = _null(C / np.maximum(sizes[1], 1e-300)[:, None])
    while basis.shape[1]:
        image = A @ basis
        inside = _null((image - basis @ (basis.T @ image)) / max(sizes[0], 1e-300))
        if inside.shape[1] == basis.shape[1]:
            break
        basis = basis @ inside
    return basis


def _null(X: Matrix) -> Matrix:
    if not X.size:
        return np.eye(X.shape[1])
    _, values, V = np.linalg.svd(X)
    return np.asarray(V[int((values > equations.UNOBSERVABLE).sum()) :].T)
