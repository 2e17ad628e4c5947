"""Coordinates for interval observers: bases in which flow and jump have little of the wrong sign."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.interval import flow_and_jump
from obsdesign.plant import Plant

Matrix = NDArray[np.float64]

# a basis closer to a singular one than this costs more digits in its inverse than it can gain
_WORST_CONDITION = 1e6


def bases(plant: Plant, L: Any, M: Any) -> list[Matrix]:
    """Candidates for S, best guess first: eigenvectors of the flow, adapted to the jump's kernel.

    Real eigenvectors make S^-1 F S diagonal; a complex pair gives its real and imaginary part.
    """
    numbers = {"A": plant.flow.A, "C": plant.output.C, "L": L, "M": M}
    if plant.jump is not None:
        numbers["G"] = plant.jump.G
    periodic = plant.output.measured == "periodic"
    F, H = flow_and_jump(numbers, plant.output.jump_measurement, periodic)
    found = [eigenbasis(F)]
    if H is not None:
        found += [eigenbasis(H), eigenbasis(H @ H + F)]
    return [S for S in found if S is not None]


def eigenbasis(X: Matrix) -> Matrix | None:
    """Real basis of eigenvectors of X, columns of largest entry 1; None if it is nearly singular."""
    values, vectors = np.linalg.eig(X)
    columns = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag > 0:
            columns += [vector.real, vector.imag]
        elif value.imag == 0:
            columns.append(vector.real)
    S = np.column_stack(columns)
    return scaled_columns(S)


def scaled_columns(S: Matrix) -> Matrix | None:
    """Columns divided by their largest entry, digits beyond 2**-40 dropped; None if near singular."""
    with np.errstate(all="ignore"):
        scaled = S / np.abs(S).max(axis=0)
        short: Matrix = np.round(scaled * 2.0**40) / 2.0**40
    if not np.isfinite(short).all() or np.linalg.cond(short) > _WORST_CONDITION:
        return None
    return short
