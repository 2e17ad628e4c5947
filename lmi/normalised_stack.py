"""A stack of products in coordinates of its own, as ball matrices: its flows over sides of boxes.

A side is (level, index): the index-th of the 2^level equal parts of [low, high].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmi.balls import ball, exact, middle, rational, scalar, to_float
from lmi.stack import Matrix, Stack, state_basis

# sums of a few positive floats, and LAPACK's singular values, are off by far less
RAISED = 1.0 + 1e-10


@dataclass
class NormalisedStack:
    """The stack in coordinates (R, T): F, H, C, right ball matrices; flows over sides, cached.

    K: the flow of the columns, undone where the stack flows first, in the coordinates R.
    """

    F: Any
    H: Any
    C: Any
    right: Any
    K: Any
    R: Any
    R_back: Any
    back: Matrix
    low: Any
    length: Any
    flows: dict[tuple[int, int], tuple[Any, Any]] = field(default_factory=dict)
    undone: dict[tuple[int, int], tuple[Any, Any, float, float, float]] = field(
        default_factory=dict
    )

    def undoing(self, key: tuple[int, int]) -> tuple[Any, Any, float, float, float]:
        """e^{-K (theta - middle)} at the centre of a side and on it, and what its norm is below.

        The norms are those in the coordinates R and in the original ones; last, that of what
        undoes the undoing, in R.
        """
        if key not in self.undone:
            level, index = key
            half = self.length / 2 ** (level + 1)
            offset = (2 * index + 1) * half - self.length / 2
            centre = (-self.K * scalar(offset)).exp()
            whole = centre * (self.K * scalar(-half).union(scalar(half))).exp()
            plain = self.R_back * whole * self.R
            again = (self.K * scalar(offset)).exp() * (
                self.K * scalar(-half).union(scalar(half))
            ).exp()
            norms = (norm_above(magnitudes(X)) for X in (whole, plain, again))
            self.undone[key] = (centre, whole, *norms)
        return self.undone[key]

    def side(self, key: tuple[int, int]) -> tuple[Any, Any]:
        """e^{F c} and e^{F theta} for all theta of a side."""
        if key not in self.flows:
            level, index = key
            half = self.length / 2 ** (level + 1)
            centre = (self.F * scalar(self.low + (2 * index + 1) * half)).exp()
            spread = scalar(-half).union(scalar(half))
            self.flows[key] = centre, centre * (self.F * spread).exp()
        return self.flows[key]

    def centre(self, key: tuple[int, int]) -> float:
        """Middle of a side."""
        level, index = key
        exactly = self.low + (2 * index + 1) * self.length / 2 ** (level + 1)
        return float(int(exactly.p) / int(exactly.q))


def magnitudes(S: Any) -> Matrix:
    """Upper bounds of the absolute values of a ball matrix's entries."""
    return np.array([[float(x.abs_upper()) for x in row] for row in S.tolist()]) * RAISED


def norm_above(bound: Matrix) -> float:
    """Above the spectral norm of every matrix whose entries are below these."""
    either = math.sqrt(float(bound.sum(axis=0).max() * bound.sum(axis=1).max()))
    return min(either, float(np.sqrt((bound**2).sum()))) * RAISED


def normalised(stack: Stack, low: float, high: float, R: Matrix) -> NormalisedStack | None:
    """Coordinates R for the columns, and for the state T = [right R^-1, rest]^-1."""
    try:
        R_back = ball(exact(R)).inv()
        back = middle(R_back)
        into = ball(exact(state_basis(stack, R)))
        T = into.inv()
    except (ZeroDivisionError, np.linalg.LinAlgError, ValueError):
        return None
    start, end = rational(low), rational(high)
    F = to_float(stack.F)
    K = R @ np.linalg.lstsq(to_float(stack.right), F @ to_float(stack.right), rcond=None)[0] @ back
    return NormalisedStack(
        F=T * ball(stack.F) * into,
        H=T * ball(stack.H) * into,
        C=ball(stack.C) * into,
        right=T * ball(stack.right) * R_back,
        K=ball(exact(K)),
        R=ball(exact(R)),
        R_back=R_back,
        back=back,
        low=start,
        length=end - start,
    )
