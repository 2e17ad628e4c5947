"""Disturbances b = Bw w, c = W w with w in a box, as kinds with bounds store them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.stored import matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapedGains(PlantGains):
    """The plant's numbers, with the directions of its disturbances.

    disturbance_matrix (n, k): b = Bw w, with w in [disturbance_lower, disturbance_upper], (k,),
    None where the box is b's own; likewise jump_disturbance_matrix.
    """

    disturbance_matrix: Array | None = matrix("n", "k", optional=True)
    disturbance_lower: Array | None = matrix("k", optional=True)
    disturbance_upper: Array | None = matrix("k", optional=True)
    jump_disturbance_matrix: Array | None = matrix("n", "j", optional=True)
    jump_disturbance_lower: Array | None = matrix("j", optional=True)
    jump_disturbance_upper: Array | None = matrix("j", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for prefix in ("", "jump_"):
            parts = ("matrix", "lower", "upper")
            self.require_together(*(f"{prefix}disturbance_{part}" for part in parts))

    def require_together(self, *names: str) -> None:
        """ValueError where some of these entries are there and others are not."""
        stated = [getattr(self, name) is not None for name in names]
        if any(stated) and not all(stated):
            missing = names[stated.index(False)]
            raise ValueError(f"gains.{missing} is required with the other two; it is missing.")

    @property
    def declared_disturbance(self) -> tuple[Array, Array, Array]:
        """(Bw, lower, upper): b = Bw w with w in the box; Bw = I where the box is b's own."""
        if self.disturbance_matrix is None:
            return np.eye(self.n), self.flow_lower, self.flow_upper
        lower, upper = self.disturbance_lower, self.disturbance_upper
        return self.disturbance_matrix, present(lower), present(upper)

    @property
    def jump_disturbance(self) -> tuple[Array, Array, Array]:
        """The same of c; ValueError where the plant has no jumps."""
        if self.jump_disturbance_matrix is None:
            if self.jump_lower is None or self.jump_upper is None:
                raise ValueError("gains.jump_lower is missing: this plant has no jumps.")
            return np.eye(self.n), self.jump_lower, self.jump_upper
        lower, upper = self.jump_disturbance_lower, self.jump_disturbance_upper
        return self.jump_disturbance_matrix, present(lower), present(upper)


def present(values: Array | None) -> Array:
    """Bounds that come with their matrix."""
    assert values is not None
    return values


def shaped_entries(prefix: str, columns: Array | None, lower: Array, upper: Array) -> NewEntries:
    """Entries of the disturbance columns @ w; prefix: "" of the flow, "jump_" of the jump."""
    return {
        f"{prefix}disturbance_matrix": columns,
        f"{prefix}disturbance_lower": lower,
        f"{prefix}disturbance_upper": upper,
    }
