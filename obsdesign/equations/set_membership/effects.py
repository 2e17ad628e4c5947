"""Effects of parameters as disturbances of known directions: columns times rows of (x, u).

p X (x, u), |p| <= 1, is column * w with |w| <= |row (x, u)|, for each row of X; one column serves
all rows of X that are multiples of one, and effects that share it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Matrix


@dataclass(frozen=True)
class Factors:
    """Columns (n, k) and rows (r, n + inputs); of_column (k, r): 1 where a row acts along one."""

    columns: Matrix
    rows: Matrix
    of_column: Matrix

    def bounds(self, sizes: Matrix) -> Matrix:
        """Bounds (k,) of w of the columns from bounds (r,) of |row (x, u)|, rounded up."""
        total = self.of_column @ sizes
        return np.where(total > 0, total * (1.0 + (2 * len(sizes) + 4) * 2.0**-53), 0.0)


def factored(effects: Sequence[Matrix], shape: tuple[int, int]) -> Factors:
    """The factors of effects of one shape, (n, n + inputs), exact."""
    n, width = shape
    columns: dict[tuple[float, ...], int] = {}
    rows, owners = [], []
    for effect in effects:
        for column, row in _factors(effect):
            owners.append(columns.setdefault(tuple(column.tolist()), len(columns)))
            rows.append(row)
    of_column = np.zeros((len(columns), len(rows)))
    of_column[owners, np.arange(len(rows))] = 1.0
    listed = np.array(list(columns)).reshape(len(columns), n).T
    return Factors(listed, np.array(rows).reshape(len(rows), width), of_column)


def _factors(effect: Matrix) -> Iterable[tuple[Matrix, Matrix]]:
    """(column, row) of an effect: one pair where its rows are exact multiples of the first."""
    places = np.flatnonzero(effect.any(axis=1))
    if len(places) == 0:
        return
    first = effect[places[0]]
    column = np.zeros(len(effect))
    for j in places.tolist():
        ratio = _ratio(effect[j], first)
        if ratio is None:
            for k in places.tolist():
                yield np.eye(len(effect))[k], effect[k]
            return
        column[j] = ratio
    yield column, first


def _ratio(row: Matrix, first: Matrix) -> float | None:
    """The binary64 number that times `first` is `row`, exactly; None without one."""
    k = int(np.flatnonzero(first)[0])
    ratio = Fraction(float(row[k])) / Fraction(float(first[k]))
    is_same = all(
        ratio * Fraction(a) == Fraction(b)
        for a, b in zip(first.tolist(), row.tolist(), strict=True)
    )
    return float(ratio) if is_same and Fraction(float(ratio)) == ratio else None
