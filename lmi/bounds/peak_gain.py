"""Peak gain of a bounded input: bounds of the integral of |C e^(Fs) B|, by entries.

    integral |c e^(Fs) b| ds <= sqrt(b' P b) / sqrt(2a),   (F + aI)'P + P(F + aI) = -c'c

by Cauchy and Schwarz with weights e^(as) and e^(-as); a below the decay rate of F. Each column b
meets the modes it drives alone, so that fast modes do not pay for slow ones. From below the
integral is at least |c F^-1 b|, what a constant input leaves.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
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
from lmi.prove.hurwitz import prove_hurwitz, rightmost

# parts of the decay rate tried for a, in turn
_SHARES = (0.5, 0.1, 0.01)
_BITS = 256


def peak_gains(F: Exact, B: Exact, C: Exact) -> tuple[Matrix, Matrix] | None:
    """(lower, upper) float bounds of the integrals, each (rows of C, columns of B).

    F (k, k) Hurwitz, all exact. None where no a could be proved.
    """
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
    """sqrt(b' P b / (2 rate)) for every c and b; None unless F + rate I is proved Hurwitz."""
    if not (np.isfinite(rate) and rate > 0):
        return None
    k = len(F)
    shifted = F + exact(rate * np.eye(k))
    if prove_hurwitz(shifted).outcome != "proved":
        return None
    eye = exact(np.eye(k))
    operator = np.kron(eye, shifted.T) + np.kron(shifted.T, eye)
    right = np.array([-np.kron(c, c) for c in C], dtype=object).T
    solution = solve_entries(entries(ball(operator)), entries(ball(right)))
    if solution is None:
        return None
    weight = 1 / (2 * scalar(exact(rate).item()))
    columns = entries(ball(B))
    result = np.zeros((len(C), B.shape[1]))
    for i in range(len(C)):
        P = solution[:, i].reshape(k, k)
        squares = (columns * (P @ columns)).sum(axis=0) * weight
        result[i] = [float_above(square.abs_upper().sqrt()) for square in squares]
    return result


def _below(F: Exact, B: Exact, C: Exact) -> Matrix:
    """|C F^-1 B|."""
    solution = solve_entries(entries(ball(F)), entries(ball(B)))
    if solution is None:
        return np.zeros((len(C), B.shape[1]))
    left = entries(ball(C)) @ solution
    return np.array([[float_below(abs(x).abs_lower()) for x in row] for row in left]).clip(0.0)
