"""Bounds of |e^(Fs) X| for all s >= 0 by the moduli of invariant subspaces of F, in balls.

    x = T z,   z_k in R or R^2,   z' = T^-1 F T z,   |z|' <= W |z|

T from eigenvectors, deflated one after the other, the slowest first, pairs turned into rotations,
those that are nearly real split, since their basis would be nearly dependent: W is nearly
triangular, and T far from singular, whatever is defective in F. With N = (-W)^-1 >= 0, proved,

    |z(s)| <= |z(0)| + N max(W |z(0)|, 0)   for all s >= 0,   int_0^inf |z| ds <= N |z(0)|

since no z within the first bound leaves it. Fast modes that have decayed count no longer, which a
bound by ||F|| knows nothing of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    ball,
    ball_matrix,
    entries,
    exact,
    scalar,
    solve_entries,
    to_float,
)
from lmi.arithmetic.norms import nonnegative_inverse, upper_balls

# Pairs with imaginary parts below this part of the modulus are split: the real part of the vector,
# then what is orthogonal to it. A double pole is computed as such a pair. The coupling this leaves
# is in W.
_NEARLY_REAL = 0.1


@dataclass(frozen=True)
class FlowComparison:
    """ends: of the subspaces; back = T^-1 (n, n), W, N (K, K), sizes (n, K): |x| <= sizes |z|."""

    ends: tuple[tuple[int, int], ...]
    back: Balls
    W: Exact
    N: Exact
    sizes: Exact

    @staticmethod
    def from_flow(F: Exact) -> FlowComparison | None:
        """For F (n, n) exact, at the current precision; None where decay is not proved."""
        basis, ends = _invariant_basis(to_float(F))
        if not np.isfinite(basis).all():
            return None
        T, unit = entries(ball(exact(basis))), entries(ball(exact(np.eye(len(F)))))
        back = solve_entries(T, unit)
        if back is None:
            return None
        own = entries(ball_matrix(back) * ball(F) * ball_matrix(T))
        W = np.array([[_coupling(own[a:b, c:d], a == c) for c, d in ends] for a, b in ends])
        N = _negative_inverse(W)
        if N is None:
            return None
        sizes = np.array([[_norm(row[a:b]) for a, b in ends] for row in T])
        return FlowComparison(tuple(ends), ball_matrix(back), W, N, sizes)

    def largest(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of |e^(Fs) X| for all s >= 0."""
        first = self._moduli(X)
        growth = _uppers_of_positive(self.W @ first)
        return upper_balls(self.sizes @ (first + self.N @ growth))

    def integrals(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of the integrals of |e^(Fs) X| over s >= 0."""
        return upper_balls(self.sizes @ (self.N @ self._moduli(X)))

    def _moduli(self, X: Balls) -> Exact:
        """|z|, (K, k), for each column of X = T z."""
        z = entries(self.back * X)
        return np.array([[_norm(column) for column in z[a:b].T] for a, b in self.ends])


def _invariant_basis(F: Matrix) -> tuple[Matrix, list[tuple[int, int]]]:
    """Columns T (n, n) and the ends of invariant subspaces, each in the span of it and earlier."""
    n = len(F)
    Q, T, ends, first = np.eye(n), np.eye(n), list[tuple[int, int]](), 0
    while first < n:
        left = Q[:, first:]
        values, vectors = np.linalg.eig(left.T @ F @ left)
        slowest = int(np.argmax(values.real))
        vector = vectors[:, slowest]
        is_split = abs(values[slowest].imag) <= _NEARLY_REAL * abs(values[slowest])
        part = vector.real[:, None] if is_split else np.array([vector.real, vector.imag]).T
        end = first + part.shape[1]
        T[:, first:end] = left @ part
        Q[:, first:] = left @ np.linalg.qr(part, mode="complete")[0]
        ends.append((first, end))
        first = end
    return T, ends


def _coupling(block: Exact, is_own: bool) -> Ball:
    """An upper bound of what |z_l| adds to |z_k|'; of z_k itself the logarithmic norm."""
    bound: Ball = _norm(block.ravel())
    if is_own and len(block) == 1:
        bound = block[0, 0]
    elif is_own:
        (a, b), (c, d) = block
        bound = (a + d) / 2 + _norm(np.array([(a - d) / 2, (b + c) / 2]))
    return bound.upper()


def _negative_inverse(W: Exact) -> Exact | None:
    """Upper bounds of (-W)^-1 >= 0 for W that is nonnegative off its diagonal; None: not proved."""
    rates = -np.diag(W)
    if not all(rate > 0 for rate in rates):
        return None
    zero = scalar(0)
    relative = [
        [zero if i == j else W[i, j] / rates[i] for j in range(len(W))] for i in range(len(W))
    ]
    back = nonnegative_inverse(relative)
    return None if back is None else upper_balls(np.array(back) / rates)


def _norm(values: Exact) -> Ball:
    """An upper bound of the Euclidean norm."""
    norm: Ball = abs(values[0])
    if len(values) > 1:
        norm = sum((value * value for value in values), scalar(0)).abs_upper().sqrt()
    return norm.upper()


def _uppers_of_positive(values: Exact) -> Exact:
    zero = scalar(0)
    uppers = [zero.max(value).upper() for value in values.ravel()]
    return np.array(uppers, dtype=object).reshape(values.shape)
