"""Componentwise error of a gain on a window of samples, under bounded disturbance and noise.

For unbiased gains, and disturbance d = b - (its middle), |d_c| <= Delta_c, |v_c| <= V_c:

    xhat - x = sum_j G_j v_j - sum_l int_0^nu R_l e^{-A s} d(t_l + s) ds,
    R_0 = G_0 C,   R_l = R_{l-1} A_d^-1 + G_l C

    |xhat - x|_r <= sum_jc |G_j[r,c]| V_c + sum_lc Delta_c int_0^nu |(R_l e^{-A s})[r,c]| ds

which a disturbance that switches with the signs attains. The integrals are enclosed in balls: where
the integrand certainly keeps its sign, by its integral; elsewhere by halving, and at last by its
end values and a bound of its slope.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.balls import Exact, entries, exact, exp_times, rational, scalar
from obsdesign.window_gains import Sampled

# halvings around a change of sign: what is left to a crude bound is a 4^-12 part of one period
_HALVINGS = 12


def error_radius(sampled: Sampled, gain: Any, noise: Any, disturbance: Any) -> list[Any]:
    """For each state a ball around the largest error; noise (p,) = V, disturbance (n,) = Delta."""
    G, V, Delta = exact(gain), exact(noise), exact(disturbance)
    n, p = len(sampled.A), len(sampled.C)
    terms = G.reshape(n, sampled.k, p).transpose(1, 0, 2)
    radius = [scalar(sum(abs(x) * V[c % p] for c, x in enumerate(row))) for row in G]
    columns = [c for c in range(n) if Delta[c] != 0]
    if not columns:
        return radius
    pieces = _pieces(sampled)
    R = 0 * sampled.back
    for term in terms:
        R = R @ sampled.back + term @ sampled.C
        sizes = _integrals(R, pieces, 0, columns)
        for r in range(n):
            radius[r] = sum((sizes[r, c] * Delta[c] for c in columns), radius[r])
    return radius


def disturbance_bound(gains: Mapping[str, Any]) -> Any:
    """Delta: half the width of the bounds of b, exactly."""
    half: Any = (exact(gains["flow_upper"]) - exact(gains["flow_lower"])) / 2
    return half


@dataclass(frozen=True)
class _Piece:
    """Matrices of a piece of length h: e^{-A h}, its integral W, A, |e^{-A s}| <= grown on it."""

    h: Any
    over: Exact
    integral: Exact
    A: Exact
    grown: Exact


def _pieces(sampled: Sampled) -> list[_Piece]:
    """A whole period, its half, its quarter, ..."""
    A, n = sampled.A, len(sampled.A)
    zero, one = exact(np.zeros((n, n))), exact(np.eye(n))
    block, sizes = np.block([[-A, one], [zero, zero]]), np.abs(A)
    found = []
    for depth in range(_HALVINGS + 1):
        part = rational(2.0**-depth)
        whole = entries(exp_times(block * part, sampled.period))
        grown = entries(exp_times(sizes * part, sampled.period))
        h = scalar(rational(sampled.period) * part)
        found.append(_Piece(h, whole[:n, :n], whole[:n, n:], A, grown))
    return found


def _integrals(start: Exact, pieces: list[_Piece], depth: int, columns: list[int]) -> Any:
    """int_0^h |(start e^{-A s})[r, c]| ds for the rows of `start`, enclosed, on a piece."""
    piece = pieces[depth]
    end, total = start @ piece.over, start @ piece.integral
    slopes = np.abs(start @ piece.A) @ piece.grown
    result: Any = 0 * total
    halves = None
    for r in range(len(start)):
        for c in columns:
            ends = abs(start[r, c]) + abs(end[r, c])
            kept = start[r, c] * end[r, c] >= 0 and ends > piece.h * slopes[r, c]
            if kept or slopes[r, c] == 0:
                result[r, c] = abs(total[r, c])
            elif depth == _HALVINGS:
                most = piece.h * ends / 2 + piece.h * piece.h * slopes[r, c] / 4
                result[r, c] = abs(total[r, c]).union(most)
            else:
                halves = (start, start @ pieces[depth + 1].over) if halves is None else halves
                result[r, c] = sum(
                    _integrals(half[r : r + 1], pieces, depth + 1, [c])[0, c] for half in halves
                )
    return result
