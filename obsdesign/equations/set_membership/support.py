"""How much a disturbance can move the state along a direction: certified upper bound.

    sigma_h(p) = sum_j int_0^h |p' e^{A s} b_j| ds

is what b(t) = sum_j b_j w_j(t), |w_j| <= 1, adds to p'x(h) at most. A step is cut into pieces of
length d; on a piece with midpoint s_i, with

    F0 = int e^{A s} b_j ds,  FM = e^{A s_i} b_j,  F1 = A FM,  E2 >= |A^2 e^{A s} b_j| on the piece,
    l0 = |p'FM|,  l1 = |p'F1|,  l2 = |p|'E2,  g(s) = p' e^{A s} b_j,

the Taylor polynomial l0 + l1 (s - s_i) of g is off by l2 (s - s_i)^2 / 2 at most. Three bounds of
the integral of |g| over the piece follow:

    |p'F0|                               where l0 >= l1 d/2 + l2 d^2/8: g has one sign
    |p'F0| + (l1 + l2 d/2) d^2/4         g has a slope of at most l1 + l2 d/2
    [integral of |l0 + l1 s|] + l2 d^3/24

A fourth, |p|'E0, serves pieces that are long for the flow: |e^{A s} b_j| <= e^{Mz(A) s} |b_j|,
where Mz keeps the diagonal and takes absolute values elsewhere, so that E0 = |e^{A s_0}| int
e^{Mz(A) s} ds |b_j| with s_0 the start of the piece and the integral over its length.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT

# roundings of the formulas below, generously: every value is raised by that many
_ROUNDINGS = 1.0 + 64 * UNIT


def piece_bound(
    total: Matrix, l0: tuple[Matrix, Matrix], l1: Matrix, l2: Matrix, d: Matrix
) -> Matrix:
    """Upper bound of the integral of |g| over pieces of length at most d, entry by entry.

    total, l1, l2: upper bounds of |p'F0|, |p'F1| and |p|'E2; l0: lower and upper bound of |p'FM|.
    """
    low, high = l0
    half = 0.5 * d
    slope = l1 * half
    bend = l2 * (half * half)
    is_signed = low * (1.0 - 8 * UNIT) >= (slope + 0.5 * bend) * _ROUNDINGS
    crossing = total + (slope + bend) * half
    # of |l0 + l1 s|: l0 d where it keeps its sign, else l1 d^2 / 4 + l0^2 / l1
    crossed = slope * half + high * (high / np.where(l1 > 0, l1, 1.0))
    line = np.where(high >= slope, high * d, crossed)
    taylor = line + bend * (d / 6.0)
    return np.where(is_signed, total, np.minimum(crossing, taylor)) * _ROUNDINGS
