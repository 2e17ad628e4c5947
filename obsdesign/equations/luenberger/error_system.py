"""Point observers for linear systems with jumps: the formulas.

    xhat' = A xhat + L (y - C xhat) + B u + (b_lower + b_upper)/2              between jumps
    xhat+ = G xhat- + M (y- - C xhat-) + E w + (c_lower + c_upper)/2           at jumps

The error obeys e' = F e, e+ = H e- (`equations.estimation_error`); it is stable for every
sequence of dwell times in a range if one P > 0 gives H' e^{F' theta} P e^{F theta} H < P for all
theta in it.
Source: C. Briat, Convex conditions for robust stability analysis and stabilization of linear
aperiodic impulsive and sampled-data systems under dwell-time constraints, Automatica 49 (2013),
Theorem 3; applied to (A - L C, G - M C).

Notation
    P, Z        Lyapunov matrix (n x n) and P M (n x p): the inequality below is affine in them
    flows       e^{F theta} at k dwell times, (k, n, n)
    output      the factor of M: C, or C G for a measurement after the jump
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Array

# relative room at the borders of a schedule; the runtime allows itself less
BORDER = 4e-9


def post_jump_inequality(
    P: Array, Z: Array, G: Array, output: Array, flows: Array, *, before: Array | None = None
) -> Array:
    """[[P_before, ((P G - Z output) e^{F theta})'], *, P]] > 0, (k, 2n, 2n): the error shrinks.

    By Schur's complement ((G - M output) e^{F theta})' P (G - M output) e^{F theta} < P_before with
    M = P^-1 Z: the map from after one jump to after the next. Its products are those of the
    pre-jump map e^{F theta} H, so that one family is stable if and only if the other is. before:
    the matrix of the dwell time that came earlier, where matrices depend on it; None for P.
    """
    image = (P @ G - Z @ output) @ flows
    same = np.broadcast_to(P, flows.shape)
    earlier = same if before is None else np.broadcast_to(before, flows.shape)
    return np.block([[earlier, np.swapaxes(image, -1, -2)], [image, same]])


def cell_count(schedule: int | Sequence[float]) -> int:
    """Number of cells of a schedule, which is that number or the borders between cells."""
    return schedule if isinstance(schedule, int) else len(schedule) + 1


def schedule_cells(
    low: float, high: float, borders: Sequence[float]
) -> tuple[tuple[float, float], ...]:
    """Cells of dwell times between borders, each a little wider than its half-open interval.

    A dwell time is known to a relative 1e-9 (time stamps are decimal), so that near a border either
    neighbour may be taken for it; what is shown for the wider cells holds for both.
    """
    lows = [low, *(max(low, border * (1 - BORDER)) for border in borders)]
    highs = [*(min(high, border * (1 + BORDER)) for border in borders), high]
    return tuple(zip(lows, highs, strict=True))


def schedule_pairs(
    cells: Sequence[tuple[float, float]], jitter: float
) -> tuple[tuple[int, int], ...]:
    """(earlier, later): cells that may follow each other when dwell times change by `jitter`."""

    def are_apart(earlier: tuple[float, float], later: tuple[float, float]) -> bool:
        if math.isinf(jitter):
            return False
        gaps = ((earlier[0], later[1]), (later[0], earlier[1]))
        return any(
            math.isfinite(end) and Fraction(start) - Fraction(end) > Fraction(jitter)
            for start, end in gaps
        )

    numbers = range(len(cells))
    return tuple((i, j) for i in numbers for j in numbers if not are_apart(cells[i], cells[j]))
