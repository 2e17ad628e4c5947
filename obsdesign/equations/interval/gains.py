"""Gains of the interval observer: what a design of kind `interval` stores."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

from lmi.arithmetic.arrays import Array, NewEntries, Value
from obsdesign.equations.gains import plant_data
from obsdesign.equations.parameters import MATRICES, EffectGains
from obsdesign.equations.plant import Plant
from obsdesign.equations.shaped_gains import ShapedGains, shaped_entries
from obsdesign.equations.stored import blocks, matrix, number, word

# gains on the measured part of effects, of any values
CORRECTIONS = ("flow_correction", "jump_correction")
FORMS = ("cooperative", "split", "coordinates", "two_coordinates")


@dataclass(frozen=True, kw_only=True, eq=False)
class IntervalGains(ShapedGains):
    """L, M (n, p), the splits that the bounds follow, and the coordinates x = S z they live in.

    form: theorem of the design. period: of the samples where samples are events, else None.
    S (n, n): None for the plant's own coordinates; S2, T (n, n): coordinates of the jumps and the
    jump there, form `two_coordinates`. D0, D1 (n, n): split of the flow of the error; Gp, Gn
    (n, n): of its jump, None without jumps and in form `two_coordinates`. step_limit: the longest
    step of a continuous y for which a width is guaranteed, None where none is named. D d with a
    bounded d is a part of disturbance_matrix.

    Of a plant with parameters A, B, G, E and C are nominal, and all bounds include effects: what
    each parameter adds as it goes from 0 to 1; flow_effect, jump_effect (n,), output_effect (p,):
    how much of the bounds of b, c and v they are. They hold while state_lower <= x <= state_upper,
    pre_jump_lower <= x <= pre_jump_upper just before jumps, |u| <= input_bound (m,) and
    |w| <= jump_input_bound (l,), of those inputs that the bounds count on. state_tube (n,): of a
    proved box, which holds once |x| <= state_tube, just after a jump if there are any; None of
    one that is stated. flow_correction,
    jump_correction (q, n, p): for each effect gains on y - C m in the observer's coordinates, which
    take the measured part of A_i x and G_i x from y; None for zero. Any gains are sound.
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
    effects: tuple[EffectGains, ...] = blocks(EffectGains)
    flow_effect: Array | None = matrix("n", optional=True)
    jump_effect: Array | None = matrix("n", optional=True)
    output_effect: Array | None = matrix("p", optional=True)
    state_lower: Array | None = matrix("n", optional=True)
    state_upper: Array | None = matrix("n", optional=True)
    pre_jump_lower: Array | None = matrix("n", optional=True)
    pre_jump_upper: Array | None = matrix("n", optional=True)
    state_tube: Array | None = matrix("n", optional=True)
    input_bound: Array | None = matrix("m", optional=True)
    jump_input_bound: Array | None = matrix("l", optional=True)
    flow_correction: Array | None = matrix("q", "n", "p", optional=True)
    jump_correction: Array | None = matrix("q", "n", "p", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        needed = {"two_coordinates": ("S", "S2", "T"), "coordinates": ("S",)}.get(self.form, ())
        if self.G is not None and self.form != "two_coordinates":
            needed = (*needed, "Gp", "Gn")
        if self.S2 is not None:
            needed = (*needed, "T")
        for name in CORRECTIONS:
            own = getattr(self, name)
            if own is not None and len(own) != len(self.effects):
                raise ValueError(f"gains.{name} must have one matrix for each of gains.effects.")
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"gains.{name} is required by form {self.form!r}; it is missing.")

    @classmethod
    def from_plant(cls, plant: Plant, **gains: Value) -> Self:
        """Gains with the numbers of a plant."""
        return cls(**plant_data(plant), **shaped_data(plant), **gains)

    def to_document(self) -> NewEntries:
        """Entries of a design file: the form, then those that the design has."""
        return {"form": self.form} | super().to_document()

    @cached_property
    def is_uncertain(self) -> bool:
        """Does a parameter add anything?"""
        stated = [getattr(each, key) for each in self.effects for key in MATRICES]
        return any(values is not None and values.any() for values in stated)

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


def shaped_data(plant: Plant) -> NewEntries:
    """Entries of disturbances that are a matrix times w, of those that the plant has."""
    entries: NewEntries = {}
    if plant.flow.disturbance_matrix is not None or plant.flow.d_bounds is not None:
        entries |= shaped_entries("", *plant.flow.shaped_disturbance)
    if plant.jump is not None and plant.jump.disturbance_matrix is not None:
        entries |= shaped_entries("jump_", *plant.jump.shaped_disturbance)
    return entries
