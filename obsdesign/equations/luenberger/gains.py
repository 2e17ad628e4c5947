"""Gains of the point observer: what a design of kind `luenberger` stores."""

from __future__ import annotations

from dataclasses import dataclass

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import PlantGains, plant_data
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import matrix, number
from obsdesign.equations.time_grid import steps_of


@dataclass(frozen=True, kw_only=True, eq=False)
class LuenbergerGains(PlantGains):
    """L, M (n, p); with a schedule also M_cells (cells, n, p) and dwell_borders (cells - 1,).

    The gain at a jump is then that of the cell of the dwell time that ends there; M serves the
    first jump, before which no dwell time is known. input_bound (m,), jump_input_bound (l,):
    largest |u| and |w| that bounds of the error count on, None where they count on none.
    """

    L: Array = matrix("n", "p")
    M: Array = matrix("n", "p")
    M_cells: Array | None = matrix("cells", "n", "p", optional=True)
    dwell_borders: Array | None = matrix("borders", optional=True)
    input_bound: Array | None = matrix("m", optional=True)
    jump_input_bound: Array | None = matrix("l", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        cells = 0 if self.M_cells is None else len(self.M_cells)
        borders = -1 if self.dwell_borders is None else len(self.dwell_borders)
        if cells != borders + 1:
            raise ValueError(
                f"gains.M_cells must hold one matrix more than gains.dwell_borders has entries; "
                f"got {cells} and {max(borders, 0)}."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class StepGains(PlantGains):
    """The same in discrete time, where L acts at samples alone.

    x+ = x + L (y - C x) at samples, x+ = G x + M (y - C x) at events. period: between samples,
    None where y is known at events alone.
    """

    L: Array = matrix("n", "p")
    M: Array = matrix("n", "p")
    period: float | None = number(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dt is None:
            raise ValueError("gains.dt is missing.")
        if self.period is not None and not steps_of(self.period, self.dt):
            raise ValueError("gains.period must be a multiple of gains.dt.")

    @property
    def period_steps(self) -> int:
        """Steps from sample to sample; 1 where y is known at events alone."""
        return 1 if self.period is None else steps_of(self.period, self.step) or 1


def step_entries(plant: Plant) -> NewEntries:
    """The plant's numbers that a design in discrete time stores."""
    is_sampled = plant.output.measured == "periodic"
    return plant_data(plant) | ({"period": plant.output.period} if is_sampled else {})
