"""The state of operator `samples` along a record."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from obsdesign.equations.gains import Array
from obsdesign.runtime.base import Vector
from obsdesign.runtime.impulsive_input.event import DoubtfulSpan
from obsdesign.runtime.impulsive_input.residuals import Residuals
from obsdesign.runtime.impulsive_input.samples.filter import Filtered
from obsdesign.runtime.impulsive_input.samples.onset import Cells
from obsdesign.runtime.impulsive_input.samples.steady_input import Steady


@dataclass(frozen=True, slots=True)
class SampledLive:
    """State of operator `samples` along a record.

    t, x, P, u: before the first row. rows: the filter from the window's start on.
    cells: statistics of onsets from the rows after that start. before: the filter at rows of one
    period before it, empty right after a restart: where a refit may begin. steady: explanations of
    the samples without impulses. level: largest |y| so far. residuals: of final rows and windows.
    """

    t: float
    x: Vector
    P: Array | None
    u: Vector
    cells: Cells
    rows: tuple[Filtered, ...] = ()
    before: tuple[Filtered, ...] = ()
    steady: tuple[Steady, ...] = ()
    last_event: float = -math.inf
    last_std: float = 0.0
    doubt: DoubtfulSpan = field(default_factory=DoubtfulSpan)
    level: Array = field(default_factory=lambda: np.zeros(()))
    residuals: Residuals = field(default_factory=Residuals)

    def residuals_with(self, rows: tuple[Filtered, ...]) -> Residuals:
        """The residuals with those of rows that no window will use again."""
        residuals = self.residuals
        for at in rows:
            residuals = residuals.joined(at.cost, len(at.innovation))
        return residuals
