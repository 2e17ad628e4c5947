"""Inverses of I - M for nonnegative M, where they are nonnegative: small gains, in balls."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmi.arithmetic.balls import ball, exact, scalar


def nonnegative_inverse(M: list[list[Any]]) -> list[list[Any]] | None:
    """Balls that bound (I - M)^-1 for every matrix with entries in [0, M_ij], M nonnegative balls.

    None unless some v > 0 has (I - M) v > 0, certainly: then the spectral radius of M is below 1.
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
