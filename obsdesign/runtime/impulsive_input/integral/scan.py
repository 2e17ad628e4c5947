"""A search along the rows of a track: its values, their noise, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.impulsive_input.integral.noise_level import NoiseLevel, Scores
from obsdesign.runtime.impulsive_input.integral.search import Position, Rule, Search
from obsdesign.runtime.state_marks import Axes


@dataclass(frozen=True, slots=True)
class Scan:
    """Values of the first rows, whose windows are complete, and their deviations in noise.

    values: |R|, or as `position` has it; matched: deviations of an impulse that stands out of white
    features. rule: None until there is one. noise: of the last window; position: that of exact y.
    """

    values: Annotated[Matrix, Axes("rows")] = field(default_factory=lambda: np.zeros(0))
    sigmas: Annotated[Matrix, Axes("rows")] = field(default_factory=lambda: np.zeros(0))
    matched: Annotated[Matrix, Axes("rows")] = field(default_factory=lambda: np.zeros(0))
    search: Search = field(default_factory=Search)
    rule: Rule | None = None
    noise: NoiseLevel | None = None
    position: Position | None = None

    def from_row(self, row: int) -> Scan:
        """The scan after the rows in front of a row were dropped."""
        return replace(
            self, values=self.values[row:], sigmas=self.sigmas[row:], matched=self.matched[row:],
            search=self.search.shifted(row),
        )  # fmt: skip

    def extended(self, scores: Scores) -> Scan:
        """The scan with the values of further rows."""
        return replace(
            self, values=np.concatenate([self.values, scores.values]),
            sigmas=np.concatenate([self.sigmas, scores.sigmas]),
            matched=np.concatenate([self.matched, scores.matched]),
        )  # fmt: skip
