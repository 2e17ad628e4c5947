"""Norms and ranks of ball matrices: enclosed, or decided against a threshold.

Matrices are object arrays of balls (`lmi.arithmetic.balls.entries`). Floats only steer: singular
vectors are computed in floats, and what they suggest is checked in balls.

Inverses of I - M for nonnegative M, where they are nonnegative: small gains, in balls.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    Ball,
    Exact,
    ball,
    certify_positive_definite,
    entries,
    exact,
    identity,
    infinity,
    scalar,
)
from lmi.verdict import Verdict, proved, refuted, undecided


def upper_balls(values: Exact) -> Exact:
    """Upper bounds of the moduli of an array of balls, as exact balls in its shape.

    Infinite for a ball that is not a number: so the least of several bounds is one of the others.
    """
    uppers = [value.abs_upper() for value in values.ravel()]
    bounds = [upper if upper >= 0 else infinity() for upper in uppers]
    return np.array(bounds, dtype=object).reshape(values.shape)


def least_balls(first: Exact, other: Exact) -> Exact:
    """The smaller of two arrays of exact balls of the same shape, entry by entry."""
    pairs = zip(first.ravel(), other.ravel(), strict=True)
    return np.array([a.min(b) for a, b in pairs], dtype=object).reshape(first.shape)


def largest_balls(first: Exact, other: Exact) -> Exact:
    """The larger of two arrays of balls of the same shape, entry by entry."""
    pairs = zip(first.ravel(), other.ravel(), strict=True)
    return np.array([a.max(b) for a, b in pairs], dtype=object).reshape(first.shape)


def nonnegative_inverse(M: list[list[Ball]]) -> list[list[Ball]] | None:
    """Bound (I - X)^-1 in balls for every X with entries in [0, M_ij].

    M: nonnegative balls. None unless some v > 0 has (I - M) v > 0, certainly: then the spectral
    radius of M is below 1.
    """
    n = len(M)
    upper = [[scalar(0).max(x.abs_upper()) for x in row] for row in M]
    matrix = type(ball(exact(np.eye(n))))(
        n, n, [scalar(int(i == j)) - upper[i][j] for i in range(n) for j in range(n)]
    )
    try:
        back = matrix.inv().tolist()
    except ZeroDivisionError:
        return None
    v = [sum(row, scalar(0)) for row in back]
    rows = matrix.tolist()
    for i in range(n):
        shown = sum((rows[i][j] * v[j] for j in range(n)), scalar(0))
        if not (v[i] > 0 and shown > 0):
            return None
    return [list(row) for row in back]


# relative room above the largest singular value found in floats, tried in turn
_ROOM = (2.0**-44, 2.0**-36, 2.0**-24, 2.0**-8)


def spectral_norm(X: Exact) -> Ball:
    """Ball that contains the largest singular value of every matrix in X.

    From below by |X v| / |v| for one v, from above by t^2 I - X'X > 0.
    """
    middle, scale = _scaled_middle(X)
    if not scale:
        return _frobenius(X).union(scalar(0))
    if not np.isfinite(middle).all():  # balls without a midpoint: the norm may be anything
        return _frobenius(X)
    _, values, right = np.linalg.svd(middle)
    v = exact(right[0])
    image = X @ v
    low = _root(sum(x * x for x in image) / scalar(sum(x * x for x in v)))
    gram = X.T @ X
    n = len(gram)
    for room in _ROOM:
        t = scalar(exact(values[0] * (1 + room)).item()) * scale
        if certify_positive_definite(entries(identity(n)) * (t * t) - gram):
            return low.union(t)
    return low.union(_frobenius(X))


def well_ranked(X: Exact, threshold: float) -> Verdict:
    """Decide whether the least singular value of X is at least threshold times |X|_F.

    X: (m, n). Proved by X'X - (threshold |X|_F)^2 I > 0; refuted by a vector v with |X v| below
    that, checked. Evidence holds the ratio in floats, approx_ratio.
    """
    middle, scale = _scaled_middle(X)
    n = X.shape[1]
    if not scale:
        return refuted(
            {"vector": np.eye(n)[0].tolist(), "reason": "the matrix is zero"}, approx_ratio=0.0
        )
    if not np.isfinite(middle).all():
        return undecided("entries beyond any precision: the time constants are too far apart")
    _, values, right = np.linalg.svd(middle, full_matrices=len(middle) < n)
    smallest = values[n - 1] if len(values) >= n else 0.0
    ratio = float(smallest / np.sqrt((values**2).sum()))
    gram = X.T @ X
    level = scalar(exact(threshold).item()) ** 2 * gram.trace()
    if certify_positive_definite(gram - entries(identity(n)) * level):
        return proved(approx_ratio=ratio, threshold=threshold)
    v = exact(right[-1])
    image = X @ v
    if sum(x * x for x in image) < level * scalar(sum(x * x for x in v)):
        return refuted({"vector": right[-1].tolist()}, approx_ratio=ratio, threshold=threshold)
    return undecided("too close to the threshold", approx_ratio=ratio, threshold=threshold)


def _scaled_middle(X: Exact) -> tuple[Matrix, Ball | None]:
    """Midpoints over the largest of them, and that one; entries may be beyond binary64.

    NaN where a ball is infinite; zeros and None for the zero matrix.
    """
    values: list[Ball] = X.ravel().tolist()
    if not all(x.is_finite() for x in values):
        return np.full(X.shape, np.nan), scalar(1)
    middles = [abs(x.mid()) for x in values]
    largest = max(middles, default=scalar(0))
    if not largest > 0:
        return np.zeros(X.shape), None
    scaled = [float((x.mid() / largest).mid()) for x in values]
    return np.array(scaled).reshape(X.shape), largest


def _frobenius(X: Exact) -> Ball:
    values: list[Ball] = X.ravel().tolist()
    return _root(scalar(sum(x * x for x in values)))


def _root(square: Ball) -> Ball:
    """Square root of a ball of a number that is not negative, whatever its ball says."""
    return square.abs_upper().sqrt().union(square.abs_lower().sqrt())


def float_above(x: Ball) -> float:
    """A float that is not below any number in the ball; infinite where there is none."""
    top = x.upper()
    return 0.0 if top == 0 else float(np.nextafter(_as_float(top), np.inf))


def float_below(x: Ball) -> float:
    """A float that is not above any number in the ball."""
    return float(np.nextafter(_as_float(x.lower()), -np.inf))


def middles(X: Exact) -> Matrix:
    """Nearest floats to the midpoints of an object array of balls, (m, n)."""
    return np.array([[_as_float(x) for x in row] for row in X])


def _as_float(x: Ball) -> float:
    return float(x.mid())
