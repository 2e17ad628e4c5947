"""Bounds of |e^(Fs) X| for all s >= 0 by the moduli of invariant subspaces of F, in balls.

    x = T z,   z_k in R or R^2,   z' = T^-1 F T z,   |z|' <= W |z|

T from eigenvectors, deflated one after the other, the slowest first, pairs turned into rotations,
those that are nearly real split, since their basis would be nearly dependent. So W is nearly
triangular, and T far from singular, whatever is defective in F. What a subspace takes of earlier
ones is then taken out of it, unless it is much: W is nearly diagonal where eigenvectors are far
from dependent. With N = (-W)^-1 >= 0, proved,

    |z(s)| <= |z(0)| + N max(W |z(0)|, 0)   for all s >= 0,   int_0^inf |z| ds <= N |z(0)|

since no z within the first bound leaves it. Fast modes that have decayed count no longer, which a
bound by ||F|| knows nothing of. How much is much is not known beforehand: bases for two answers are
used, and of their bounds the smaller ones, entry by entry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
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
from lmi.arithmetic.norms import float_above, least_balls, middles, nonnegative_inverse, upper_balls

# Pairs with imaginary parts below this part of the modulus are split: the real part of the vector,
# then what is orthogonal to it. A double pole is computed as such a pair. The coupling this leaves
# is in W.
_NEARLY_REAL = 0.1
# what is taken out of a subspace, at most, in parts of it: eigenvectors of nearly equal poles need
# more and are left coupled
_MOST_TAKEN = (3.0, 30.0)

Ends = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Subspaces:
    """x = T z, (n, n): z_k between ends[k]; back = T^-1, |z|' <= W |z|, N = (-W)^-1, (K, K).

    sizes (n, K): |x| <= sizes |z|; eigenvalues (K,): estimates, complex for pairs.
    """

    ends: Ends
    T: Balls
    back: Balls
    W: Balls
    N: Balls
    sizes: Balls
    eigenvalues: Array

    @staticmethod
    def from_basis(F: Exact, basis: Matrix, ends: Ends) -> Subspaces | None:
        """F (n, n) exact, basis (n, n) floats; None where decay is not proved in it."""
        if not np.isfinite(basis).all():
            return None
        T = ball(exact(basis))
        solved = solve_entries(entries(T), entries(ball(exact(np.eye(len(F))))))
        if solved is None:
            return None
        back = ball_matrix(solved)
        own = entries(back * ball(F) * T)
        W = np.array([[_coupling(own[a:b, c:d], a == c) for c, d in ends] for a, b in ends])
        N = _negative_inverse(W)
        if N is None:
            return None
        sizes = np.array([[_norm(row[a:b]) for a, b in ends] for row in entries(T)])
        eigenvalues = np.array([_eigenvalue(own[a:b, a:b]) for a, b in ends])
        return Subspaces(
            ends, T, back, ball_matrix(W), ball_matrix(N), ball_matrix(sizes), eigenvalues
        )

    def largest(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of |e^(Fs) X| for all s >= 0."""
        first = self.moduli(X)
        growth = ball_matrix(_uppers_of_positive(entries(self.W * first)))
        return upper_balls(entries(self.sizes * (first + self.N * growth)))

    def integrals(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of the integrals of |e^(Fs) X| over s >= 0."""
        return upper_balls(entries(self.sizes * (self.N * self.moduli(X))))

    def parts(self, X: Balls) -> list[Balls]:
        """X (n, k) as a sum over the subspaces."""
        columns, rows = entries(self.T), entries(self.back * X)
        return [ball_matrix(columns[:, a:b]) * ball_matrix(rows[a:b]) for a, b in self.ends]

    def coupled_integrals(self, X: Balls) -> Matrix:
        """Estimates (n, k) of `integrals` without the largest of those by one subspace alone."""
        whole = _floats(entries(self.sizes * (self.N * self.moduli(X))))
        rates = -np.diag(_floats(entries(self.W)))
        alone = _floats(entries(self.sizes))[:, :, None] * _floats(entries(self.moduli(X)))
        result: Matrix = whole - (alone / rates[:, None]).max(axis=1)
        return result

    def moduli(self, X: Balls) -> Balls:
        """|z|, (K, k), for each column of X = T z."""
        z = entries(self.back * X)
        return ball_matrix(np.array([[_norm(column) for column in z[a:b].T] for a, b in self.ends]))


@dataclass(frozen=True)
class FlowComparison:
    """Subspaces by several bases, in each of which decay is proved."""

    bases: tuple[Subspaces, ...]

    @staticmethod
    def from_flow(F: Exact) -> FlowComparison | None:
        """For F (n, n) exact, at the current precision; None where decay is not proved."""
        flow = to_float(F)
        basis, ends = _invariant_basis(flow)
        little, much = (_decoupled(flow, basis, ends, most) for most in _MOST_TAKEN)
        different = [little] if np.array_equal(little, much) else [little, much]
        bases = [Subspaces.from_basis(F, each, ends) for each in different]
        proved = tuple(each for each in bases if each is not None)
        return FlowComparison(proved) if proved else None

    def largest(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of |e^(Fs) X| for all s >= 0."""
        return reduce(least_balls, (basis.largest(X) for basis in self.bases))

    def integrals(self, X: Balls) -> Exact:
        """Upper bounds (n, k) of the integrals of |e^(Fs) X| over s >= 0."""
        return reduce(least_balls, (basis.integrals(X) for basis in self.bases))


def _invariant_basis(F: Matrix) -> tuple[Matrix, Ends]:
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
    return T, tuple(ends)


def _decoupled(F: Matrix, T: Matrix, ends: Ends, most: float) -> Matrix:
    """The basis (n, n) with each subspace freed of earlier ones.

    As far as that takes at most `most` of them. One after the other, so that none brings back
    what an earlier step has taken out.
    """
    if not np.isfinite(T).all():
        return T
    own: Matrix = np.asarray(np.linalg.solve(T, F @ T), np.float64)
    unit = np.eye(len(F))
    for place, (c, d) in enumerate(ends):
        for a, b in reversed(ends[:place]):
            Y = _sylvester(own[a:b, a:b], own[c:d, c:d], own[a:b, c:d])
            if not np.linalg.norm(Y) <= most:
                continue
            step, back = unit.copy(), unit.copy()
            step[a:b, c:d], back[a:b, c:d] = Y, -Y
            own, T = back @ own @ step, T @ step
    return T


def _sylvester(A: Matrix, B: Matrix, C: Matrix) -> Matrix:
    """Y with A Y - Y B = -C; NaN where there is none."""
    p, q = C.shape
    equation = np.kron(A, np.eye(q)) - np.kron(np.eye(p), B.T)
    try:
        return np.asarray(np.linalg.solve(equation, -C.ravel()).reshape(p, q), np.float64)
    except np.linalg.LinAlgError:
        return np.full((p, q), np.nan)


def _coupling(block: Exact, is_own: bool) -> Ball:
    """An upper bound of what |z_l| adds to |z_k|'; of z_k itself the logarithmic norm."""
    bound: Ball = _norm(block.ravel())
    if is_own and len(block) == 1:
        bound = block[0, 0]
    elif is_own:
        (a, b), (c, d) = block
        bound = (a + d) / 2 + _norm(np.array([(a - d) / 2, (b + c) / 2]))
    return bound.upper()


def _eigenvalue(block: Exact) -> complex:
    """The only one, or of a pair that with positive imaginary part; an estimate."""
    return complex(max(np.linalg.eigvals(middles(block)), key=np.imag))


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


def _floats(values: Exact) -> Matrix:
    return np.array([[float_above(value) for value in row] for row in values])
