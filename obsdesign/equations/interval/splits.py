"""Interval observers for linear impulsive systems: the formulas.

    x'(t) = A x + B u + b(t)          between jumps,   lower <= b <= upper
    x(t)  = G x(t-) + E w + c         at jumps,        lower <= c <= upper
    y     = C x + v,                  |v_i(t)| <= V_i at every instant

Source: K. H. Degue, D. Efimov, J.-P. Richard, Interval Observers for Linear Impulsive Systems,
NOLCOS 2016: observers (6) (Theorem 5) and (11) (Theorem 8). Deviations from the print, with
reasons in docs/papers.md: the measurement used at a jump is the pre-jump one (the print says
post-jump, which breaks the enclosure); J of (10) has second row [n, p]; stability is tested on
the n-dimensional pair (D0 + D1, p + n), which is equivalent to (10) and cheaper.

Notation
    flow_error_matrix   F = A - L C                  n x n
    jump_error_matrix   H = G - M C  (pre-jump y), (I - M C) G  (post-jump y), G (no y)   n x n
    D0, D1              F = D0 - D1, D0 Metzler, D1 >= 0
    Gp, Gn              H = Gp - Gn, Gp >= 0, Gn >= 0
    S, S2, T            coordinates x = S z (x = S2 z2 at jumps, where T = S2^-1 H S2)
The width w = upper - lower: `obsdesign.equations.interval.width`.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix


def in_coordinates(X: Array, S: Array | None, S_inverse: Array | None) -> Array:
    """S^-1 X S: a map of x in the coordinates z of x = S z; X itself where there are none."""
    return X if S is None else S_inverse @ X @ S


def flow_and_jump(
    A: Array, C: Array, G: Array | None, *, L: Array, M: Array, jump_measurement: str,
    is_periodic: bool,
) -> tuple[Array, Array | None]:  # fmt: skip
    """(F, H) that the splits are of, in x: the error between events and at jumps.

    With samples as events (`is_periodic`) neither L nor M acts there: (A, G). H is None without
    jumps.
    """
    if is_periodic:
        return A, G
    F = flow_error_matrix(A, L, C)
    return F, None if G is None else jump_error_matrix(G, M, C, jump_measurement)


def positive_part(X: Array) -> Array:
    """X+ = max(X, 0) of section 2.2."""
    part: Array = np.maximum(X, 0 * X)
    return part


def metzler_split(F: Array) -> tuple[Array, Array]:
    """Minimal D0 (Metzler), D1 >= 0 with F = D0 - D1: no other split has a smaller D0 + D1."""
    diagonal = np.diag(np.diag(F))
    return diagonal + positive_part(F - diagonal), positive_part(diagonal - F)


def nonnegative_split(H: Array) -> tuple[Array, Array]:
    """Minimal Gp, Gn >= 0 with H = Gp - Gn: H+ and H-."""
    return positive_part(H), positive_part(-H)


def absolute_metzler(X: Array) -> Array:
    """Diagonal of X kept, the other entries replaced by their absolute values."""
    plus, minus = metzler_split(X)
    return plus + minus


def completed_split(X: Array, plus: Array, minus: Array) -> tuple[Array, Array]:
    """The split of X itself that is nearest to a stored (rounded) one.

    plus - minus may differ from X by rounding; the remainder E = plus - minus - X goes where it
    keeps signs: plus + E-, minus + E+. In exact arithmetic the result is an exact split.
    """
    remainder = plus - minus - X
    return plus + positive_part(-remainder), minus + positive_part(remainder)
