"""The state of operator `samples` along a record, from its first row on."""

from __future__ import annotations

from dataclasses import dataclass, field

from obsdesign.runtime.impulsive_input.history import History
from obsdesign.runtime.impulsive_input.residuals import Residuals
from obsdesign.runtime.impulsive_input.samples.filter import Filtered
from obsdesign.runtime.impulsive_input.samples.onset import Cells
from obsdesign.runtime.impulsive_input.samples.steady_input import SteadyInputs
from obsdesign.runtime.state_marks import Outputs, Past, States


@dataclass(frozen=True, slots=True)
class SampledLive:
    """The filter at the rows from the window's start on, one at least, and what it shows.

    cells: statistics of onsets from the rows after that start. before: the filter at rows before
    it, none of them before a restart, where a refit may begin: from the shortest dwell time before
    the window's end on, at least one period. steady: explanations of the samples without impulses.
    level: largest |y| so far. first: time of the record's first row, the phase of
    periodic samples. guess: the state at the first open row before any sample, while the deviations
    of it are still to be taken from a window.
    """

    rows: tuple[Filtered, ...]
    cells: Cells
    steady: SteadyInputs
    level: Outputs
    first: Past
    before: tuple[Filtered, ...] = ()
    guess: States | None = None
    history: History = field(default_factory=History)

    def residuals_with(self, rows: tuple[Filtered, ...]) -> Residuals:
        """The residuals with those of rows that no window will use again."""
        residuals = self.history.residuals
        for at in rows:
            residuals = residuals.joined(at.cost, len(at.innovation))
        return residuals
