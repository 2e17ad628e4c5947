"""Operator `integral` with open exponents: gain, window and margin, chosen or given."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.evaluation_rule import threshold_for
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.equations.impulsive_input.output_units import output_units
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem


@dataclass(frozen=True, kw_only=True)
class IntegralWindow:
    """Every gain of operator `integral` but the exponents and the rule that follows from them.

    K (n, p).
    """

    problem: Problem
    K: Matrix
    window: float
    margin: float
    weighting: str

    @property
    def options(self) -> ImpulsiveInputOptions:
        """Options of the problem."""
        return self.problem.options_as(ImpulsiveInputOptions)

    @property
    def H(self) -> Matrix:
        """Directions of the impulses (n, q)."""
        H: Matrix = self.problem.require("jump.H")
        return H

    @cached_property
    def D(self) -> Matrix:
        """A - K C (n, n)."""
        plant = self.problem.plant
        return np.asarray(flow_error_matrix(plant.flow.A, self.K, plant.output.C))

    @cached_property
    def output_units(self) -> Matrix | None:
        """Units of several outputs (p,), None for one."""
        return output_units(self.problem.plant, self.K, self.H, self.window)

    def features(self, exponents: Matrix) -> FeatureWindow:
        """Return the features of a window with these exponents."""
        C, units = self.problem.plant.output.C, self.output_units
        C = C if units is None else C / units[:, None]
        return FeatureWindow(
            self.D, C, self.H, exponents=exponents, tau=self.window, margin=self.margin
        )

    def gains(self, exponents: Matrix, rule: str) -> IntegralGains:
        """Return the gains of a design with these exponents."""
        output, options = self.problem.plant.output, self.options
        corrects = options.state_correction
        return IntegralGains.from_plant(
            self.problem.plant,
            operator="integral",
            K=self.K,
            window=self.window,
            margin=self.margin,
            period=output.sample_spacing if output.measured == "periodic" else None,
            weighting=self.weighting,
            state_correction=self.weighting == "gls" if corrects is None else corrects,
            nonnegative=options.nonnegative,
            initial_std=options.initial_std,
            exponents=exponents,
            rule=rule,
            threshold=self._threshold(exponents),
            output_units=self.output_units,
        )

    def _threshold(self, exponents: Matrix) -> float | None:
        """Eta as given, or from the smallest weight; None where the rule is another."""
        if self.options.smallest_weight is None:
            return self.options.threshold
        return threshold_for(self.features(exponents), self.options.smallest_weight)
