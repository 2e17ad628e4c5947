"""The largest norm of left e^{F theta} right over a range of theta, bounded in balls."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.balls import (
    Ball,
    Balls,
    Exact,
    ball,
    exact,
    identity,
    middle,
    norm_bound,
    rational,
    scalar,
    to_float,
)

# a cell spans this much of 1/||F||, unless there would be too many of them
_REACH, _FINE, _FEWEST, _MOST = 0.1, 0.02, 4, 400


def norm_over(left: Exact, F: Exact, right: Exact, low: float, high: float) -> Ball:
    """Ball above ||left e^{F theta} right|| for all theta in [low, high], finite ends.

    left (a, n), F (n, n), right (n, b): exact. At the current precision.
    """
    largest = scalar(0)
    for centre, around in _cells(left, F, right, low, high, reach=_REACH):
        largest = largest.max(norm_bound(centre * around))
    return largest


def inverse_norm_over(left: Exact, F: Exact, right: Exact, low: float, high: float) -> Ball | None:
    """Ball above ||(left e^{F theta} right)^-1|| for all theta in the range, a square matrix.

    None where the inverse is not certain to exist everywhere.
    """
    largest = scalar(0)
    for centre, around in _cells(left, F, right, low, high, reach=_FINE):
        try:
            Z = ball(exact(np.linalg.inv(middle(centre * around))))
        except (np.linalg.LinAlgError, ValueError):  # singular, or not finite
            return None
        off = norm_bound(identity(len(left)) - (Z * centre) * around)
        if not off < 1:
            return None
        largest = largest.max(norm_bound(Z) / (1 - off))
    return largest


def _cells(
    left: Exact, F: Exact, right: Exact, low: float, high: float, *, reach: float
) -> Iterator[tuple[Balls, Balls]]:
    """Pairs whose products enclose left e^{F theta} right on cells that cover the range."""
    size = float(np.abs(to_float(F)).sum(axis=0).max(initial=0.0))
    cells = max(_FEWEST, min(_MOST, math.ceil(size * (high - low) / (2 * reach))))
    length = rational(high) - rational(low)
    half = length / (2 * cells)
    flow = ball(F)
    centre = ball(left) * (flow * scalar(rational(low) + half)).exp()
    onwards = (flow * scalar(2 * half)).exp()
    around = (flow * scalar(-half).union(scalar(half))).exp() * ball(right)
    for _ in range(cells):
        yield centre, around
        centre = centre * onwards


def norm_of(X: Exact) -> Ball:
    """Ball above the spectral norm of an exact matrix; zero for an empty one."""
    if X.size == 0 or not any(value != 0 for value in X.flat):
        return scalar(0)
    return norm_bound(ball(X))


def identity_like(F: Exact) -> Exact:
    """The exact identity of the size of F."""
    return exact(np.eye(len(F)))
