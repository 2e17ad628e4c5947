"""Gains of the interval observer: what a design of kind `interval` stores."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import PlantGains, matrix, number, word

FORMS = ("cooperative", "split", "coordinates", "two_coordinates")


@dataclass(frozen=True, kw_only=True, eq=False)
class IntervalGains(PlantGains):
    """L, M (n, p), the splits that the bounds follow, and the coordinates x = S z they live in.

    form: theorem of the design. period: of the samples where samples are events, else None.
    S (n, n): None for the plant's own coordinates; S2, T (n, n): coordinates of the jumps and the
    jump there, form `two_coordinates`. D0, D1 (n, n): split of the flow of the error; Gp, Gn
    (n, n): of its jump, None without jumps and in form `two_coordinates`. step_limit: the longest
    step of a continuous y for which a width is guaranteed, None where none is named.
    """

    noise_bound: Array = matrix("p")
    form: str = word(*FORMS)
    period: float | None = number(optional=True)
    L: Array = matrix("n", "p")
    M: Array = matrix("n", "p")
    S: Array | None = matrix("n", "n", optional=True)
    S2: Array | None = matrix("n", "n", optional=True)
    D0: Array = matrix("n", "n")
    D1: Array = matrix("n", "n")
    T: Array | None = matrix("n", "n", optional=True)
    Gp: Array | None = matrix("n", "n", optional=True)
    Gn: Array | None = matrix("n", "n", optional=True)
    step_limit: float | None = number(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        needed = {"two_coordinates": ("S", "S2", "T"), "coordinates": ("S",)}.get(self.form, ())
        if self.G is not None and self.form != "two_coordinates":
            needed = (*needed, "Gp", "Gn")
        if self.S2 is not None:
            needed = (*needed, "T")
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"gains.{name} is required by form {self.form!r}; it is missing.")

    def to_document(self) -> NewEntries:
        """Entries of a design file: the form, then those that the design has."""
        return {"form": self.form} | super().to_document()

    @property
    def is_periodic(self) -> bool:
        """Are samples events, a period apart?"""
        return self.period is not None

    @property
    def skips_jumps(self) -> bool:
        """Is no sample taken at the time of a jump?"""
        return self.G is not None and self.jump_measurement == "none"

    @property
    def dwell_ends(self) -> tuple[float, float]:
        """(shortest, longest) dwell time; (inf, inf) without jumps: none ever comes."""
        return (math.inf, math.inf) if self.G is None else self.dwell_range

    @property
    def jump_split(self) -> tuple[Array, Array]:
        """(Gp, Gn); ValueError where the design has none."""
        if self.Gp is None or self.Gn is None:
            raise ValueError("gains.Gp and gains.Gn are missing: this design has no such split.")
        return self.Gp, self.Gn

    @property
    def jump_bounds(self) -> tuple[Array, Array]:
        """(lower, upper) of c; ValueError where the plant has no jumps."""
        if self.jump_lower is None or self.jump_upper is None:
            raise ValueError("gains.jump_lower is missing: this plant has no jumps.")
        return self.jump_lower, self.jump_upper
