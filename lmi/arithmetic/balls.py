"""Exact matrices and ball arithmetic: the only file that imports flint.

Exact matrices are numpy object arrays of rationals, so that the papers' formulas (`+ - @ .T`) run
on them unchanged. Ball matrices are `arb_mat`: every entry is a number with a proved error bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
from flint import arb, arb_mat, ctx, fmpq, fmpq_mat, nmod, nmod_mat
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix

Exact = NDArray[np.object_]
Rational: TypeAlias = fmpq
Ball: TypeAlias = arb  # a number with a proved error bound
Balls: TypeAlias = arb_mat  # a matrix of them
Number: TypeAlias = fmpq | arb  # what formulas that run on both take
_PRIME = 2**61 - 1
PRECISIONS = (80, 160, 320)  # bits: raised in turn before a proof gives up


def exact(values: ArrayLike | Exact) -> Exact:
    """The rational numbers that floats (or exact entries) are; ValueError if not finite."""
    array = np.asarray(values)
    numbers = [rational(value) for value in array.ravel().tolist()]
    return np.array(numbers, dtype=object).reshape(array.shape)


def rational(value: Number | float) -> Rational:
    """One exact number."""
    if isinstance(value, fmpq):
        return value
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"only finite numbers have an exact value; got {number}")
    return fmpq(*number.as_integer_ratio())


def to_float(values: Exact) -> Matrix:
    """Nearest binary64 numbers; infinite where the exact number is too large for one."""
    nearest = [nearest_float(v) for v in values.ravel().tolist()]
    return np.array(nearest, dtype=np.float64).reshape(values.shape)


def nearest_float(value: Rational) -> float:
    """The nearest binary64 number; infinite where there is none."""
    try:
        return int(value.p) / int(value.q)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Work with this many bits inside the block."""
    before = ctx.prec
    ctx.prec = bits
    try:
        yield
    finally:
        ctx.prec = before


def working_bits() -> int:
    """The current precision."""
    return int(ctx.prec)


def ball(values: Exact) -> Balls:
    """Ball matrix of an exact one, at the current precision."""
    return arb_mat(_rational_matrix(values))


def _rational_matrix(values: Exact) -> fmpq_mat:
    return fmpq_mat(len(values), values.shape[1], values.ravel().tolist())


def exp_times(F: Exact, theta: float | Rational) -> Balls:
    """Ball matrix e^{F theta} for an exact F and the exact number a float theta is."""
    return arb_mat(_rational_matrix(F) * rational(theta)).exp()


def certify_positive_definite(S: Balls) -> bool:
    """Certify that the symmetric ball matrix S is positive definite for every choice inside.

    False proves nothing. Every pivot of L D L' must be certainly positive.
    """
    return certify_pivots([list(row) for row in S.tolist()])


def number(value: float) -> Ball:
    """Ball of a float, exactly."""
    return arb(rational(value))


def identity(n: int) -> Balls:
    """Ball identity matrix."""
    return arb_mat(fmpq_mat(n, n, [fmpq(int(i == j)) for i in range(n) for j in range(n)]))


def inverse(values: Exact) -> Exact | None:
    """Exact inverse of a square exact matrix; None if it is singular."""
    try:
        entries = _rational_matrix(values).inv().entries()
    except ZeroDivisionError:
        return None
    return np.array(entries, dtype=object).reshape(values.shape)


def characteristic_polynomial(F: Exact) -> list[Rational]:
    """Exact coefficients, constant term first, of det(s I - F)."""
    return list(_rational_matrix(F).charpoly().coeffs())


def middle(S: Balls) -> Matrix:
    """Float midpoints of a ball matrix: to steer by, never to compare."""
    return np.array([[float(x) for x in row] for row in S.tolist()])


def row_echelon(values: Exact) -> tuple[Exact, int]:
    """Reduced row echelon form of an exact matrix, and its rank."""
    reduced, rank = _rational_matrix(values).rref()
    return np.array(reduced.entries(), dtype=object).reshape(values.shape), int(rank)


def surely_observable(A: Exact, C: Exact) -> bool:
    """Certify that [C; C A; ...; C A^(n-1)] has full column rank n; exact A (n, n), C (p, n).

    Modulo a prime the rank can only fall, and numbers stay short. False proves nothing.
    """
    try:
        flow, rows = (_modulo_prime(X) for X in (A, C))
    except ZeroDivisionError:
        return False
    n, p = len(A), len(C)
    entries: list[nmod] = []
    for power in range(1, n + 1):
        entries += list(rows.entries())
        if p * power >= n and nmod_mat(p * power, n, entries, _PRIME).rank() == n:
            return True
        rows = rows * flow
    return False


def _modulo_prime(X: Exact) -> nmod_mat:
    return nmod_mat(len(X), X.shape[1], [_residue(x) for x in X.ravel().tolist()], _PRIME)


def _residue(value: Rational) -> int:
    top, bottom = int(value.p) % _PRIME, int(value.q) % _PRIME
    if bottom == 0:
        raise ZeroDivisionError
    return top * pow(bottom, -1, _PRIME) % _PRIME


