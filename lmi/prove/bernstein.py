"""Proof for all dwell times by boxes: Taylor polynomials in Bernstein form.

In coordinates where P is the identity the condition says N(theta)' N(theta) < gamma^2 I for
N(theta) = left e^{F theta} right. On a box [x, x + h], theta = x + u h, the product is a matrix
polynomial of degree 8 in u plus a remainder; a polynomial on [0, 1] lies in the convex hull of its
Bernstein coefficients B_i, so gamma^2 I - B_i - remainder > 0 for every i proves the whole box.

Everything that decides is ball arithmetic; floats choose box sizes only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    Rational,
    ball,
    certify_pivots,
    combinations,
    lower_entries,
    nearest_float,
    norm_bound,
    rational,
    scalar,
)
from lmi.time_budget import UNLIMITED, TimeBudget

DEGREE = 8
# A first box spans this many units of 1/||F||: longer ones fail on the remainder, shorter ones
# cost more of them.
_REACH = 2.0
_POWERS = 2 * DEGREE + 2
# boxes are made so wide that the remainder takes this share of gamma^2
_SHARE = 0.01
# failures in a row after which the balls are too wide, or the margin too small
_HALVINGS = 24
_WIDEST = 1e17


@dataclass(frozen=True)
class Normalised:
    """N(theta) = left e^{F theta} right in coordinates where P is the identity; ball matrices.

    others: further bounds S, N'N < gamma^2 S, to be proved along with N'N < gamma^2 I.
    """

    F: Balls
    left: Balls
    right: Balls
    gamma: float
    others: tuple[Balls, ...] = ()

    @property
    def size(self) -> int:
        """Dimension of the source coordinates."""
        return int(self.right.ncols())


@dataclass(frozen=True)
class Boxes:
    """Boxes over a range: their number, the smallest, or the theta where the proof failed.

    which: the bound that failed there, 0 the identity, then the others.
    """

    count: int
    smallest: float
    failed: float | None = None
    tail_from: float | None = None
    which: int = 0


@dataclass(frozen=True)
class _Series:
    """Powers left F^k / k! and what bounds the rest of the series."""

    powers: list[Balls]
    norms: list[Ball]
    growth: Ball
    to_bernstein: Balls

    @staticmethod
    def from_family(family: Normalised) -> _Series:
        power, powers, norms = family.left, [], []
        for k in range(_POWERS):
            if k:
                power = power * family.F * (scalar(1) / k)
            powers.append(power)
            norms.append(norm_bound(power))
        whole = family.F
        for _ in range(DEGREE):
            whole = whole * family.F
        growth = norm_bound(whole)
        return _Series(powers[: DEGREE + 1], norms, growth, _to_bernstein())

    def remainder(self, flow_norm: Ball, h: Ball) -> Ball | None:
        """Bound of the terms of N'N of degree above 8 in u, all orders of the series included.

        w_k bounds the norm of the k-th term of N. Terms beyond the stored norms shrink by
        ||F^9|| h^9 / (k + 1)...(k + 9) every nine orders, at most `ratio`.
        """
        ratio = self.growth * h ** (DEGREE + 1) / (_POWERS - DEGREE) ** (DEGREE + 1)
        if not ratio < 0.5:
            return None
        w = [norm * flow_norm * h**k for k, norm in enumerate(self.norms)]
        beyond = sum(w[-DEGREE - 1 :]) * ratio / (1 - ratio)
        total: Ball = sum(w) + beyond
        kept = sum(w[i] * w[j] for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i))
        return total * total - kept

    def fitting(self, flow_norm: Ball, width: float, wanted: float) -> float:
        """A width, at most twice the given one, whose remainder is near `wanted`; floats."""
        sizes = [float(norm) * float(flow_norm) for norm in self.norms]
        orders = range(DEGREE + 1)
        for _ in range(8):
            if width > _WIDEST:  # its powers overflow; nothing that moves fits so wide a box
                return width if not any(sizes[1:]) else _WIDEST
            w = [size * width**k for k, size in enumerate(sizes)]
            kept = sum(w[i] * w[j] for i in orders for j in range(DEGREE + 1 - i))
            total = sum(w)
            remainder = total * total - kept  # a power would raise where this is infinite
            if not remainder > 0:
                return 2 * width
            width *= min(2.0, (wanted / remainder) ** (1 / (DEGREE + 1)))
            if 0.5 * wanted < remainder < 2 * wanted:
                break
        return width


def prove_range(
    family: Normalised, low: float, high: float, limit: int, tails: list[Balls],
    *, budget: TimeBudget = UNLIMITED,
) -> Boxes:  # fmt: skip
    """Boxes over [low, high], or from low until one of the tails takes over (high infinite).

    tails: ball matrices Q in the coordinates of the flow such that right' e^{F't} Q e^{Ft} right
    bounds N'N and falls with t.
    """
    series = _Series.from_family(family)
    theta, end = rational(low), None if math.isinf(high) else rational(high)
    width, share = _first_width(series, high - low), _SHARE
    smallest, halvings, E = math.inf, 0, flow(family, theta)
    for count in range(1, limit + 1):
        if budget.remaining() < 0:
            return Boxes(count - 1, smallest, failed=nearest_float(theta))
        if not halvings and any(certify(family, E.transpose() * Q * E) for Q in tails):
            return Boxes(count - 1, smallest, tail_from=nearest_float(theta))
        size = norm_bound(E)
        width = series.fitting(size, width, share * family.gamma**2)
        following = theta + rational(width)
        if end is not None and following >= end:
            following = end
        if _box(family, series, E, size, following - theta):
            smallest, halvings, share = min(smallest, width), 0, min(_SHARE, 4 * share)
            if end is not None and following >= end:
                return Boxes(count, smallest)
            theta, E = following, flow(family, following)
            continue
        N = family.left * flow(family, (theta + following) / 2)
        settled = halvings < _HALVINGS and following > theta
        which = _unmet(family, [lower_entries(N.transpose() * N)], scalar(0))
        if not settled or which is not None:
            return Boxes(count, smallest, nearest_float((theta + following) / 2), which=which or 0)
        width, share, halvings = nearest_float(following - theta) / 2, share / 30, halvings + 1
    return Boxes(limit, smallest, failed=nearest_float(theta))


def flow(family: Normalised, theta: Rational) -> Balls:
    """e^{F theta} right, for a rational theta."""
    return (family.F * scalar(theta)).exp() * family.right


def certify(family: Normalised, S: Balls) -> bool:
    """Certify S < gamma^2 I, and the same for all other bounds."""
    return _unmet(family, [lower_entries(S)], scalar(0)) is None


def _unmet(family: Normalised, matrices: list[list[Ball]], remainder: Ball) -> int | None:
    """First bound that matrices (by their lower entries) plus remainder I may exceed, or None."""
    square = scalar(rational(family.gamma)) ** 2
    for which, S in enumerate((None, *family.others)):
        bound = _bound(family.size, square, S, remainder)
        if not all(_below(bound, entries) for entries in matrices):
            return which
    return None


def _bound(n: int, square: Ball, S: Balls | None, remainder: Ball) -> list[list[Ball]]:
    """Rows of the lower triangle of square S - remainder I; S None: the identity."""
    zero, whole = scalar(0), lower_entries(S) if S is not None else []
    rows = []
    for i in range(n):
        row = [x * square for x in whole[i * (i + 1) // 2 : (i + 1) * (i + 2) // 2]]
        row = row or [zero] * i + [square]
        row[-1] = row[-1] - remainder
        rows.append(row)
    return rows


def _below(bound: list[list[Ball]], entries: list[Ball]) -> bool:
    """Certify bound - entries > 0, both by lower entries."""
    at = iter(entries)
    return certify_pivots([[b - next(at) for b in row] for row in bound])


def _box(family: Normalised, series: _Series, E: Balls, size: Ball, width: Rational) -> bool:
    """Certify N'N < gamma^2 I on the whole box of this width from where E was taken."""
    h = scalar(width)
    remainder = series.remainder(size, h)
    if remainder is None or not remainder < scalar(rational(family.gamma)) ** 2:
        return False
    C = [power * E * h**k for k, power in enumerate(series.powers)]
    entries = combinations(series.to_bernstein, _coefficients(C))
    return _unmet(family, entries, remainder) is None


