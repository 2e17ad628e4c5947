"""Largest margin of matrix inequalities that are affine in several unknowns, by Clarabel.

The inequality is given once, as a function of the unknowns made of `+ - @ .T`; its coefficients
are read off by evaluating it, so that there is no second copy to drift away.

    maximise t   subject to   inequality(P, Z, ...)_i >= t I  for every i,
                              I <= P <= kappa I for every symmetric P,   t <= 1

The symmetric unknowns set the scale. Nothing here is proved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import clarabel
import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.find.conic import maximise_last, svec
from lmi.memory import require_cones, require_memory

Inequality = Callable[..., Matrix]  # unknowns -> (k, m, m) symmetric


@dataclass(frozen=True)
class Unknown:
    """Shape of an unknown matrix."""

    rows: int
    columns: int
    symmetric: bool = False

    def basis(self) -> list[Matrix]:
        """Matrices whose combinations are all values of the unknown."""
        matrices = []
        for j in range(self.columns):
            for i in range(j + 1 if self.symmetric else self.rows):
                E = np.zeros((self.rows, self.columns))
                E[i, j] = 1.0
                if self.symmetric:
                    E[j, i] = 1.0
                matrices.append(E)
        return matrices


def best_margin(
    unknowns: Sequence[Unknown], inequality: Inequality, kappa: float
) -> tuple[list[Matrix], float] | None:
    """(values of the unknowns, margin), or None when the solver gives no usable numbers."""
    constant, columns = coefficients(unknowns, inequality)
    directions = _directions(unknowns)
    k, m = constant.shape[:2]
    scaled = [i for i, unknown in enumerate(unknowns) if unknown.symmetric]
    A = np.zeros((k * m * (m + 1) // 2, len(directions) + 1))
    for j, change in enumerate(columns):
        A[:, j] = -svec(change).reshape(-1)
    A[:, -1] = np.tile(svec(np.eye(m)[None])[0], k)
    limits, b = [], [svec(constant).reshape(-1)]
    for i in scaled:
        P = np.stack([svec(direction[i][None])[0] for direction in directions], axis=1)
        rows = np.concatenate([-P, P])
        limits.append(np.hstack([rows, np.zeros((len(rows), 1))]))
        unit = svec(np.eye(unknowns[i].rows)[None])[0]
        b += [-unit, kappa * unit]
    last = np.zeros((1, len(directions) + 1))
    last[0, -1] = 1.0
    cones = [clarabel.PSDTriangleConeT(m)] * k
    cones += [clarabel.PSDTriangleConeT(unknowns[i].rows) for i in scaled for _ in range(2)]
    x, _ = maximise_last(
        np.concatenate([A, *limits, last]),
        np.concatenate([*b, [1.0]]),
        [*cones, clarabel.NonnegativeConeT(1)],
    )
    if not np.isfinite(x).all():
        return None
    values = [
        sum(
            (xj * d[i] for xj, d in zip(x[:-1], directions, strict=True)),
            start=np.zeros((unknown.rows, unknown.columns)),
        )
        for i, unknown in enumerate(unknowns)
    ]
    return values, float(x[-1])


def coefficients(
    unknowns: Sequence[Unknown], inequality: Inequality
) -> tuple[Matrix, list[Matrix]]:
    """Constant term (k, m, m) of an affine inequality, and its change with each scalar unknown.

    OversizeError where the coefficients exceed the budget of memory.
    """
    constant = inequality(*(np.zeros((u.rows, u.columns)) for u in unknowns))
    _require_memory(unknowns, *constant.shape[:2])
    return constant, [inequality(*direction) - constant for direction in _directions(unknowns)]


def _require_memory(unknowns: Sequence[Unknown], k: int, m: int) -> None:
    """OversizeError before one matrix for each unknown number, and the solver's, are built."""
    count = sum(u.rows * (u.rows + 1) // 2 if u.symmetric else u.rows * u.columns for u in unknowns)
    own = sum(u.rows * u.columns for u in unknowns)
    what, change = f"a matrix inequality in {count} unknown numbers", "fewer states are required"
    require_memory(what, count * (own + 4 * k * m**2), change)
    limits = [u.rows for u in unknowns if u.symmetric for _ in range(2)]
    require_cones(what, [m] * k + limits, change)


def _directions(unknowns: Sequence[Unknown]) -> list[list[Matrix]]:
    """One entry per scalar unknown: its basis matrix, zeros for all other unknowns."""
    directions = []
    for i, unknown in enumerate(unknowns):
        for E in unknown.basis():
            values = [np.zeros((u.rows, u.columns)) for u in unknowns]
            values[i] = E
            directions.append(values)
    return directions
