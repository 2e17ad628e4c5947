"""Coordinates S and S2 from given R and T.

Assumption 4 of Degue, Efimov, Richard (NOLCOS 2016):
F = A - L C and R are similar if they have one characteristic polynomial and (F, e1), (R, e2) are
observable for some rows. With O1, O2 the observability matrices of these pairs, F O1^-1 is O1^-1
times the companion matrix of the polynomial, and likewise R, so that S = O1^-1 O2 gives
S^-1 F S = R (Raissi, Efimov, Zolghadri, IEEE TAC 57, 2012). In the same way S2 from the jump matrix
of the error and T.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import characteristic_polynomial, exact, inverse, to_float
from obsdesign.equations.interval.splits import flow_and_jump
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

# part of the largest coefficient (scaled like eigenvalues) by which polynomials may differ
_ROUNDING = 1e-12


def coordinates_of_assumption_4(problem: Problem, given: Mapping[str, Array]) -> dict[str, Matrix]:
    """S, S2 and T for the given L, M, R and T.

    Of the rows e that observability leaves free those are taken which widen the bounds least over
    a jump. InputError unless R and T are similar to the matrices of the error.
    """
    for name in ("L", "M"):
        if name not in given:
            raise InputError(
                f"observer.gains.{name} is required: with R, coordinates are built for given L and "
                "M; it is missing."
            )
    plant = problem.plant
    assert plant.jump is not None
    F, H = flow_and_jump(
        exact(plant.flow.A), exact(plant.output.C), exact(plant.jump.G), L=exact(given["L"]),
        M=exact(given["M"]), jump_measurement=plant.output.jump_measurement, is_periodic=False,
    )  # fmt: skip
    assert H is not None
    flows = list(_similarities(_Pair("R", problem.gains["R"], F, "A - L C")))
    jumps = list(_similarities(_Pair("T", problem.gains["T"], H, "the jump matrix of the error")))
    S, S2 = min(
        ((S, S2) for S in flows for S2 in jumps),
        key=lambda pair: _growth(pair[0], pair[1], problem.gains["T"]),
    )
    return {"S": S, "S2": S2, "T": problem.gains["T"]}


@dataclass(frozen=True)
class _Pair:
    """A given matrix, and that of the error, exact, to which it must be similar."""

    name: str
    given: Matrix
    matrix: Array
    words: str


def _similarities(pair: _Pair) -> Iterator[Matrix]:
    """Yield S with S^-1 F S as given, for several rows e1; InputError if there is none."""
    _refuse_other_eigenvalues(pair)
    n = len(pair.given)
    targets, starts = (
        [observed for e in _rows(n) if (observed := _observable(X, e)) is not None]
        for X in (exact(pair.given), pair.matrix)
    )
    if not targets or not starts:
        culprit = f"observer.gains.{pair.name}" if not targets else pair.words
        raise InputError(
            f"observer.gains.{pair.name} must be similar to {pair.words}, both observable from a "
            f"row; {culprit} is not. Give S and S2 instead."
        )
    for inner in starts:
        yield to_float(inner.inverse @ targets[0].matrix)


@dataclass(frozen=True)
class _Observability:
    """O = [e; e F; ...; e F^(n-1)] and its inverse, exact."""

    matrix: Array
    inverse: Array


def _observable(F: Array, e: list[int]) -> _Observability | None:
    """The observability matrix of (F, e); None if it is singular."""
    rows = [exact(np.array([e], dtype=np.float64))]
    for _ in range(len(F) - 1):
        rows.append(rows[-1] @ F)
    stacked = np.vstack(rows)
    back = inverse(stacked)
    return None if back is None else _Observability(stacked, back)


def _rows(n: int) -> Iterator[list[int]]:
    """Yield rows e: sums of all states first, then single ones, then others."""
    yield [1] * n
    yield from ([int(i == j) for j in range(n)] for i in range(n))
    yield [j + 1 for j in range(n)]
    yield [(-1) ** j * (j + 1) for j in range(n)]


def _refuse_other_eigenvalues(pair: _Pair) -> None:
    """Raise InputError unless the characteristic polynomials agree up to rounding."""
    ours, theirs = (characteristic_polynomial(X) for X in (pair.matrix, exact(pair.given)))
    n, size = len(pair.given), float(max(np.abs(to_float(pair.matrix)).sum(axis=1).max(), 1e-300))
    ends = zip(ours, theirs, strict=True)
    apart = max(abs(float(a - b)) / size ** (n - i) for i, (a, b) in enumerate(ends))
    if apart > _ROUNDING:
        shown = [
            ", ".join(f"{root:.6g}" for root in np.sort_complex(np.linalg.eigvals(X)))
            for X in (to_float(pair.matrix), pair.given)
        ]
        raise InputError(
            f"observer.gains.{pair.name} must have the eigenvalues of {pair.words}, {shown[0]}; "
            f"it has {shown[1]}."
        )


def _growth(S: Matrix, S2: Matrix, T: Matrix) -> float:
    """Spectral radius of |S^-1 S2| T |S2^-1 S|, of a jump in the coordinates of S."""
    if not all(np.linalg.cond(X) < 1e12 for X in (S, S2)):
        return float("inf")
    across = np.linalg.solve(S, S2)
    jump = np.abs(across) @ T @ np.abs(np.linalg.inv(across))
    return float(np.abs(np.linalg.eigvals(jump)).max())