def fixed_vector(blocks: list[Exact]) -> list[float] | None:
    """A nonzero v with X v = 0 for every block X, exactly; None if there is none."""
    stacked = np.vstack(blocks)
    reduced, rank = row_echelon(stacked)
    columns = stacked.shape[1]
    if rank == columns:
        return None
    leading = _leading(reduced, rank)
    free = next(j for j in range(columns) if j not in leading)
    vector = [fmpq(0)] * columns
    vector[free] = fmpq(1)
    for i, j in enumerate(leading):
        vector[j] = -reduced[i, free]
    return [nearest_float(v) for v in vector]


def rank_factors(H: Exact) -> tuple[Exact, Exact]:
    """(U, V) with H = U V' exactly, U and V of full column rank; both exact.

    U holds the first independent columns of H, V' the reduced row echelon form: H determines both.
    """
    reduced, rank = row_echelon(H)
    return H[:, _leading(reduced, rank)], reduced[:rank].T.copy()


def pivot_columns(H: Exact) -> list[int]:
    """The first independent columns of an exact matrix: those of U in `rank_factors`."""
    return _leading(*row_echelon(H))


def _leading(reduced: Exact, rank: int) -> list[int]:
    """Column of the first entry of each nonzero row of a row echelon form."""
    return [int(np.flatnonzero(row != 0)[0]) for row in reduced[:rank]]


def cholesky(S: Balls) -> Balls | None:
    """Ball matrix L, lower triangular, that contains the L of S = L L'.

    None if S is not certainly positive definite.
    """
    rows = [list(row) for row in S.tolist()]
    n = len(rows)
    lower = [[arb(0)] * n for _ in range(n)]
    for j in range(n):
        pivot = rows[j][j]
        for k in range(j):
            pivot = pivot - lower[j][k] * lower[j][k]
        if not pivot > 0:
            return None
        root = pivot.sqrt()
        lower[j][j] = root
        for i in range(j + 1, n):
            entry = rows[i][j]
            for k in range(j):
                entry = entry - lower[i][k] * lower[j][k]
            lower[i][j] = entry / root
    return arb_mat(lower)


def norm_bound(X: Balls) -> Ball:
    """Ball above the spectral norm of a ball matrix: (tr (X'X)^4)^(1/8), at most n^(1/8) of it."""
    gram = X.transpose() * X
    square = gram * gram
    power = (square * square).trace().abs_upper()
    return power.root(8) if power > 0 else power


def scalar(value: Number | int) -> Ball:
    """Ball of an exact number."""
    return arb(value)


def infinity() -> Ball:
    """Plus infinity, exact."""
    return arb("inf")


def lower_entries(S: Balls) -> list[Ball]:
    """Entries of the lower triangle of a square ball matrix, row by row."""
    return [x for i, row in enumerate(S.tolist()) for x in row[: i + 1]]


def combinations(weights: Balls, matrices: list[Balls]) -> list[list[Ball]]:
    """sum_j w_ij S_j for each row i of the weights; symmetric matrices, as lower_entries."""
    entries = [x for S in matrices for x in lower_entries(S)]
    stacked = arb_mat(len(matrices), len(entries) // len(matrices), entries)
    return [list(row) for row in (weights * stacked).tolist()]


def certify_pivots(rows: list[list[Ball]]) -> bool:
    """`certify_positive_definite` for rows of the lower triangle, which it consumes."""
    n = len(rows)
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            return False
        for i in range(k + 1, n):
            row = rows[i]
            factor = row[k] / pivot
            for j in range(k + 1, i + 1):
                row[j] -= factor * rows[j][k]
    return True


def exp_around(F: Exact, radius: float) -> Balls:
    """Ball matrix that contains e^{F s} for every |s| <= radius."""
    return (arb_mat(_rational_matrix(F)) * arb(0, radius)).exp()


def solve(A: Balls, b: Balls) -> Balls | None:
    """Ball solution of A x = b; None if A is not certainly invertible."""
    try:
        return A.solve(b)
    except ZeroDivisionError:
        return None


def upper_ends(X: Balls) -> Matrix:
    """Floats that are certainly at least the entries of a ball matrix, in its shape."""
    tops = [[x.upper() for x in row] for row in X.tolist()]
    rows = [[0.0 if x == 0 else math.nextafter(float(x), math.inf) for x in row] for row in tops]
    return np.array(rows, dtype=np.float64)


def entries(S: Balls) -> Exact:
    """A ball matrix as an object array, so that formulas with `+ - @ .T` run on it."""
    return np.array(S.tolist(), dtype=object)


def ball_matrix(values: Exact) -> Balls:
    """An object array of balls as a ball matrix: the inverse of `entries`."""
    return arb_mat(values.tolist())


def solve_entries(A: Exact, B: Exact) -> Exact | None:
    """A^-1 B for object arrays of balls; None unless A is certainly invertible."""
    solution = solve(ball_matrix(A), ball_matrix(B))
    return None if solution is None else entries(solution)


def around_zero(radius: Ball) -> Ball:
    """Ball [-r, r] for the largest r in a ball."""
    return arb(0, radius.abs_upper())


def ball_column(entries: list[Number]) -> Balls:
    """Ball matrix of one column from balls or exact numbers."""
    return arb_mat(len(entries), 1, entries)
