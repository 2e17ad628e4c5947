"""One box of thetas: lower bounds of the singular values of a stack of products, in balls.

On a box with centre c and radii r, with Y O(c) Z close to I (Y, Z floats from a QR of O(c)),

    I - Y O(theta) Z  lies in  I - Y O(c) Z - sum_i [-r_i, r_i] Y (dO/dtheta_i over the box) Z,

and if its norm e is below 1, O has full column rank there with sigma_min >= (1 - e)/(|Y| |Z|). A
stack that flows first is multiplied by e^{-K (theta_1 - middle)} on the right, K the flow as its
columns see it: what theta_1 does to the columns alone costs no boxes.

Floats choose Y and Z; everything that decides is ball arithmetic, and two spectral norms of small
float matrices, raised by far more than their rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.balls import ball, exact, identity, middle, scalar
from lmi.normalised_stack import RAISED, NormalisedStack, magnitudes, norm_above
from lmi.stack import Matrix, Stack


@dataclass(frozen=True)
class Box:
    """Sides as (level, index): the index-th of the 2^level equal parts of [low, high]."""

    sides: tuple[tuple[int, int], ...]

    def halves(self, i: int) -> tuple[Box, Box]:
        """The box cut in two across its side i."""
        level, index = self.sides[i]
        parts = ((level + 1, 2 * index), (level + 1, 2 * index + 1))
        first, second = ((*self.sides[:i], part, *self.sides[i + 1 :]) for part in parts)
        return Box(first), Box(second)


@dataclass(frozen=True)
class Found:
    """Lower bounds of sigma_min of O and of O R^-1 on a box (0: none), the side to halve; the rest
    as in `prove_full_rank`.
    """

    size: float
    relative: float
    widest: int | None
    spread: Matrix
    largest: float = math.inf
    recalled: float = math.inf


def bounds(stack: Stack, family: NormalisedStack, box: Box, largest: float, margin: float) -> Found:
    """What a box gives: nothing unless the error norm is below `largest`, O R^-1 above margin."""
    nothing = np.zeros(stack.blocks)
    flows = [family.side(side) for side in box.sides]
    first = family.undoing(box.sides[0]) if stack.flows_first else None
    start = X = family.right
    slope_first = None
    if first is not None:  # mean value: where the columns flow by K alone, nothing is left to vary
        start = flows[0][0] * family.right * first[0]
        slope_first = flows[0][1] * (family.F * X - X * family.K) * first[1]
        half = family.length / 2 ** (box.sides[0][0] + 1)
        X = start + slope_first * scalar(-half).union(scalar(half))
    steps = flows[stack.flows_first :]
    rows = [family.C * state for state in _states(family, start, [point for point, _ in steps])]
    slopes = _slopes(stack, family, X, slope_first, [whole for _, whole in steps])
    pair = _pair(rows)
    if pair is None:
        return Found(0.0, 0.0, _longest(box), nothing)
    Y, Z = pair
    e, widths = _error(family, box, rows, slopes, Y, Z)
    widest = int(np.argmax(np.nan_to_num(widths, nan=np.inf))) if widths else None
    if not e < largest:
        return Found(0.0, 0.0, widest if np.isfinite(widths).all() else _longest(box), nothing)
    undone = (1.0, 1.0) if first is None else (first[3], first[2])
    sizes = [
        np.linalg.norm(Y, 2) * np.linalg.norm(Z_in, 2) * more
        for Z_in, more in zip((family.back @ Z, Z), undone, strict=True)
    ]
    size, relative = (float((1 - e) / (s * RAISED) / RAISED) for s in sizes)
    if not relative > margin:
        return Found(0.0, 0.0, widest, nothing)
    # a right factor cancels in X O^+, so that nothing has to be undone there
    states = _states(family, X, [around for _, around in steps])
    worst = float(np.linalg.norm(Y, 2)) * RAISED / (1 - e) * RAISED
    Z_ball = ball(exact(Z))
    spread = [norm_above(magnitudes(state * Z_ball)) * worst for state in states]
    seen = [family.C * state for state in states]
    outputs = norm_above(np.vstack([magnitudes(row) for row in seen]))
    outputs *= 1.0 if first is None else first[4]
    recalled = _recalled(seen, states[-1], len(Z))
    return Found(size, relative, widest, np.array(spread), outputs, recalled)


def _pair(rows: list[Any]) -> tuple[Matrix, Matrix] | None:
    """Floats Y, Z that make Y O(c) Z close to I."""
    approx = np.vstack([middle(block) for block in rows])
    if not np.isfinite(approx).all():
        return None
    Q, upper = np.linalg.qr(approx)
    Z = _inverse(upper)
    return None if Z is None else (Q.T, Z)


def _error(
    family: NormalisedStack,
    box: Box,
    rows: list[Any],
    slopes: list[list[Any]],
    Y: Matrix,
    Z: Matrix,
) -> tuple[float, list[float]]:
    """Above ||I - Y O Z|| on the box, and the share of each side in it."""
    p = Y.shape[1] // len(rows)
    blocks = [ball(exact(Y[:, j * p : (j + 1) * p])) for j in range(len(rows))]
    Z_ball = ball(exact(Z))
    shown = _total([b * row for b, row in zip(blocks, rows, strict=True)]) * Z_ball
    error, widths = magnitudes(identity(len(Y)) - shown), []
    length = float(int(family.length.p) / int(family.length.q))
    for i, slope in enumerate(slopes):
        change = _total([b * s for b, s in zip(blocks, slope, strict=True) if s is not None])
        moved = magnitudes(change * Z_ball) * (length / 2 ** (box.sides[i][0] + 1) * RAISED)
        error = error + moved
        widths.append(norm_above(moved))
    return norm_above(error), widths


def _recalled(seen: list[Any], last: Any, columns: int) -> float:
    """Above the norm of the rows that are seen times the inverse of the first part of `last`."""
    try:
        back = _first_rows(last, columns).inv()
    except ZeroDivisionError:
        return math.inf
    bound = norm_above(np.vstack([magnitudes(row * back) for row in seen]))
    return bound if math.isfinite(bound) else math.inf


def _first_rows(X: Any, count: int) -> Any:
    if X.nrows() == count:
        return X
    return type(X)(count, X.ncols(), [x for row in X.tolist()[:count] for x in row])


def _states(family: NormalisedStack, X: Any, flows: list[Any]) -> list[Any]:
    """X_0, X_1, ... from X_0 on, for given flows."""
    found = [X]
    for E in flows:
        found.append(E * (family.H * found[-1]))
    return found


def _slopes(
    stack: Stack, family: NormalisedStack, X: Any, slope_first: Any, flows: list[Any]
) -> list[list[Any]]:
    """For each theta, the derivatives of the block rows over the box; None where they are zero.

    X: the first state over the box; slope_first: its derivative, None where it is constant.
    """
    moving = [] if slope_first is None else [slope_first]  # dX/dtheta_i for the thetas so far
    slopes: list[list[Any]] = [[] for _ in range(stack.thetas)]
    for j in range(stack.blocks):
        if j:
            jump = flows[j - 1] * family.H
            moving = [jump * D for D in moving]
            X = jump * X
            moving.append(family.F * X)
        for i, column in enumerate(slopes):
            column.append(family.C * moving[i] if i < len(moving) else None)
    return slopes


def _total(terms: list[Any]) -> Any:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _longest(box: Box) -> int | None:
    levels = [level for level, _ in box.sides]
    return int(np.argmin(levels)) if levels else None


def _inverse(upper: Matrix) -> Matrix | None:
    try:
        Z: Matrix = np.asarray(np.linalg.inv(upper), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    return Z if np.isfinite(Z).all() else None
