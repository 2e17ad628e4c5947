"""Diagonal scaling of states, outputs and time that balances the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.problem.plant import Plant

# rounds of least squares in which entries far from all others lose weight
_REWEIGHTED = 8
# binary logarithm of the largest ratio of two sizes
_LARGEST_RATIO = 500


def balancing_units(A: Matrix, C: Matrix, D: Matrix) -> tuple[Matrix, float]:
    """Return (sizes of the states (n,), pace): units in which A is balanced.

    Where A does not tie all states together, the outputs C (p, n) and inputs D (n, q) do. Powers of
    two.
    """
    from scipy.linalg import matrix_balance

    with np.errstate(all="ignore"):
        n, p = len(A), len(C)
        ties = [(A, 0, 0, 1.0), (C, n, 0, 0.0), (D, 0, n + p, 0.0)]
        start = np.exp2(np.round(_even_bits(n, ties)))
        scaled = A * start / start[:, None]
        if not np.isfinite(scaled).all():
            start, scaled = np.ones(len(A)), A
        balanced, (sizes, _) = matrix_balance(scaled, permute=False, separate=True)
        return np.asarray(start * sizes), float(np.abs(balanced).max(initial=0.0)) or 1.0


@dataclass(frozen=True)
class BalancedPlant:
    """A plant in units of its own, which do not depend on those of its file.

    x = diag(sizes) z, y = diag(rows) times the output in these units, and `pace` of their units of
    time to one of the file: A (n, n), C (p, n) are maps of z. No powers of two: those next to the
    sizes would depend on the units of the file.
    """

    sizes: Matrix
    rows: Matrix
    pace: float
    A: Matrix
    C: Matrix

    @classmethod
    def from_plant(cls, plant: Plant, own_pace: float = 1.0) -> BalancedPlant:
        """With its jumps, which tie states together too; own_pace: as in `from_matrices`."""
        G = None if plant.jump is None else plant.jump.G
        return cls.from_matrices(plant.flow.A, plant.output.C, G, own_pace)

    @classmethod
    def from_matrices(
        cls, A: Matrix, C: Matrix, G: Matrix | None = None, own_pace: float = 1.0
    ) -> BalancedPlant:
        """Rows of C are of length one; G (n, n): of jumps; own_pace: of an A without cycles."""
        with np.errstate(all="ignore"):
            # no unit of x matters to this pace
            pace = spectral_radius(np.abs(A)) or own_pace
            ties = [(A / pace, 0, 0, 0.0), (C, len(A), 0, 0.0)]
            ties += [] if G is None else [(G, 0, 0, 0.0)]
            sizes = np.exp2(_even_bits(len(A), ties))
            flow = A * sizes / sizes[:, None]
            if not (np.isfinite(flow).all() and np.isfinite(C * sizes).all()):
                sizes, flow = np.ones(len(A)), A
        lengths = np.linalg.norm(C * sizes, axis=1)
        rows = np.where(lengths > 0, lengths, 1.0)
        pace = float(np.abs(flow).max(initial=0.0)) or own_pace
        return cls(sizes, rows, pace, flow / pace, C * sizes / rows[:, None])

    def scaled(self, factor: float) -> BalancedPlant:
        """The same in units larger by a common factor."""
        return replace(self, sizes=self.sizes * factor, rows=self.rows * factor)

    def map(self, X: Array) -> Array:
        """A map (..., n, n) of x as one of z."""
        return np.asarray(X * self.sizes / self.sizes[:, None])

    def flow_gain(self, L: Array) -> Array:
        """A gain (n, p) of A - L C in these units as one of the file."""
        return np.asarray(self.sizes[:, None] * self.pace * L / self.rows)


# matrix, where its rows and columns stand among the unknown sizes, and the exponent of its pace
_Tie = tuple[Matrix, int, int, float]


def _even_bits(n: int, ties: Sequence[_Tie]) -> Matrix:
    """Binary logarithms (n,) of sizes that bring most entries of each matrix to one magnitude.

    Sums of magnitudes by reweighted least squares: an entry that is mere rounding counts little.
    Linear in logarithms, so that other units move the answer by exactly those, the common factor
    aside, as far as the entries tie the units together.
    Source: Curtis, Reid, On the automatic scaling of matrices for Gaussian elimination (1972).
    """
    count = 1 + max(max(to + len(X), start + X.shape[1]) for X, to, start, _ in ties)
    rows, values = [], []
    for X, to, start, pace in ties:
        for i, j in zip(*np.nonzero(X), strict=True):
            if to + i != start + j:
                row = np.zeros(count)
                row[[to + i, start + j, -1]] = 1.0, -1.0, pace
                rows.append(row)
                values.append(np.log2(abs(X[i, j])))
    if not rows:
        return np.zeros(n)
    table, bits, weights = np.array(rows), np.array(values), np.ones((len(rows), 1))
    for _ in range(_REWEIGHTED):
        logarithms = np.linalg.lstsq(weights * table, weights[:, 0] * bits, rcond=None)[0]
        weights = np.maximum(np.abs(table @ logarithms - bits), 1.0)[:, None] ** -0.5
    relative = logarithms[:n] - logarithms[0]  # the common factor is free
    return np.asarray(np.clip(relative, -_LARGEST_RATIO, _LARGEST_RATIO))
