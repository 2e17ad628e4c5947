"""Integrals over a window that bound the error of observer (14) along a record, in floats.

With delta the known input, Delta(m) = delta(m) - L C q(m) - L y(phi(m)) on a period of samples,
q(m) = int_{phi(m)}^m e^{A (phi(m) - s)} delta(s) ds, and the window [t_i - T, t_i]:

    forced    int e^{A (t_i - m - T)} delta(m) dm
    T~        int e^{F (t_i - m)} Delta(m) dm
    T_Delta   int |Delta(m)| dm                               (Theorem 1, (14), (15))

    |xhat - x| <= alpha |forced| + beta |T~| + gamma Sigma T_Delta

Source: F. Mazenc, S. Ahmed, MICNON 2018, Theorem 1 with the errata of docs/papers.md. The inner
integral of (15) runs backwards, which makes q the state that delta alone reaches, moved to the
sample. Gauss's rule on pieces in which no mode moves far: an illustration, no enclosure.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.finite_time.gains import FiniteTimeGains

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
# pieces of a period on which |F| and |A| times the length stay below one
_LARGEST_TURN = 1.0


@dataclass(frozen=True)
class Integrals:
    """forced (n,), onwards (n,) and size, of a window or of one of its periods.

    Of a period, from its start: int e^{-A s} delta ds, int e^{F (nu - s)} Delta ds, int |Delta| ds.
    Of a window: the first integral of Theorem 1, T~ and T_Delta.
    """

    forced: Matrix
    onwards: Matrix
    size: float


@dataclass(frozen=True)
class ErrorBound:
    """alpha, beta and gamma Sigma of Theorem 1."""

    alpha: float
    beta: float
    last: float

    def value(self, window: Integrals) -> float:
        """The right-hand side of Theorem 1."""
        return float(
            self.alpha * np.linalg.norm(window.forced)
            + self.beta * np.linalg.norm(window.onwards)
            + self.last * window.size
        )


def period_integrals(
    gains: FiniteTimeGains, y: Matrix, inputs: Sequence[tuple[float, Matrix]]
) -> Integrals:
    """Integrals over the period after the sample y (p,).

    inputs: (time since the sample, known input delta (n,) from there on), the first at zero.
    """
    A, injected = gains.A, gains.injection @ y
    LC = gains.injection @ gains.C
    forced, onwards, size = np.zeros(gains.n), np.zeros(gains.n), 0.0
    ends = [*(start for start, _ in inputs[1:]), gains.period]
    for (start, delta), end in zip(inputs, ends, strict=True):
        for a, b in _pieces(A, A + LC, start, end):
            s, w = a + (b - a) * (_NODES + 1) / 2, (b - a) / 2 * _WEIGHTS
            # forced is q(a), as e^{-A s} is taken from the sample on
            q = forced + _pushes(A, a, s, delta)
            value = delta - q @ LC.T - injected
            onwards = onwards + w @ _applied(expm((A + LC) * _column(gains.period - s)), value)
            size += float(w @ np.linalg.norm(value, axis=1))
            forced = forced + _pushes(A, a, np.array([b]), delta)[0]
    return Integrals(forced, onwards, size)


@dataclass(frozen=True)
class WindowMaps:
    """e^{-A j nu} and e^{F (k-1-j) nu}, j = 0..k-1, (k, n, n) each."""

    back: Matrix
    onwards: Matrix

    @classmethod
    def from_gains(cls, gains: FiniteTimeGains) -> WindowMaps:
        """The maps of a design with an L."""
        F = gains.A + gains.injection @ gains.C
        starts = gains.period * np.arange(gains.samples, dtype=np.float64)
        return cls(expm(-gains.A * _column(starts)), expm(F * _column(starts[::-1])))

    def integrals(self, periods: Sequence[Integrals]) -> Integrals:
        """Integrals over a window from those of its k periods, oldest first."""
        return Integrals(
            _applied(self.back, np.array([period.forced for period in periods])).sum(axis=0),
            _applied(self.onwards, np.array([period.onwards for period in periods])).sum(axis=0),
            sum(period.size for period in periods),
        )


def _pieces(A: Matrix, F: Matrix, start: float, end: float) -> list[tuple[float, float]]:
    """The interval in pieces that are short against the modes of A and F."""
    turn = max(float(np.linalg.norm(X, 2)) for X in (A, F)) * (end - start)
    grid = np.linspace(start, end, max(math.ceil(turn / _LARGEST_TURN), 1) + 1)
    return [(float(a), float(b)) for a, b in itertools.pairwise(grid)]


def _pushes(A: Matrix, a: float, s: Matrix, delta: Matrix) -> Matrix:
    """int_a^s e^{-A r} dr delta for each s, (len(s), n)."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = -A, delta
    return np.asarray(expm(block * _column(s - a))[:, :n, n] @ expm(-A * a).T)


def _applied(maps: Matrix, vectors: Matrix) -> Matrix:
    """Each map (k, n, n) on its vector (k, n)."""
    return np.asarray((maps @ vectors[:, :, None])[:, :, 0])


def _column(times: Matrix) -> Matrix:
    """Times (k,) as factors of k matrices."""
    return times[:, None, None]
