"""Bounds of b, c and v that change from row to row, inside the declared ones.

Assumption 3 of Degue, Efimov, Richard (NOLCOS 2016). Those of b hold from a row to the next one,
those of c at the jump of the row, those of v for the measurement of the row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import numbered, pairs

# lower and upper bounds, of one row (n,) or of all (rows, n)
Pair = tuple[ArrayLike, ArrayLike]


class Bounds(NamedTuple):
    """(lower, upper) of the flow disturbance b, the jump disturbance c and the noise v.

    (n,) or (p,) each, in a record (rows, n) or (rows, p). None, or NaN in an entry: as declared.
    """

    b: Pair | None = None
    c: Pair | None = None
    v: Pair | None = None

    def rows(self, count: int) -> Iterator[Bounds | None]:
        """Bounds of each row of a record; None where a row has none.

        ValueError unless every array has `count` rows.
        """
        pairs = [None if pair is None else _tables(pair, count) for pair in self]
        for i in range(count):
            own = [None if p is None or np.isnan(p[:, i]).all() else p[:, i] for p in pairs]
            if all(pair is None for pair in own):
                yield None
            else:
                yield Bounds(*(None if pair is None else (pair[0], pair[1]) for pair in own))


def _tables(pair: Pair, count: int) -> Matrix:
    ends = [np.asarray(end, dtype=np.float64) for end in pair]
    for end in ends:
        if len(end) != count:
            raise ValueError(f"every array must have {count} rows, as t has; got {len(end)}.")
    return np.array([end.reshape(count, -1) for end in ends])


@dataclass(frozen=True)
class DeclaredBox:
    """Declared bounds of b, c or v; name: the letter of its columns; lower, upper: (n,)."""

    name: str
    lower: Matrix
    upper: Matrix

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns: b1_lo, b1_hi, b2_lo, ..."""
        return pairs(numbered(self.name, len(self.lower)))

    def completed(self, pair: Pair | None) -> tuple[Matrix, Matrix]:
        """(lower, upper) of a row, NaN as declared; ValueError unless they are inside."""
        if pair is None:
            return self.lower, self.upper
        ends = [np.asarray(end, dtype=np.float64).reshape(-1) for end in pair]
        for end in ends:
            if end.shape != self.lower.shape:
                raise ValueError(
                    f"bounds of {self.name} must have {len(self.lower)} entries; got {end.size}."
                )
        lower = np.where(np.isnan(ends[0]), self.lower, ends[0])
        upper = np.where(np.isnan(ends[1]), self.upper, ends[1])
        if not ((self.lower <= lower) & (lower <= upper) & (upper <= self.upper)).all():
            raise ValueError(self._objection(lower, upper))
        return lower, upper

    def _objection(self, lower: Matrix, upper: Matrix) -> str:
        """Sentence on the first entry that is outside the declared bounds, or crossed."""
        declared = zip(self.lower.tolist(), self.upper.tolist(), strict=True)
        ends = zip(lower.tolist(), upper.tolist(), declared, strict=True)
        for i, (low, high, (least, most)) in enumerate(ends):
            title = f"{self.name}{i + 1}"
            for end, value in (("lo", low), ("hi", high)):
                if not least <= value <= most:
                    return (
                        f"{title}_{end} must be within the declared bounds "
                        f"[{_as_stated(least)}, {_as_stated(most)}]; got {value!r}."
                    )
            if low > high:
                return f"{title}_lo must not exceed {title}_hi; got {low!r} above {high!r}."
        raise AssertionError("these bounds are inside the declared ones")


def _as_stated(end: float) -> str:
    """An end of declared bounds as a file states it: without the rounding of `declared_noise`."""
    return repr(float(f"{end:.15g}"))


def declared_noise(V: Matrix, centre: Matrix | None) -> DeclaredBox:
    """Bounds of the noise v of a design: |v - centre| <= V."""
    if centre is None:
        return DeclaredBox("v", -V, V)
    # stored as middle and radius: the ends up to rounding
    low = np.where(V > 0, np.nextafter(centre - V, -np.inf), centre)
    return DeclaredBox("v", low, np.where(V > 0, np.nextafter(centre + V, np.inf), centre))


@dataclass(frozen=True)
class DeclaredBounds:
    """Declared bounds of b, c and v; c None without jumps."""

    b: DeclaredBox
    c: DeclaredBox | None
    v: DeclaredBox

    @property
    def boxes(self) -> tuple[DeclaredBox, ...]:
        """Those that there are."""
        return (self.b, self.v) if self.c is None else (self.b, self.c, self.v)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all columns of bounds."""
        return tuple(title for box in self.boxes for title in box.columns)
