"""A quadratic form whose matrix depends on the time since the last jump: exact proof.

x' = A(p) x, x+ = G(p) x with jumps every theta in [low, high]. R(tau) is piecewise polynomial on
nodes 0 = tau_0 < ... < tau_K = T, of degree d, by its Bernstein coefficients R_0, ..., R_{Kd}:
segment k, of length h_k, has R_{kd}, ..., R_{kd+d}, and shares its ends with its neighbours. After
T the matrix stays R(T). x(t) -> 0 for every p(t) in the box and every sequence of theta if

  (a)  A'R_c + R_c A + (j / h_k)(R_c - R_{c-1}) + ((d - j) / h_k)(R_{c+1} - R_c) < 0,  c = kd + j,
  (b)  R_c - G'R_0 G > 0  where tau >= low,  and R_0 > 0,
  (c)  A'R(T) + R(T) A < 0  where T < high,

at all vertices A, G of the family, j = 0..d in every segment: (a) holds the Bernstein coefficients
of A'R + R A + dR/dtau, so x'R(tau)x falls along the flow, and falls further at jumps. Coefficients
are floats, all other numbers rational: every condition is an exact L D L'.

Source: Briat, Automatica 49 (2013), Theorem 2.4 (c), in Bernstein's form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, floats
from lmi.arithmetic.balls import Exact, certify_pivots, exact, rational
from lmi.parameters import AffineFamily
from lmi.verdict import Verdict, proved, undecided

Condition = tuple[str, int, int]  # its name, the place of its coefficient, its vertex


@dataclass(frozen=True)
class ClockMatrix:
    """R: (K d + 1, n, n) exact, symmetric; nodes: (K + 1,) exact, rising from 0."""

    R: Exact
    nodes: Exact

    @property
    def degree(self) -> int:
        """Degree d of the segments; 0 where R is constant."""
        return (len(self.R) - 1) // max(len(self.nodes) - 1, 1)

    def slope(self, segment: int, j: int) -> Exact:
        """Coefficient j of dR/dtau on a segment, of degree d as R is."""
        d, c = self.degree, segment * self.degree + j
        h = self.nodes[segment + 1] - self.nodes[segment]
        total: Exact = self.R[c] * 0
        if j > 0:
            total = total + (self.R[c] - self.R[c - 1]) * (j / h)
        if j < d:
            total = total + (self.R[c + 1] - self.R[c]) * ((d - j) / h)
        return total


def prove_clock_matrix(
    family: AffineFamily, low: float, high: float, certificate: Entries
) -> Verdict:
    """Prove stability for every p(t) in the box and all sequences of theta in [low, high].

    certificate: "nodes" (K + 1,) and "R" (K d + 1, n, n), floats taken exactly. Undecided evidence
    has the condition that fails, its coefficient and its vertex.
    """
    clock = read_clock_matrix(certificate, family.order)
    if clock is None:
        return undecided("nodes that rise from 0 and symmetric coefficients of R are required")
    start, end = rational(low), clock.nodes[-1]
    if start not in clock.nodes.tolist() or (math.isfinite(high) and end > rational(high)):
        return undecided("low has to be a node, and no node may be above high")
    first = clock.nodes.tolist().index(start) * clock.degree
    must_decay = math.isinf(high) or end < rational(high)
    count = 0
    for (name, place, vertex), matrix in _conditions(family, clock, first, must_decay):
        if not certify_pivots([list(row) for row in matrix]):
            return undecided(
                f"condition ({name}) fails", condition=name, coefficient=place, vertex=vertex
            )
        count += 1
    return proved(method="matrices of the time since a jump, exact", matrices=count)


def _conditions(
    family: AffineFamily, clock: ClockMatrix, first: int, must_decay: bool
) -> Iterator[tuple[Condition, Exact]]:
    """Every matrix that has to be positive definite."""
    R, d = clock.R, clock.degree
    yield ("b", 0, 0), R[0]
    for v, G in enumerate(family.jump_vertices()):
        image = G.T @ R[0] @ G
        for c in range(first, len(R)):
            yield ("b", c, v), R[c] - image
    for v, A in enumerate(family.flow_vertices()):
        halves = [S @ A for S in R]
        for k in range(len(clock.nodes) - 1):
            for j in range(d + 1):
                c = k * d + j
                yield ("a", c, v), -(halves[c] + halves[c].T + clock.slope(k, j))
        if must_decay:
            yield ("c", len(R) - 1, v), -(halves[-1] + halves[-1].T)


def read_clock_matrix(certificate: Entries, n: int) -> ClockMatrix | None:
    """Return the exact R and nodes of a stored certificate; None where they are none."""
    try:
        nodes, R = floats(certificate["nodes"]), floats(certificate["R"])
    except (KeyError, OverflowError, TypeError, ValueError):
        return None
    if nodes.ndim != 1 or R.ndim != 3 or R.shape[1:] != (n, n) or not len(nodes) or not len(R):
        return None
    segments = len(nodes) - 1
    fits = len(R) == 1 if segments == 0 else len(R) > segments and (len(R) - 1) % segments == 0
    is_finite = np.isfinite(nodes).all() and np.isfinite(R).all()
    if not (fits and is_finite and nodes[0] == 0 and (np.diff(nodes) > 0).all()):
        return None
    return ClockMatrix(exact(R), exact(nodes)) if (np.swapaxes(R, 1, 2) == R).all() else None
