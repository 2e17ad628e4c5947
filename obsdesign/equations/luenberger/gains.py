"""Gains of the point observer: what a design of kind `luenberger` stores."""

from __future__ import annotations

from dataclasses import dataclass

from lmi.arithmetic.arrays import Array
from obsdesign.equations.gains import PlantGains, matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class LuenbergerGains(PlantGains):
    """L, M (n, p); with a schedule also M_cells (cells, n, p) and dwell_borders (cells - 1,).

    The gain at a jump is then that of the cell of the dwell time that ends there; M serves the
    first jump, before which no dwell time is known.
    """

    L: Array = matrix("n", "p")
    M: Array = matrix("n", "p")
    M_cells: Array | None = matrix("cells", "n", "p", optional=True)
    dwell_borders: Array | None = matrix("borders", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        cells = 0 if self.M_cells is None else len(self.M_cells)
        borders = -1 if self.dwell_borders is None else len(self.dwell_borders)
        if cells != borders + 1:
            raise ValueError(
                f"gains.M_cells must hold one matrix more than gains.dwell_borders has entries; "
                f"got {cells} and {max(borders, 0)}."
            )
