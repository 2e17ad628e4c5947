"""The conditions of Theorem 2.2 for the error of an impulsive observer, with constants.

P(t) = M_alpha(rho_l(t), t) for the state equation (14), from which the error comes by Lemma 3.2.
For t in [tau_k, tau_(k+1)), with s the time from rho_l(t) to the first impulse of the window and
O_i the rows C X_i of the window matrix, oldest first, i = 0 .. l - 1,

    P(t) = e^{A' s} (sum_i alpha^(2 i) O_i' O_i) e^{A s},    0 <= s <= longest spacing

    (6)  eta I <= P(t) <= rho I,  eta = (sigma_min(O) / sup |e^{-A s}|)^2,
         rho = sum_i (alpha^i sup |O_i|)^2 sup |e^{A s}|^2
    (7)  equality, Q_C = 0, by the definition of P
    (8)  Q_I = (1 - alpha^-2) P(tau_k^-), since the gain is (12)

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems, Theorem 2.2
and the proof of Theorem 3.1. Norms in balls; sigma_min from the proof of full rank.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR
from typing import ClassVar

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.arithmetic.balls import number
from lmi.arithmetic.norms import float_above, float_below
from lmi.bounds.largest_norm import identity_like, norm_of, norm_over
from obsdesign.equations.impulsive.formulas import Core
from obsdesign.verification.rates import six_digits


@dataclass(frozen=True)
class LyapunovFunction:
    """eta and rho of (6) for P(t) = M_alpha(rho_l(t), t); (7) and (8) as the module states them."""

    eta: float
    rho: float
    # entry of the evidence of the claim `rate`
    ENTRY: ClassVar[str] = "theorem_2_2"
    _P: ClassVar[str] = "M_alpha(rho_l(t), t)"
    _Q_C: ClassVar[str] = "0"
    _Q_I: ClassVar[str] = "(1 - alpha^-2) P(tau_k^-)"

    @classmethod
    def from_evidence(cls, evidence: Entries) -> LyapunovFunction | None:
        """From the evidence of a claim `rate`; None where it has no numbers."""
        entry = evidence.get(cls.ENTRY)
        if not isinstance(entry, Mapping):
            return None
        eta, rho = entry.get("eta"), entry.get("rho")
        return cls(eta, rho) if isinstance(eta, float) and isinstance(rho, float) else None

    def to_evidence(self) -> NewEntries:
        """As it stands in the evidence of a claim."""
        return asdict(self) | {"P": self._P, "Q_C": self._Q_C, "Q_I": self._Q_I}

    def follows_from(self, narrower: LyapunovFunction) -> bool:
        """Whether (6) with the other's constants shows it with these."""
        return 0 < self.eta <= narrower.eta and narrower.rho <= self.rho < math.inf

    @property
    def sentence(self) -> str:
        """The conditions in words."""
        return (
            f"Theorem 2.2 holds with P(t) = {self._P}: (6) with eta = "
            f"{six_digits(self.eta, ROUND_FLOOR)} and rho = {six_digits(self.rho, ROUND_CEILING)}, "
            f"(7) with Q_C = {self._Q_C}, (8) with Q_I = {self._Q_I}."
        )


def lyapunov_function(
    core: Core, ends: tuple[float, float], window: int, alpha: float, sigma_min: float
) -> LyapunovFunction | None:
    """The constants of (6) for a window that starts before an impulse; None for another one.

    core: exact; sigma_min: proved for the window matrix without weights. None beyond floats.
    """
    if core.U is not None or not sigma_min > 0:
        return None
    (low, high), unit = ends, identity_like(core.A)
    flow, back = (norm_over(unit, X, unit, 0.0, high) for X in (core.A, -core.A))
    move, output = norm_over(unit, core.A, core.J, low, high), norm_of(core.C)
    total, size = output**2, norm_over(core.C, core.A, core.J, low, high)
    for age in range(1, window):
        total = total + (number(alpha) ** age * size) ** 2
        size = size * move
    eta, rho = float_below((number(sigma_min) / back) ** 2), float_above(total * flow**2)
    return LyapunovFunction(eta, rho) if 0 < eta <= rho < math.inf else None
