"""Gains of the impulsive observer: what a design of kind `impulsive` stores."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.stored import count, matrix, number, word

LONGEST_WINDOW = 4096  # impulses
STRATEGIES = ("full", "compressed", "subspace", "quadratic")
# entries that a strategy adds; all but `quadratic` have window and alpha besides
_NEEDED = {
    "full": (),
    "compressed": ("image", "coimage"),
    "subspace": ("core_place", "basis", "core_A", "core_G", "core_C"),
    "quadratic": ("cells", "table"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpulsiveGains(PlantGains):
    """The strategy and its entries, which are None in the others.

    alpha, window: weight of the past and impulses, but for `quadratic`. basis (n, n): coordinates
    of `subspace`; core_place: first column of the core in it, and its size d; core_A, core_G,
    core_C: the core. image (d, r), coimage (r, d): factors of the jump of a compressed window.
    cells: rising borders of cells of spacings; table: the gain of each (cells - 1, n, p).
    """

    strategy: str = word(*STRATEGIES)
    alpha: float | None = number(optional=True)
    basis: Array | None = matrix("n", "n", optional=True)
    core_place: Array | None = matrix(2, optional=True)
    core_A: Array | None = matrix("d", "d", optional=True)
    core_G: Array | None = matrix("d", "d", optional=True)
    core_C: Array | None = matrix("p", "d", optional=True)
    image: Array | None = matrix("d", "r", optional=True)
    coimage: Array | None = matrix("r", "d", optional=True)
    window: int | None = count(optional=True)
    cells: Array | None = matrix("borders", optional=True)
    table: Array | None = matrix("cells", "n", "p", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("G", "dwell_time", *_NEEDED[self.strategy]):
            if getattr(self, name) is None:
                raise ValueError(f"gains.{name} is missing.")
        if (self.image is None) != (self.coimage is None):
            raise ValueError("gains.image and gains.coimage belong together; got one of them.")
        if self.jump_measurement not in ("before", "after"):
            raise ValueError("gains.jump_measurement must be before or after.")
        if self.strategy == "quadratic":
            self._check_table()
        else:
            self._check_window()
        self._check_core()

    def _check_table(self) -> None:
        cells, table = map(len, self.gain_table)
        if not cells == table + 1 > 1:
            raise ValueError(
                "gains.cells must hold one border more than gains.table has gains, and 2 at least; "
                f"got {cells} and {table}."
            )

    def _check_window(self) -> None:
        if self.window is None or self.window > LONGEST_WINDOW:
            raise ValueError(
                f"gains.window must be a whole number from 1 to {LONGEST_WINDOW}; "
                f"got {self.window}."
            )
        if self.alpha is None or not 1 < self.alpha < math.inf:
            raise ValueError(f"gains.alpha must be a number > 1; got {self.alpha}.")

    def _check_core(self) -> None:
        if self.core_place is not None and self.core_A is not None:
            first, size = self.core_place.tolist()
            whole = float(first).is_integer() and first >= 0 and size == len(self.core_A)
            if not whole or first + size > self.n:
                raise ValueError("gains.core_place must be two whole numbers, first and size.")
        rows = self.n if self.core_A is None else len(self.core_A)
        if self.image is not None and (len(self.image) != rows or not self.image.size):
            raise ValueError(f"gains.image must have {rows} rows; got shape {self.image.shape}.")

    @property
    def has_window(self) -> bool:
        """Whether gains come from a window of impulses, not from a table."""
        return self.strategy != "quadratic"

    @cached_property
    def window_length(self) -> int:
        """Impulses that one spacing stays in the window for; 1 without a window."""
        return 1 if self.window is None else self.window

    @cached_property
    def window_weight(self) -> float:
        """The weight alpha of the past; 1 without a window."""
        return 1.0 if self.alpha is None else self.alpha

    @property
    def core_columns(self) -> slice:
        """Columns of the basis that span the core; ValueError without a basis."""
        if self.core_place is None:
            raise ValueError("gains.core_place is missing: the core is the whole state.")
        first, size = self.core_place.tolist()
        return slice(int(first), int(first + size))

    @property
    def gain_table(self) -> tuple[Array, Array]:
        """(borders of the cells of spacings, gain of each cell); ValueError without a table."""
        if self.cells is None or self.table is None:
            raise ValueError("gains.table is missing: this strategy has no table.")
        return self.cells, self.table

    def table_gain(self, spacing: Array | float) -> Array:
        """The gain, or gains, of the table for the cells that spacings are in."""
        borders, table = self.gain_table
        cell = np.searchsorted(borders, spacing, side="right") - 1
        return np.asarray(table[np.clip(cell, 0, len(table) - 1)])
