"""Componentwise error of a gain on a window of samples, under bounded disturbance and noise.

For unbiased gains, and disturbance d = b - (its middle), |d_c| <= Delta_c, |v_c| <= V_c:

    xhat - x = sum_j G_j v_j - sum_l int_0^nu R_l e^{-A s} d(t_l + s) ds,
    R_0 = G_0 C,   R_l = R_{l-1} A_d^-1 + G_l C

    |xhat - x|_r <= sum_jc |G_j[r,c]| V_c + sum_lc Delta_c int_0^nu |(R_l e^{-A s})[r,c]| ds

which a disturbance that switches with the signs attains. To it comes the bias (G O - I) x(t_i) of
gains that are unbiased to rounding only. The same against x(t_i - T), with the bias
(G O A_d^k - A_d^k) x(t_i - T), which for fast stable modes is that of the stored gains:

    Q_(k-1) = I,   Q_(l-1) = Q_l A_d - G_l C,   Q_l e^{A (nu - s)} in place of R_l e^{-A s}

The integrals are enclosed in balls: where the integrand certainly keeps its sign, by its integral;
elsewhere by halving, and at last by its end values and a bound of its slope.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Ball, Exact, entries, exact, exp_times, identity, rational, scalar
from obsdesign.analysis.finite_time.enclosed_gains import Sampled, frobenius
from obsdesign.equations.finite_time.rows import START

# halvings around a change of sign: a crude bound applies to a 4^-12 part of one period
_HALVINGS = 12
# halvings per entry, shared by all entries: without any left the bound is crude
# precisions in turn: those of long windows amplify what an earlier one rounds
PRECISIONS = (160, 320, 640, 1280, 2560)
_HALVINGS_AN_ENTRY = 512
_MOST_HALVINGS = 100_000  # some seconds: where more are needed, more digits are
# a piece below this part of the radius so far is not halved any more
_NEGLIGIBLE = 2.0**-50


def bias(sampled: Sampled, gain: Matrix) -> tuple[Exact, Ball]:
    """(n, n) G O - I, or G O - A_d^k, enclosed, and a ball of its size in `units`."""
    error = exact(gain) @ sampled.rows - sampled.last
    return error, frobenius(sampled.in_units(error))


def error_radius(sampled: Sampled, gain: Matrix, noise: Matrix, disturbance: Exact) -> list[Ball]:
    """For each state a ball around the largest error; noise (p,) = V, disturbance (n,) = Delta."""
    G, V = exact(gain), exact(noise)
    Delta = exact(disturbance)
    n, p = len(sampled.A), len(sampled.C)
    terms = G.reshape(n, sampled.k, p).transpose(1, 0, 2)
    radius = [scalar(sum(abs(x) * V[c % p] for c, x in enumerate(row))) for row in G]
    columns = [c for c in range(n) if Delta[c] != 0]
    Delta = np.where(Delta == 0, exact([1.0]), Delta)  # a divisor for columns without disturbance
    if not columns:
        return radius
    pieces = _pieces(sampled)
    halvings = min(_HALVINGS_AN_ENTRY * len(terms) * n * len(columns), _MOST_HALVINGS)
    budget = _Budget(halvings)
    for weight in _weights(sampled, terms):
        least = np.array([x * rational(_NEGLIGIBLE) for x in radius])[:, None] / Delta
        sizes = _integrals(weight, pieces, columns, least, budget)
        for r in range(n):
            radius[r] = sum((sizes[r, c] * Delta[c] for c in columns), radius[r])
    return radius


def _weights(sampled: Sampled, terms: Exact) -> Iterator[Exact]:
    """R_l, l = 0..k-1, or Q_l, l = k-1..0."""
    if sampled.reference == START:
        Q: Exact = entries(identity(len(sampled.A)))
        for term in terms[::-1]:
            yield Q
            Q = Q @ sampled.forward - term @ sampled.C
        return
    R: Exact = 0 * sampled.back
    for term in terms:
        R = R @ sampled.back + term @ sampled.C
        yield R


def disturbance_bound(lower: Matrix, upper: Matrix) -> Exact:
    """Delta: half the width of the bounds of b, exactly."""
    half: Exact = (exact(upper) - exact(lower)) / 2
    return half


@dataclass
class _Budget:
    """Number of pieces that may still be halved."""

    halvings: int


@dataclass(frozen=True)
class _Piece:
    """A piece of length h: e^{-A h}, its integral W, A, |e^{-A s}| <= grown for s in [0, h]."""

    h: Ball
    over: Exact
    integral: Exact
    A: Exact
    grown: Exact


def _pieces(sampled: Sampled) -> list[_Piece]:
    """A whole period, its half, its quarter, ..."""
    n, A = len(sampled.A), sampled.A
    A = -A if sampled.reference == START else A
    zero, unit = exact(np.zeros((n, n))), exact(np.eye(n))
    block = np.block([[-A, unit], [zero, zero]])
    # comparison system, with no decay: entry by entry above e^{-A s}, and growing
    sizes = np.where(np.eye(n, dtype=bool), np.maximum(-A, 0 * A), np.abs(A))
    pieces = []
    for depth in range(_HALVINGS + 1):
        part = rational(2.0**-depth)
        whole = entries(exp_times(block * part, sampled.period))
        grown = entries(exp_times(sizes * part, sampled.period))
        h = scalar(rational(sampled.period) * part)
        pieces.append(_Piece(h, whole[:n, :n], whole[:n, n:], A, grown))
    for depth in range(_HALVINGS - 1, -1, -1):
        # the same from the two halves, which keeps the decay of coupled fast modes
        half = pieces[depth + 1]
        second = np.abs(half.over) @ half.grown
        grown = _least(pieces[depth].grown, _most(half.grown, second))
        pieces[depth] = replace(pieces[depth], grown=grown)
    return pieces


_least = np.frompyfunc(lambda x, y: x.min(y), 2, 1)
_most = np.frompyfunc(lambda x, y: x.max(y), 2, 1)


def _integrals(
    start: Exact, pieces: list[_Piece], columns: list[int], least: Exact, budget: _Budget
) -> Exact:
    """int_0^h |(start e^{-A s})[r, c]| ds for the rows of `start`, enclosed, on a piece.

    pieces: this one, its half, its quarter, ...; least: sizes that need no better bound, of the
    shape of the result.
    """
    piece, halves = pieces[0], pieces[1:]
    end, total = start @ piece.over, start @ piece.integral
    slopes = np.abs(start @ piece.A) @ piece.grown
    sizes = np.abs(start) @ piece.grown * piece.h
    result: Exact = 0 * total
    starts = None
    for r in range(len(start)):
        for c in columns:
            ends = abs(start[r, c]) + abs(end[r, c])
            is_kept = start[r, c] * end[r, c] >= 0 and ends > piece.h * slopes[r, c]
            if is_kept or slopes[r, c] == 0:
                result[r, c] = abs(total[r, c])
            elif sizes[r, c] <= least[r, c]:
                result[r, c] = abs(total[r, c]).union(sizes[r, c])
            elif not halves or budget.halvings <= 0:
                most = piece.h * ends / 2 + piece.h * piece.h * slopes[r, c] / 4
                result[r, c] = abs(total[r, c]).union(most)
            else:
                budget.halvings -= 1
                starts = (start, start @ halves[0].over) if starts is None else starts
                result[r, c] = sum(
                    _integrals(half[r : r + 1], halves, [c], least[r : r + 1], budget)[0, c]
                    for half in starts
                )
    return result
