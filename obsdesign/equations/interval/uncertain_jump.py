"""A jump at an uncertain time: the states at the end of its window, polynomials of it.

    x' = A x + beta + b      x+ = G x + gamma + c  at a time sigma of [0, h]

With X = (x, beta, gamma), Z = [A I 0; 0 0 0; 0 0 0] and Y = [G 0 I; 0 I 0; 0 0 I] the state at h
is, without b and c, the first rows of

    y(sigma) = e^{Z (h - sigma)} Y e^{Z sigma} X
    dy/dsigma = e^{Z (h - sigma)} (Y Z - Z Y) e^{Z sigma} X

so that, eta = 2 sigma / h - 1 from -1 to 1,

    y = sum_k eta^k e^{Z h/2} P_k e^{Z h/2} X
    P_0 = Y,   P_{k+1} = (P_k Z - Z P_k) h / (2 (k + 1))

up to e^{|Z| h} |P_{d+1}| e^{|Z| h} |X| after the term of degree d. Where G = I nothing but gamma
depends on sigma: the commutators of I and A vanish.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import comb

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, expm, raised, stack

DEGREE = 12  # of the polynomials
MOST_CURVES = 8  # of the last events that are kept apart; older ones are part of a box
_LONGEST = 4.0  # window for one polynomial, in units of the flow
_MOST_PARTS = 1024
_SLICES = 4  # of [-1, 1], on each of which a polynomial is bounded by its Bernstein coefficients


@dataclass(frozen=True)
class UncertainJump:
    """Coefficients of a window of one length.

    terms: of eta^k, (n, 3n) each; remainder (n, 3n): times |X|; x_spread, b_spread, c_spread
    (n, n): the radius that those of x, b and c leave.
    """

    terms: tuple[Enclosure, ...]
    remainder: Matrix
    x_spread: Matrix
    b_spread: Matrix
    c_spread: Matrix

    @classmethod
    def from_window(cls, A: Matrix, G: Matrix, h: float, error: float) -> UncertainJump:
        """Of a window of length h, known to +- error."""
        n = len(A)
        Y = _augmented(G, np.zeros_like(A), np.eye(n), diagonal=1.0)
        Z = _augmented(A, np.eye(n), np.zeros_like(A), diagonal=0.0)
        half = Enclosure.exactly(Z).scaled(0.5 * h, 0.5 * error)
        flow, P = expm(half), Enclosure.exactly(Y)
        top = Enclosure(flow.mid[:n], flow.rad[:n])
        terms = []
        for k in range(DEGREE + 1):
            terms.append(top @ P @ flow)
            P = (P @ half - half @ P).scaled(1.0 / (k + 1), UNIT / (k + 1))
        size = expm(Enclosure.exactly(np.abs(Z)).scaled(h, error)).upper
        remainder = raised(raised(size[:n] @ _magnitude(P), 6 * n) @ size, 6 * n)
        total = raised(sum(_magnitude(term) for term in terms) + remainder, len(terms) + 1)
        b_spread = _spread_of_flow(A, G, h, error)
        return cls(tuple(terms), remainder, total[:, :n], b_spread, total[:, 2 * n :])

    def polynomial(
        self, centre: Matrix, radius: Matrix, beta: Enclosure, gamma: Enclosure
    ) -> tuple[Matrix, Matrix]:
        """(coefficients (d + 1, n), radius (n,)) of the states at the end of the window.

        centre, radius (n,): a box of states at its start; beta, gamma (n, 1): middles of the input
        and of what the jump adds. Radii of b and c come to that in addition.
        """
        X = stack([[Enclosure.exactly(centre[:, None])], [beta], [gamma]])
        values = [term @ X for term in self.terms]
        size = raised(np.abs(X.mid) + X.rad, 1)
        terms = 4 * len(size) + 8
        spread = raised(self.remainder @ size, terms)[:, 0] + raised(self.x_spread @ radius, terms)
        spread = raised(spread + sum(value.rad[:, 0] for value in values), len(values) + 3)
        return np.array([value.mid[:, 0] for value in values]), spread


def parts_of(A: Matrix, h: float) -> int:
    """Parts of a time h in which the flow changes little."""
    norm = min(float(np.abs(A).sum(axis=axis).max(initial=0.0)) for axis in (0, 1))
    return int(np.clip(np.ceil(norm * h), 1, _MOST_PARTS))


def is_short(A: Matrix, h: float) -> bool:
    """Does one polynomial do for a window of length h?"""
    return parts_of(A, h) <= _LONGEST


def added_in_parts(
    jump: UncertainJump,
    A: Matrix,
    h: float,
    error: float,
    parts: int,
    added: tuple[Enclosure, Matrix],
) -> tuple[Matrix, Matrix]:
    """(box [lower; -upper], direction (n,)) of what an event with G = I adds in a long window.

    jump: of one of its parts, of length h; added: middle (n, 1) and radius of what the event adds.
    The sum of the box and of eta times the direction, eta from -1 to 1 the time of the event.
    """
    n, zero = len(A), np.zeros(len(A))
    coefficients, radius = jump.polynomial(zero, zero, Enclosure.exactly(zero[:, None]), added[0])
    radius = raised(radius + raised(jump.c_spread @ added[1], 2 * n), 2)
    W = np.where(np.eye(n, dtype=bool), A, np.abs(A))
    flow, growth = expm(Enclosure.exactly(A).scaled(h, error)), np.maximum(
        expm(Enclosure.exactly(W).scaled(h, error)).upper, 0.0
    )  # fmt: skip
    middles, ends = [], []
    for _ in range(parts):  # from the last part back to the first
        low, high = curve_range(coefficients[1:])
        middles.append(coefficients[0])
        ends.append((coefficients[0] + low - radius, coefficients[0] + high + radius))
        after = flow @ Enclosure.exactly(coefficients.T)
        radius = raised(raised(growth @ radius, 2 * n) + after.rad.sum(axis=1), DEGREE + 4)
        coefficients = after.mid.T
    eta = 1.0 - (2.0 * np.arange(parts) + 1.0) / parts
    direction = (eta[:, None] * np.array(middles)).sum(axis=0) / float((eta**2).sum() or 1.0)
    reach = np.outer(eta, direction), np.abs(direction) / parts
    low = np.array([end for end, _ in ends]) - reach[0] - reach[1]
    high = np.array([end for _, end in ends]) - reach[0] + reach[1]
    margin = 8 * UNIT * (np.abs(low) + np.abs(high) + 2 * np.abs(direction))
    box = np.concatenate([(low - margin).min(axis=0), -(high + margin).max(axis=0)])
    return np.nextafter(box, -np.inf), direction


def curve_range(curve: Matrix) -> tuple[Matrix, Matrix]:
    """Lower and upper bounds (n,) of sum_k curve[k - 1] eta^k, eta from -1 to 1; curve (d, n)."""
    weights = _bernstein(len(curve))
    values, sizes = weights @ curve, np.abs(weights) @ np.abs(curve)
    error = raised((2 * len(curve) + 8) * UNIT * sizes, 4)
    return (values - error).min(axis=0), (values + error).max(axis=0)


@cache
def _bernstein(degree: int) -> Matrix:
    """Bernstein coefficients of eta, ..., eta^degree on slices of [-1, 1], ((d + 1) slices, d)."""
    width, rows = Fraction(2, _SLICES), []
    for slice_ in range(_SLICES):
        low = -1 + width * slice_
        powers = [
            [comb(k, m) * low ** (k - m) * width**m for m in range(k + 1)]
            for k in range(1, degree + 1)
        ]
        for j in range(degree + 1):
            share = [Fraction(comb(j, m), comb(degree, m)) for m in range(j + 1)]
            rows.append([
                float(sum(x * y for x, y in zip(share, power, strict=False))) for power in powers
            ])  # fmt: skip
    return np.array(rows)


def _augmented(first: Matrix, second: Matrix, third: Matrix, *, diagonal: float) -> Matrix:
    """[first second third; 0 d 0; 0 0 d]."""
    n = len(first)
    whole = diagonal * np.eye(3 * n)
    whole[:n] = np.hstack([first, second, third])
    return whole


def _magnitude(X: Enclosure) -> Matrix:
    """Upper bound of |X|, zero where X is."""
    return np.where((X.mid == 0) & (X.rad == 0), 0.0, X.magnitude)


def _spread_of_flow(A: Matrix, G: Matrix, h: float, error: float) -> Matrix:
    """Bound of what b of radius one leaves at the end, (n, n)."""
    n = len(A)
    if np.array_equal(G, np.eye(n)):  # int_0^h e^{Mz(A) s} ds
        W = np.where(np.eye(n, dtype=bool), A, np.abs(A))
        Z = np.block([[W, np.eye(n)], [np.zeros((n, 2 * n))]])
        return np.maximum(expm(Enclosure.exactly(Z).scaled(h, error)).upper[:n, n:], 0.0)
    # |y| <= int_0^h max(e^{|A| h} |G| e^{|A| h}, e^{|A| h}) |b|
    size = expm(Enclosure.exactly(np.abs(A)).scaled(h, error)).upper
    through = raised(raised(size @ np.abs(G), 2 * n) @ size, 2 * n)
    return raised(np.maximum(through, size) * (h + error), 2)
