"""Features of an impulse for every weight g: no column of jump.H by itself decides them.

|b g| may be small for a weight across columns although every column of b is large. Proofs work on
columns of H T instead, T an exact invertible matrix that makes columns of b T nearly orthonormal:
w = T^-1 g is as arbitrary as g, and balls of b T g stay narrow against its norm.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    PRECISIONS,
    Ball,
    Balls,
    Exact,
    Rational,
    ball_matrix,
    certify_positive_definite,
    entries,
    exact,
    exp_around,
    exp_times,
    identity,
    middle,
    number,
    precision,
    rational,
    solve,
    upper_ends,
)
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
)

_MOST_CELLS = 1000  # of ages, before the ratio of all weights is undecided


def orthonormal_weights(b: Matrix) -> Exact | None:
    """Exact T, upper triangular and invertible, for which b T is nearly orthonormal, or None.

    b: floats (k, q), k >= q.
    """
    if len(b) < b.shape[1] or not np.isfinite(b).all():
        return None
    with np.errstate(all="ignore"):
        R = np.asarray(np.linalg.qr(b, mode="r"))
        if not np.diag(R).all():
            return None
        T = np.triu(np.linalg.inv(R))
    return exact(T) if np.isfinite(T).all() and np.diag(T).all() else None


def weight_bounds(V: Exact, columns: Exact) -> Matrix:
    """Floats (q,) that are at least max |w_j| / |b w| over all w; infinite where b may vanish.

    b = V columns, V balls (k, n), columns exact (n, q). The largest is the root of entry j of
    (b'b)^-1 = T (T'b'b T)^-1 T'; lower ends on the diagonal make T'b'b T smaller, its inverse
    larger.
    """
    none = np.full(columns.shape[1], math.inf)
    T = orthonormal_weights(middle(ball_matrix(V @ columns)))
    if T is None:
        return none
    b = V @ (columns @ T)
    gram = b.T @ b
    for j in range(len(gram)):
        gram[j, j] = sum((x.abs_lower() ** 2 for x in b[:, j].tolist()), number(0.0))
    lower = ball_matrix(gram)
    inverse = solve(lower, identity(len(gram))) if certify_positive_definite(lower) else None
    if inverse is None:
        return none
    squares = np.diag(upper_ends(ball_matrix(T @ entries(inverse) @ T.T)))
    return np.nextafter(np.sqrt(squares), math.inf)


def ratio_of_weights(window: FeatureWindow, bound: float) -> Verdict:
    """Decide |E g| <= bound |b g| for all weights g and ages in [margin, tau], scaled features.

    Row i: b = e^{F s} [H; 0] and E = -e^{lambda_i tau} e^{F (s - tau)} [H; 0], on cells of ages
    that are halved where neither a proof nor a witness is at hand.
    """
    low, high = rational(window.margin), rational(window.tau)
    cells, tried = [(low, high)], 0
    with precision(PRECISIONS[-1]):
        responses = _Responses(window)
        while cells:
            start, end = cells.pop()
            middle_age = (start + end) / 2
            T = orthonormal_weights(middle(ball_matrix(responses.at(middle_age)[0] @ window.H)))
            if T is None:
                return undecided(
                    f"the features of some weight may vanish at age {float(middle_age):.6g}",
                    age=float(middle_age),
                )
            columns = window.H @ T
            if _holds(responses.at(middle_age, (end - start) / 2), columns, bound):
                continue
            for age in (float(start), float(middle_age)):
                witness = _witness(responses.at(rational(age)), window.H, T, bound, age)
                if witness is not None:
                    return refuted(witness)
            tried += 1
            if tried > _MOST_CELLS:
                return undecided(f"near age {float(middle_age):.6g}", age=float(middle_age))
            cells += [(middle_age, end), (start, middle_age)]
    return proved(ratio=bound)


class _Responses:
    """Balls of b and E per unit of the state, (m p, n) each, at an age or on a cell of ages."""

    def __init__(self, window: FeatureWindow) -> None:
        lams, p = np.asarray(window.exponents, float), len(window.C)
        scales = exact(feature_scales(lams, window.tau))
        self._n, self._tau = len(window.D), rational(window.tau)
        self._F = filtered_system(window.D, window.C, exact(lams), scales)
        growth = [(number(lam) * number(window.tau)).exp() for lam in lams.tolist()]
        self._growth = np.array(growth * p, dtype=object)[:, None]

    def at(self, age: Rational, radius: Rational | None = None) -> tuple[Exact, Exact]:
        """(b, E) at an age, or at all ages within a radius of it."""
        after, before = exp_times(self._F, age), exp_times(self._F, age - self._tau)
        if radius is not None:
            cell = exp_around(self._F, math.nextafter(float(radius), math.inf))
            after, before = after * cell, before * cell
        n = self._n
        return entries(after)[n:, :n], -self._growth * entries(before)[n:, :n]


def _gap(b: Exact, E: Exact, bound: float) -> Balls:
    """Balls of bound^2 b'b - E'E."""
    return ball_matrix(b.T @ b * number(bound) ** 2 - E.T @ E)


def _holds(responses: tuple[Exact, Exact], columns: Exact, bound: float) -> bool:
    """Whether |E w| < bound |b w| is certain for all w, in columns H T."""
    b, E = (response @ columns for response in responses)
    return certify_positive_definite(_gap(b, E, bound))


def _witness(
    responses: tuple[Exact, Exact], H: Exact, T: Exact, bound: float, age: float
) -> dict[str, object] | None:
    """A weight whose neglected part certainly exceeds the bound at an age; None without one."""
    b, E = (response @ (H @ T) for response in responses)
    gap = middle(_gap(b, E, bound))
    if not np.isfinite(gap).all():
        return None
    w = np.linalg.eigh(gap)[1][:, :1]
    weights = np.array([[float(x) for x in row] for row in (T @ exact(w)).tolist()])
    weights /= np.abs(weights).max()
    if not np.isfinite(weights).all():
        return None
    g = exact(weights)
    b, E = (response @ (H @ g) for response in responses)
    size: Ball = entries(_gap(b, E, bound))[0, 0]
    if not size < 0:
        return None
    listed = weights[:, 0].tolist()
    reason = (
        f"at age {age!r} the neglected part of an impulse of weights {listed!r} exceeds {bound!r} "
        "of its features"
    )
    return {"age": age, "weights": listed, "reason": reason}
