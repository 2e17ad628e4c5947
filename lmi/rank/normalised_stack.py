"""A stack of products in normalised coordinates, in balls: its flows at sides of boxes.

A side is (level, index): the index-th of the 2^level equal parts of [low, high].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Balls, Rational, ball, exact, middle, rational, scalar
from lmi.rank.stack import Stack, state_basis

# sums of a few positive floats, and LAPACK's singular values, are off by far less
RAISED = 1.0 + 1e-10


@dataclass
class NormalisedStack:
    """The stack in coordinates (R, T): F, H, C, right ball matrices; flows at sides, cached.

    F is the stack's without `growth` times the identity, which scales the rows of O and no more:
    block j stands for e^{-growth (theta_1 + ... )} of the stack's. size: above |F|; back: R^-1.
    Time is measured in the power of two `unit`, so that no product of times and rates underflows.
    """

    F: Balls
    H: Balls
    C: Balls
    right: Balls
    back: Balls
    size: Matrix
    growth: float
    unit: float
    low: Rational
    length: Rational
    flows: dict[tuple[int, int], Balls] = field(default_factory=dict)

    @property
    def is_point(self) -> bool:
        """Whether the range is one point."""
        return bool(self.length == 0)

    def flow(self, key: tuple[int, int]) -> Balls:
        """e^{F c}, c the middle of a side."""
        if key not in self.flows:
            self.flows[key] = (self.F * scalar(self._middle(key))).exp()
        return self.flows[key]

    def centre(self, key: tuple[int, int]) -> float:
        """Middle of a side, in units of time."""
        exactly = self._middle(key)
        return float(int(exactly.p) / int(exactly.q))

    def half(self, key: tuple[int, int]) -> float:
        """Above half the width of a side, in units of time."""
        exactly = self.length / 2 ** (key[0] + 1)
        return float(int(exactly.p) / int(exactly.q)) * RAISED

    def _middle(self, key: tuple[int, int]) -> Rational:
        level, index = key
        middle: Rational = self.low + (2 * index + 1) * self.length / 2 ** (level + 1)
        return middle


def magnitudes(S: Balls) -> Matrix:
    """Upper bounds of the absolute values of a ball matrix's entries."""
    return np.array([[float(x.abs_upper()) for x in row] for row in S.tolist()]) * RAISED


def norm_above(bound: Matrix) -> float:
    """Above the spectral norm of every matrix whose entries are below these."""
    either = math.sqrt(float(bound.sum(axis=0).max() * bound.sum(axis=1).max()))
    return min(either, float(np.sqrt((bound**2).sum()))) * RAISED


def normalised(stack: Stack, low: float, high: float, R: Matrix) -> NormalisedStack | None:
    """Coordinates R for the columns, and for the state T = [right R^-1, rest]^-1."""
    try:
        back = ball(exact(R)).inv()
        into = ball(exact(state_basis(stack, R)))
        T = into.inv()
    except (ZeroDivisionError, np.linalg.LinAlgError, ValueError):
        return None
    unit = 2.0 ** round(math.log2(high)) if high > 0 else 1.0
    growth = stack.growth * unit
    into_time = scalar(rational(unit))
    F = T * ball(stack.F) * into * into_time - ball(exact(growth * np.eye(len(stack.F))))
    if not np.isfinite(middle(F)).all():
        return None
    return NormalisedStack(
        F=F,
        H=T * ball(stack.H) * into,
        C=ball(stack.C) * into,
        right=T * ball(stack.right) * back,
        back=back,
        size=magnitudes(F),
        growth=growth,
        unit=unit,
        low=rational(low) / rational(unit),
        length=(rational(high) - rational(low)) / rational(unit),
    )
