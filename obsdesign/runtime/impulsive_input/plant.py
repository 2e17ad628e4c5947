"""The plant between two impulses, known inputs held from row to row."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Self

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.gains import ImpulsiveInputGains
from obsdesign.runtime.flow_response import Maps, responses
from obsdesign.runtime.step_cache import cached_step


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
        return cached_step(self._steps, h, lambda h: responses(self.A, h))

    def free(self, t: float, x: Matrix, forcing: Matrix, until: float) -> Matrix:
        """The state at `until` from x at t, the forcing held, no impulse."""
        if until <= t:
            return x
        flow, once, _ = self.step(until - t)
        propagated: Matrix = flow @ x + once @ forcing
        return propagated
