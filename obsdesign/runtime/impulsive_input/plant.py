"""The plant between two impulses, known inputs held from row to row."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.gains import ImpulsiveInputGains
from obsdesign.runtime.flow_cells import FlowCells
from obsdesign.runtime.step_cache import cached_step

Maps = tuple[Matrix, Matrix, Matrix]


@dataclass(frozen=True, kw_only=True)
class HeldPlant:
    """x' = A x + B u + b_mid, y = C x; steps of equal length share their matrices.

    A (n, n), B (n, m), C (p, n), H (n, q); drift (n,): b_mid.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    H: Matrix
    drift: Matrix
    _steps: OrderedDict[float, Maps] = field(default_factory=OrderedDict, repr=False, compare=False)

    @classmethod
    def from_gains(cls, gains: ImpulsiveInputGains) -> Self:
        """The plant that a design stores."""
        return cls(A=gains.A, B=gains.input_matrix, C=gains.C, H=gains.H, drift=gains.flow_drift)

    def forcing(self, u: Matrix) -> Matrix:
        """B u + b_mid for inputs u (..., m)."""
        return u @ self.B.T + self.drift

    def step(self, h: float) -> Maps:
        """(e^{A h}, its integral over h, its response to a unit ramp)."""
        return cached_step(self._steps, h, self._maps)

    def _maps(self, h: float) -> Maps:
        flow, once, slope = np.hsplit(self._cells.at(h), 3)
        return flow, once, slope / h

    @cached_property
    def _cells(self) -> FlowCells:
        """Responses to a state, an input and its slope."""
        unit, zero = np.eye(len(self.A)), np.zeros_like(self.A)
        return FlowCells(
            np.block([[self.A, unit, zero], [zero, zero, unit], [zero, zero, zero]]), len(self.A)
        )

    def free(self, t: float, x: Matrix, forcing: Matrix, until: float) -> Matrix:
        """The state at `until` from x at t, the forcing held, no impulse."""
        if until <= t:
            return x
        flow, once, _ = self.step(until - t)
        propagated: Matrix = flow @ x + once @ forcing
        return propagated
