"""Widths on the nominal pattern in ball arithmetic: maps of half widths, enclosed."""

from __future__ import annotations

from dataclasses import replace

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import (
    PRECISIONS,
    ball_column,
    entries,
    exact,
    exp_times,
    precision,
    upper_ends,
)
from obsdesign.analysis.set_membership.pieces import pieces_of
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.nominal import Arithmetic, NominalMaps, RowMap, row_maps
from obsdesign.equations.set_membership.pattern import Pattern

WIDTH_BITS = PRECISIONS[1]


def _exponential(X: Array, t: float) -> Array:
    return entries(exp_times(X, t))


BALLS = Arithmetic(exact, _exponential)


def enclosed_rows(
    gains: SetMembershipGains, pattern: Pattern, multipliers: Matrix
) -> list[RowMap]:  # fmt: skip
    """The map of every row of a cycle in balls of the working precision."""
    return row_maps(NominalMaps(gains, BALLS), pattern, pieces_of(gains), multipliers)


def upper_rows(gains: SetMembershipGains, pattern: Pattern, multipliers: Matrix) -> list[RowMap]:
    """The same in floats, rounded up."""
    with precision(WIDTH_BITS):
        rows = enclosed_rows(gains, pattern, multipliers)
        return [replace(row, M=_upper(row.M), k=_upper(row.k)) for row in rows]


def _upper(values: Array) -> Matrix:
    """Floats that are certainly at least the balls of an array."""
    return upper_ends(ball_column(values.reshape(-1).tolist())).reshape(values.shape)
