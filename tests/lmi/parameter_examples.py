"""Families with parameters of tests: numbers of papers, and plants of our own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.balls import Exact, Rational, exact, rational
from lmi.parameters import AffineFamily

# Briat, Automatica 49 (2013), Table 5: ratio of the ends of A, longest dwell time, K1 and K2
TABLE_5 = (
    (5.0, 10.0, (-0.0757, -0.7306), -0.0006),
    (5.0, 20.0, (-0.0411, -0.3835), -0.0022),
    (20.0, 10.0, (-0.0578, -0.5560), -0.0025),
    (20.0, 20.0, (-0.0339, -0.3121), -0.0019),
)


def from_ranges(
    A: ArrayLike | Exact,
    G: ArrayLike | Exact,
    effects: Sequence[tuple[ArrayLike | Exact, ArrayLike | Exact]],
    ranges: Sequence[tuple[float | Rational, float | Rational]],
    is_constant: Sequence[bool] | None = None,
) -> AffineFamily:
    """A + sum p_i A_i and G + sum p_i G_i with low_i <= p_i <= high_i, in the form of `lmi.parameters`.

    A, G: (n, n) floats or exact; effects: (A_i, G_i) of one unit of each parameter. ValueError
    where a range is empty.
    """
    flows, jumps = [exact(A)], [exact(G)]
    for (flow, jump), (low, high) in zip(effects, ranges, strict=True):
        lower, upper = rational(low), rational(high)
        if not lower <= upper:
            raise ValueError(f"low <= high is required of a range; got [{low}, {high}]")
        middle, half = (lower + upper) / 2, (upper - lower) / 2
        flows[0], jumps[0] = flows[0] + exact(flow) * middle, jumps[0] + exact(jump) * middle
        flows.append(exact(flow) * half)
        jumps.append(exact(jump) * half)
    constant = (False,) * len(effects) if is_constant is None else tuple(is_constant)
    return AffineFamily(np.array(flows), np.array(jumps), constant)


def oscillator(radius: float, *, is_constant: bool = False) -> AffineFamily:
    """x'' = -k x - 0.1 x', k in 1 +- radius; a jump keeps 0.8 of the speed."""
    effect = ([[0, 0], [-1, 0]], np.zeros((2, 2)))
    flow, jump = np.array([[0, 1], [-1, -0.1]]), np.diag([1, 0.8])
    return from_ranges(flow, jump, [effect], [(-radius, radius)], [is_constant])


def alternating(radius: float) -> AffineFamily:
    """Briat 2013, example (51): two oscillators in turn, stiffness 2 and 9, each +- radius."""
    A, G, none = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = [[0, 1], [-2, -1]], [[0, 1], [-9, -1]]
    G[:2, 2:] = G[2:, :2] = np.eye(2)
    first, second = np.zeros((4, 4)), np.zeros((4, 4))
    first[1, 0] = second[3, 2] = 1
    ranges = [(-radius, radius)] * 2
    return from_ranges(A, G, [(first, none), (second, none)], ranges)


def sampled(radius: float) -> AffineFamily:
    """A double integrator with friction, state feedback held between samples.

    Pole and input gain are known up to a relative radius.
    """
    A, G, none = np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.zeros((3, 3))
    A[0, 1], G[2, :2] = 1, (-3.75, -11.5)
    pole, gain = np.zeros((3, 3)), np.zeros((3, 3))
    pole[1, 1], gain[1, 2] = -0.1, 0.1
    ranges = [(1 - radius, 1 + radius)] * 2
    return from_ranges(A, G, [(pole, none), (gain, none)], ranges)


def table_5(row: int, gain: float) -> tuple[AffineFamily, float]:
    """A row of Table 5 with B = [0; gain], and its longest dwell time."""
    ratio, longest, K1, K2 = TABLE_5[row]
    A, G, effect = np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.zeros((3, 3))
    A[1, 2], G[2], effect[:2, :2] = gain, (*K1, K2), np.array([[0, 1], [0, -0.1]])
    none = np.zeros((3, 3))
    return from_ranges(A, G, [(effect, none)], [(1.0, ratio)]), longest


def growing_or_reset(radius: float) -> AffineFamily:
    """One state that decays and one that grows; jumps do the reverse: both ends are limits."""
    effect = ([[0, 0], [0, 1]], np.zeros((2, 2)))
    flow, jump = [[-1, 0.1], [0, 1.2]], np.diag([1.2, 0.5])
    return from_ranges(flow, jump, [effect], [(-radius, radius)])
