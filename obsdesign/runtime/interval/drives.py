"""Drives of a radius: magnitudes of linear forms of what is known at a step, with weights.

A radius of an uncertain plant follows |A_i m + Q_i (y - C m)| and its like: |F v|, where
v = [m; y at the start; y at the end; u or w; 1] and the rows of F are forms. A drive never has a
sign: in a kernel it is an input of which the column is zero but for an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, raised


@dataclass(frozen=True, slots=True)
class Drives:
    """Of a quantity with k entries: weights (k, forms) >= 0; forms (forms, columns of v)."""

    forms: Enclosure
    weights: Matrix

    @staticmethod
    def none(entries: int, columns: int) -> Drives:
        """No drive of any of the entries."""
        blank = np.zeros((0, columns))
        return Drives(Enclosure(blank, blank), np.zeros((entries, 0)))

    def times(self, left: Matrix) -> Drives:
        """Of left times the quantity, left >= 0."""
        return Drives(self.forms, raised(left @ self.weights, 2 * left.shape[1]))

    def plus(self, other: Drives) -> Drives:
        """Of the sum of two quantities."""
        forms = Enclosure(
            np.vstack([self.forms.mid, other.forms.mid]),
            np.vstack([self.forms.rad, other.forms.rad]),
        )
        return Drives(forms, np.hstack([self.weights, other.weights]))


class Radius(NamedTuple):
    """A bound of k entries: R r + g and what drives add; R (k, n), g (k,)."""

    R: Matrix
    g: Matrix
    drives: Drives

    def times(self, left: Matrix) -> Radius:
        """Left times the bound, left >= 0."""
        terms = 2 * left.shape[1]
        return Radius(
            raised(left @ self.R, terms), raised(left @ self.g, terms), self.drives.times(left)
        )

    def plus(self, other: Radius) -> Radius:
        """The sum of two bounds."""
        return Radius(
            raised(self.R + other.R, 1), raised(self.g + other.g, 1), self.drives.plus(other.drives)
        )


class FormTable:
    """Forms, each once, in the order in which they come."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._places: dict[bytes, int] = {}
        self._rows: list[tuple[Matrix, Matrix]] = []

    def place(self, mid: Matrix, rad: Matrix) -> int:
        """The place of a form (columns,)."""
        place = self._places.setdefault(mid.tobytes() + rad.tobytes(), len(self._rows))
        if place == len(self._rows):
            self._rows.append((mid, rad))
        return place

    def places(self, forms: Enclosure) -> list[int]:
        """The places of forms, one per row."""
        return [self.place(mid, rad) for mid, rad in zip(forms.mid, forms.rad, strict=True)]

    @property
    def forms(self) -> Enclosure:
        """All of them (forms, columns)."""
        ends = [np.array([row[k] for row in self._rows]) for k in (0, 1)]
        return Enclosure(*(end.reshape(-1, self._columns) for end in ends))

    def __len__(self) -> int:
        return len(self._rows)


def common_forms(listed: Iterable[Drives], columns: int) -> tuple[FormTable, list[list[int]]]:
    """All forms of several drives in one table, and for each of these the places of its own."""
    table = FormTable(columns)
    return table, [table.places(drives.forms) for drives in listed]


def spread_out(weights: Matrix, places: Sequence[int], forms: int) -> Matrix:
    """Weights by their places among all forms, (k, forms): those of one place are added."""
    wide = np.zeros((len(weights), forms))
    for column, place in enumerate(places):
        wide[:, place] += weights[:, column]
    return wide
