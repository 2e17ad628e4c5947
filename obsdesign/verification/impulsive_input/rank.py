"""Rank, relative to size, of the features or samples of a window as functions of the state."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import (
    PRECISIONS,
    Ball,
    Exact,
    ball,
    certify_pivots,
    exact,
    exp_times,
    number,
    precision,
    to_float,
)
from lmi.arithmetic.exponential import exponential_grid
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.verification.impulsive_input.window import PAPER, shown

# rank is decided relative to size: smallest singular value of W, rows and columns scaled to one
RANK_TOLERANCE = 1e-10
# makes a table of balls at the precision in force
Rows = Callable[[], list[list[Ball]]]


def full_rank(D: Exact, C: Exact, exponents: list[float], window: float) -> Claim:
    """W(tau) has rank n; (12) is not enough for this where the spectrum of D is complex."""
    statement = (
        "the features of a window determine the error of the state: W(tau) has rank n, its "
        f"smallest singular value at least {RANK_TOLERANCE!r} of the largest when scaled"
    )
    rows = _operator_ball(D, C, exponents, window)
    verdict = rank_verdict(rows, _row_sizes(D, C, exponents, window), len(D), "the features")
    return Claim.from_verdict("rank", statement, f"{PAPER}, Section III-B", verdict)


def _operator_ball(D: Exact, C: Exact, exponents: list[float], window: float) -> Rows:
    """Function of no arguments: rows of W(tau) as balls at the precision in force."""

    def rows() -> list[list[Ball]]:
        n = len(D)
        zero, unit = exact(np.zeros((n, n))), exact(np.eye(n))
        table = []
        for row in range(len(C)):
            for lam in exponents:
                F = np.block([[exact(lam * np.eye(n)) - D, unit], [zero, zero]])
                pick = np.hstack([C[row : row + 1], exact(np.zeros((1, n)))])
                whole = ball(pick) * exp_times(F, window)
                table.append(whole.tolist()[0][n:])
        return table

    return rows


def _row_sizes(D: Exact, C: Exact, exponents: list[float], window: float) -> Matrix:
    """Size of each row of W if nothing in its integral cancelled; floats, to scale by."""
    D_float, C_float, count = to_float(D), to_float(C), 64
    sizes = []
    for lam in exponents:
        grid = exponential_grid(lam * np.eye(len(D)) - D_float, 0.0, window / count, count + 1)
        sizes.append(np.abs(C_float @ grid).mean(axis=0).max(axis=1) * window)
    return np.array(sizes).T.reshape(-1)  # output by output


def rank_verdict(rows: Rows, row_sizes: Matrix, n: int, what: str) -> Verdict:
    """n columns of balls are independent, relative to RANK_TOLERANCE; refuted with a vector.

    row_sizes: natural size of each row; rows are divided by them, columns by their own size.
    """
    margin = math.nan
    for bits in PRECISIONS:
        with precision(bits):
            table = rows()
            W = np.array([[float(x.mid()) for x in row] for row in table])
            if not (np.isfinite(W).all() and np.isfinite(row_sizes).all()):
                return undecided("W(tau) overflows: exponents times window are too large")
            if all(x == 0 for row in table for x in row):
                reason = f"{what} are zero: they show nothing of the state"
                return refuted({"vector": [1.0] + [0.0] * (n - 1), "reason": reason})
            row_scale = _powers(row_sizes)
            scaled = W / row_scale[:, None]
            column_scale = _powers(np.linalg.norm(scaled, axis=0))
            scaled = scaled / column_scale
            sizes = np.linalg.svd(scaled, compute_uv=False)
            margin = float(sizes[-1] / sizes[0]) if sizes[0] > 0 and len(W) >= n else 0.0
            balls = [
                [
                    x / number(float(a)) / number(float(b))
                    for x, b in zip(row, column_scale, strict=True)
                ]
                for row, a in zip(table, row_scale, strict=True)
            ]
            certain = _certain(balls, n)
            if certain is True:
                return proved(approx_margin=margin, tolerance=RANK_TOLERANCE)
            if certain is False:
                direction = (np.linalg.svd(scaled)[2][-1] / column_scale).tolist()
                reason = (
                    f"{what} hardly show the direction {shown(direction)} of the state: "
                    f"relative size {margin:.3g}, below {RANK_TOLERANCE:g}; change the window"
                )
                return refuted({"vector": direction, "approx_margin": margin, "reason": reason})
    return undecided(f"the rank is not certain: relative margin {margin:.3g}", approx_margin=margin)


def _certain(rows: list[list[Ball]], n: int) -> bool | None:
    """Whether the smallest singular value is at least RANK_TOLERANCE of the largest.

    None: neither is certain.
    """
    gram = [[_dot(rows, i, j) for j in range(i + 1)] for i in range(n)]
    total = sum((gram[i][i] for i in range(n)), number(0.0))
    least = number(RANK_TOLERANCE) ** 2 * total  # trace >= largest singular value squared
    for i in range(n):
        gram[i][i] = gram[i][i] - least
    if certify_pivots(gram):
        return True
    middles = np.array([[float(x.mid()) for x in row] for row in rows])
    v = [number(float(x)) for x in np.linalg.svd(middles)[2][-1]]
    through = [sum((a * b for a, b in zip(row, v, strict=True)), number(0.0)) for row in rows]
    image_size = sum((x * x for x in through), number(0.0))
    size = sum((x * x for x in v), number(0.0))
    # the largest singular value squared is at least trace / n
    return False if image_size < number(RANK_TOLERANCE) ** 2 * (total / n) * size else None


def _powers(sizes: Matrix) -> Matrix:
    with np.errstate(divide="ignore"):
        exponents = np.where(sizes > 0, np.round(np.log2(np.where(sizes > 0, sizes, 1.0))), 0.0)
    return np.asarray(np.ldexp(1.0, exponents.astype(int)))


def _dot(rows: list[list[Ball]], i: int, j: int) -> Ball:
    return sum((row[i] * row[j] for row in rows), number(0.0))
