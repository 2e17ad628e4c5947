"""Unknown-input observers in discrete time: state and input one step late at most.

    z = A x_hat + B u + b_mid,   x_hat = z + M (y - C z),   d_hat = N (y - C z)

With N C D = I and M C D = D the input drops out: the error obeys e+ = (I - M C) A e, and d_hat, of
the step that ends at the row, is off by N C A e. M = D N + K (I - C D N) for any K.
"""

from __future__ import annotations

from dataclasses import dataclass

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import PlantGains, plant_data
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class StepInputGains(PlantGains):
    """D (n, q): of the unknown input; M (n, p), N (q, p): gains of the state and of the input."""

    D: Array = matrix("n", "q")
    M: Array = matrix("n", "p")
    N: Array = matrix("q", "p")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dt is None:
            raise ValueError("gains.dt is missing.")


def input_entries(plant: Plant) -> NewEntries:
    """The plant's numbers that a design stores; bounds of d are of no use to it."""
    lower, upper = plant.flow.disturbance_box()
    return plant_data(plant) | {"flow_lower": lower, "flow_upper": upper, "D": plant.flow.D}
