"""Peak gain of a bounded input: bounds of the integral of |C e^(Fs) B|, by entries.

    integral |c e^(Fs) b| ds <= sqrt(b' P b) / sqrt(2a),   (F + aI)'P + P(F + aI) = -c'c

by Cauchy and Schwarz with weights e^(as) and e^(-as); a below the decay rate of F. Each column b
meets the modes it drives alone, so that fast modes do not pay for slow ones. From below the
integral is at least |c F^-1 b|, what a constant input leaves.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Balls,
    Exact,
    ball,
    entries,
    exact,
    precision,
    scalar,
    solve_entries,
    to_float,
)
from lmi.arithmetic.norms import float_above, float_below
from lmi.memory import require_memory
from lmi.prove.hurwitz import prove_hurwitz, rightmost

# parts of the decay rate tried for a, in turn
_SHARES = (0.5, 0.1, 0.01)
_BITS = 256
_NUMBERS_PER_BALL = 80  # measured, in floats, for each entry of a matrix that is factored


def peak_gains(F: Exact, B: Exact, C: Exact) -> tuple[Matrix, Matrix] | None:
    """(lower, upper) float bounds of the integrals, each (rows of C, columns of B).

    F (k, k) Hurwitz, all exact. None where no a could be proved.
    OversizeError where the Lyapunov equation for k (k + 1) / 2 numbers is too large.
    """
    k = len(F)
    require_memory(
        f"a Lyapunov equation of {k} states in balls",
        _NUMBERS_PER_BALL * (k * (k + 1) / 2) ** 2,
        "fewer states are required",
    )
    if not F.size or not B.size or not C.size:
        nothing = np.zeros((len(C), B.shape[1]))
        return nothing, nothing
    with precision(_BITS):
        decay = -rightmost(to_float(F)).real
        for share in _SHARES if decay > 0 else ():
            rate = math.ldexp(1.0, math.frexp(share * decay)[1] - 1)  # the same on all machines
            if (bound := _above(F, B, C, rate)) is not None:
                return _below(F, B, C), bound
    return None


def _above(F: Exact, B: Exact, C: Exact, rate: float) -> Matrix | None:
    """sqrt(b' P b / (2 rate)) for every c and b; None where `decaying_integrals` is."""
    bound = decaying_integrals(F, C, rate)
    if bound is None:
        return None
    values = bound(ball(B))
    return np.array([[float_above(value) for value in row] for row in values])


def decaying_integrals(F: Exact, C: Exact, rate: float) -> Callable[[Balls], Exact] | None:
    """B -> upper bounds in balls of the integrals of |C e^(Fs) B|, (rows of C, columns of B).

    rate: the a of the inequality. None unless it is positive and F + rate I proved Hurwitz.
    """
    if not (np.isfinite(rate) and rate > 0):  # an estimate may have any sign near the limit
        return None
    shifted = F + exact(rate * np.eye(len(F)))
    if prove_hurwitz(shifted).outcome != "proved":
        return None
    solution = _lyapunov_matrices(shifted, C)
    if solution is None:
        return None
    weight = 1 / (2 * scalar(exact(rate).item()))

    def integrals(B: Balls) -> Exact:
        columns = entries(B)
        squares = [(columns * (P @ columns)).sum(axis=0) * weight for P in solution]
        roots = [[square.abs_upper().sqrt() for square in row] for row in squares]
        return np.array(roots, dtype=object).reshape(len(C), columns.shape[1])

    return integrals


def _lyapunov_matrices(F: Exact, C: Exact) -> list[Exact] | None:
    """P of F'P + P F = -c'c for each row c, in the entries of its upper triangle, in balls."""
    k = len(F)
    rows, columns = np.triu_indices(k)
    count = len(rows)
    place = np.zeros((k, k), dtype=np.intp)
    place[rows, columns] = place[columns, rows] = np.arange(count)
    operator = exact(np.zeros((count, count)))
    for equation, (i, j) in enumerate(zip(rows, columns, strict=True)):
        for m in range(k):
            operator[equation, place[m, j]] += F[m, i]
            operator[equation, place[i, m]] += F[m, j]
    right = np.array([-c[rows] * c[columns] for c in C], dtype=object).T
    solution = solve_entries(entries(ball(operator)), entries(ball(right)))
    return None if solution is None else [column[place] for column in solution.T]


def _below(F: Exact, B: Exact, C: Exact) -> Matrix:
    """|C F^-1 B|."""
    solution = solve_entries(entries(ball(F)), entries(ball(B)))
    if solution is None:
        return np.zeros((len(C), B.shape[1]))
    left = entries(ball(C)) @ solution
    return np.array([[float_below(abs(x).abs_lower()) for x in row] for row in left]).clip(0.0)