def _coefficients(C: list[Balls]) -> list[Balls]:
    """G_k of (sum C_i u^i)' (sum C_j u^j) = sum G_k u^k, k up to the degree; each symmetric."""
    turned = [X.transpose() for X in C]
    G = []
    for k in range(len(C)):
        terms = [turned[k // 2] * C[k // 2]] if k % 2 == 0 else []
        for i in range((k + 1) // 2):
            half = turned[i] * C[k - i]
            terms.append(half + half.transpose())
        G.append(sum(terms[1:], terms[0]))
    return G


def _to_bernstein() -> Balls:
    """B_i = sum_j C(i, j) / C(d, j) G_j on [0, 1], exactly: see the module's text."""
    return ball(_weights())


@lru_cache(maxsize=1)
def _weights() -> Exact:
    d = DEGREE
    weights = [[rational(math.comb(i, j)) / math.comb(d, j) for j in range(d + 1)]
               for i in range(d + 1)]  # fmt: skip
    table = np.array(weights, dtype=object)
    table.setflags(write=False)
    return table


def _first_width(series: _Series, length: float) -> float:
    """Box width to begin with: a fixed reach against the ninth root of ||F^9||."""
    rate = float(series.growth) ** (1 / (DEGREE + 1))
    return min(length, _REACH / rate) if rate > 0 and math.isfinite(rate) else min(length, 1.0)
