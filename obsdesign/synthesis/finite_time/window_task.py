"""A finite-time design before its gains on the window are computed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from lmi.arithmetic.arrays import Matrix
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.requirements import relative_deviations
from obsdesign.equations.finite_time.gains import CORRECTED, PRINTED
from obsdesign.equations.finite_time.rows import END, START, state_scales
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem


@dataclass(frozen=True)
class WindowTask:
    """Plant, method and samples; L where the method has one; reference: END or START."""

    plant: Plant
    method: str
    samples: int
    L: Matrix | None = None
    half_sample: str | None = None
    reference: str = END

    @classmethod
    def from_problem(cls, problem: Problem, samples: int, L: Matrix | None = None) -> Self:
        """The task of a problem for this number of samples and this L."""
        options = problem.options_as(FiniteTimeOptions)
        half_sample = None
        if options.method == "approximate":
            half_sample = CORRECTED if options.half_sample_correction else PRINTED
        return cls(problem.plant, options.method, samples, L, half_sample)

    def relative_to_start(self) -> Self:
        """The same task for the state at the window's start."""
        return replace(self, reference=START)

    @property
    def A(self) -> Matrix:
        """(n, n)."""
        return self.plant.flow.A

    @property
    def C(self) -> Matrix:
        """(p, n)."""
        return self.plant.output.C

    @property
    def period(self) -> float:
        """Time from one sample to the next."""
        return self.plant.output.sample_period

    @property
    def is_relative_to_start(self) -> bool:
        """Do the gains speak of x(t_i - T)?"""
        return self.reference == START

    @property
    def deviations(self) -> Matrix:
        """Relative sizes of the outputs' errors (p,)."""
        return relative_deviations(self.plant.output)

    @property
    def scales(self) -> Matrix:
        """Units of the states for this window (n,), see `state_scales`."""
        return state_scales(self.A, self.C, self.samples * self.period)

    def sampled(self) -> Sampled:
        """The sampled plant, enclosed at the current precision."""
        return Sampled.from_plant(self.A, self.C, self.period, self.samples, self.reference)
