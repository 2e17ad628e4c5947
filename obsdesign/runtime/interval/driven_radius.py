"""Radii of comparison systems that forms drive, over one step, enclosed.

    w' = W w + sum_k d_k |f_k(s)| + c,    w(0) linear in r

A form f_k(s) = a'x_c(s) + (what is constant) follows the path x_c' = A x_c + B u + b_mid, so that
it is known at the ends of every piece of the step, and between them at most

    (1 - s/h) |f(0)| + (s/h) |f(h)| + (bound of f - its chord),

where f - chord is at most h^2/8 sup |f''|, and at most int |f'|, both linear in |x_c'(0)|. So
w at the end is linear in (r, |forms|, 1), with weights from one exponential for each step length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, expm, raised, stack
from obsdesign.runtime.interval.drives import FormTable
from obsdesign.runtime.interval.model import exactly, metzler_bound, size


@dataclass(frozen=True)
class Forcing:
    """What drives a comparison system from node to node of a step.

    rows: of the system; n: states. at_nodes: for each node (place of a form, direction (rows,)),
    over_pieces: for each piece; constant (rows, n + 1): of r and of 1 at every instant. terms:
    additions to one entry, at most.
    """

    rows: int
    n: int
    table: FormTable
    at_nodes: list[list[tuple[int, Matrix]]]
    over_pieces: list[list[tuple[int, Matrix]]]
    constant: Matrix
    terms: int

    def at(self, node: int, piece: int) -> Matrix:
        """Input (rows, n + forms + 1) at a node, together with what lasts over a piece."""
        total = np.zeros((self.rows, self.n + len(self.table) + 1))
        total[:, : self.n], total[:, -1] = self.constant[:, :-1], self.constant[:, -1]
        for place, direction in (*self.at_nodes[node], *self.over_pieces[piece]):
            total[:, self.n + place] += direction
        # as many roundings for every list: a system and its change of sign have the same inputs
        return np.where(total > 0, raised(total, self.terms), 0.0)

    def between(self, node: int, piece: int, nodes: int) -> Matrix:
        """The same at a node of `nodes` finer pieces, which the pieces divide: on the chord."""
        ratio = nodes // len(self.over_pieces)
        first, own = piece // ratio, node - (piece // ratio) * ratio
        if own in (0, ratio):
            return self.at(first + own // ratio, first)
        ends, share = [self.at(first + k, first) for k in (0, 1)], own / ratio
        return raised((1.0 - share) * ends[0] + share * ends[1], 3) * (ends[0] + ends[1] > 0)


@dataclass(frozen=True)
class PieceFlow:
    """Of a piece of a step: e^{W d}, and int_0^d e^{W (d - s)} (1 - s/d, s/d) ds."""

    flow: Enclosure
    falling: Enclosure
    rising: Enclosure

    @staticmethod
    def of_system(W: Enclosure, d: float, error: float) -> PieceFlow:
        """From one block exponential; the length is d +- error."""
        rows = len(W.mid)
        identity, zero = exactly(np.eye(rows)), exactly(np.zeros((rows, rows)))
        blocks = [[W.scaled(d, error), identity, zero], [zero, zero, identity], [zero, zero, zero]]
        whole = expm(stack(blocks))
        parts = [
            Enclosure(whole.mid[:rows, k : k + rows], whole.rad[:rows, k : k + rows])
            for k in (0, rows, 2 * rows)
        ]
        rising = parts[2].scaled(d, error)
        return PieceFlow(parts[0], parts[1].scaled(d, error) - rising, rising)

    def after(self, before: Enclosure, first: Matrix, last: Matrix) -> Enclosure:
        """The state after the piece from that before it and inputs at its two ends."""
        entering = self.falling @ exactly(first) + self.rising @ exactly(last)
        return self.flow @ before + entering


def initial(rows: int, forms: int, blocks: Sequence[int], n: int) -> Enclosure:
    """w(0), (rows, n + forms + 1): r in the blocks of n rows that start there, zero elsewhere."""
    start = np.zeros((rows, n + forms + 1))
    for first in blocks:
        start[first : first + n, :n] = np.eye(n)
    return exactly(start)


@dataclass(frozen=True)
class ChordErrors:
    """How far forms of a path x_c' = A x_c + ... are from their chords over a piece.

    A: (n, n); longest: length of the piece; flow, once (n, n): bounds of |e^{A s}| on the way, and
    of its integral.
    """

    A: Enclosure
    longest: float
    flow: Matrix
    once: Matrix

    @staticmethod
    def of_piece(A: Enclosure, d: float, error: float) -> ChordErrors:
        """Those of a piece of length d +- error."""
        n, comparison = len(A.mid), metzler_bound(A)
        growing = np.where(np.eye(n, dtype=bool), np.maximum(comparison, 0.0), comparison)
        identity, zero = exactly(np.eye(n)), exactly(np.zeros((n, n)))
        largest = np.maximum(expm(exactly(growing).scaled(d, error)).upper, 0.0)
        blocks = [[exactly(comparison).scaled(d, error), identity], [zero, zero]]
        whole = expm(stack(blocks))
        once = np.maximum(whole.mid[:n, n:] + whole.rad[:n, n:], 0.0)
        longest = d + error
        return ChordErrors(A, longest, largest, raised(longest * once, 2))

    def bound(self, X: Enclosure) -> Matrix:
        """Bound of |f - its chord| for f = X x_c per entry of |x_c'| at the start, (rows, n).

        h^2/8 |X A e^{A s}|, where |X A e^{A s}| <= |X A| E and <= |X A| + h |X A^2| E, E the bound
        of |e^{A s}|; and int |X e^{A s}| ds.
        """
        first, second = size(X @ self.A), size(X @ self.A @ self.A)
        slope = np.minimum(first @ self.flow, first + self.longest * (second @ self.flow))
        # each is a product of nonnegative matrices, rounded n times or less in each of its factors
        terms = 8 * len(self.flow)
        by_curvature = raised(0.125 * self.longest * self.longest * slope, terms)
        by_variation = raised(size(X) @ self.once, terms)
        bounds: Matrix = np.fmin(by_curvature, by_variation)  # an overflow is not a number
        return bounds
