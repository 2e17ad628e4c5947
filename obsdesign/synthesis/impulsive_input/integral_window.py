"""Operator `integral` with open exponents: gain, window and margin, chosen or given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.problem.plant import Plant

Matrix = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class IntegralWindow:
    """Every gain of operator `integral` but the exponents and the rule that follows from them.

    H (n, q), K (n, p); initial_std (n,) or None; threshold: of |R|, None where no rule was chosen
    by the problem; shortest_dwell: of the plant.
    """

    plant: Plant
    H: Matrix
    K: Matrix
    window: float
    margin: float
    shortest_dwell: float
    weighting: str
    state_correction: bool
    nonnegative: bool
    initial_std: Matrix | None
    threshold: float | None

    @property
    def C(self) -> Matrix:
        """Output matrix (p, n)."""
        return self.plant.output.C

    @property
    def D(self) -> Matrix:
        """A - K C (n, n)."""
        return np.asarray(flow_error_matrix(self.plant.flow.A, self.K, self.C))

    def features(self, exponents: Matrix) -> FeatureWindow:
        """Return the features of a window with these exponents."""
        return FeatureWindow(self.D, self.C, self.H, exponents, self.window, self.margin)

    def gains(self, exponents: Matrix, rule: str) -> IntegralGains:
        """Return the gains of a design with these exponents."""
        output = self.plant.output
        return IntegralGains.from_plant(
            self.plant,
            H=self.H,
            window=self.window,
            margin=self.margin,
            noise_std=output.noise_std,
            noise_cv=output.noise_cv,
            nonnegative=self.nonnegative,
            initial_std=self.initial_std,
            period=float(output.period or 0.0) if output.measured == "periodic" else None,
            threshold=self.threshold,
            K=self.K,
            weighting=self.weighting,
            operator="integral",
            state_correction=self.state_correction,
            exponents=exponents,
            rule=rule,
        )
