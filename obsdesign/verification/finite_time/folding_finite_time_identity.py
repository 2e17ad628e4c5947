"""The error of observer (14), exactly, and the factor on max |x| that bounds it for any period.

xhat(t_i) - x(t_i) = M_T^{-1} int e^{F (t_i - T - m)} mu(m) x(m) dm
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lmi.arithmetic.balls import entries, exact, identity, rational, scalar
from lmi.arithmetic.norms import spectral_norm
from lmi.verdict import proved
from obsdesign.analysis.finite_time.enclosed_gains import Sampled, exponential
from obsdesign.document import Claim

PAPER = "Mazenc, Ahmed, MICNON 2018"
# pieces of the error integral: their number decides how far the bound is above the factor
_PIECES, _FEWEST = 1920, 2


def identity_claim(factor: float) -> Claim:
    """A bound without (13), for a finite factor."""
    verdict = proved(factor=factor)
    return Claim(
        "error_identity",
        "|xhat - x| <= factor times the largest |x| in the window, without disturbance and noise; "
        "for any period",
        f"{PAPER}, (14): exact error, docs/finite_time.md",
        verdict.outcome,
        verdict.evidence,
    )


def error_factor(sampled: Sampled, L: Any, inverse: Any) -> Any:
    """Ball above int_0^T |M_T^{-1} e^{-F tau} mu(tau)| dtau, spectral norm.

    Over a piece of length h the integrand is below the straight line between its end values plus
    h^2/8 max |f''|, so that the integral is below h (|f_0| + |f_1|)/2 + h^3/12 max |f''|.
    """
    LC, n = exact(L) @ sampled.C, len(sampled.A)
    F = sampled.A + LC
    m = max(_FEWEST, _PIECES // sampled.k)
    part, unit = rational(1.0) / m, entries(identity(n))
    step_F = exponential(-F * part, sampled.period)
    step_A = exponential(-sampled.A * part, sampled.period)
    h = scalar(rational(sampled.period) * part)
    seen = [0 * unit]  # L C (e^{-A s} - I) at the ends of the pieces of one period
    moved = unit
    for _ in range(m):
        moved = moved @ step_A
        seen.append(LC @ (moved - unit))
    f, a, c = (_frobenius(X) for X in (F, sampled.A, LC))
    grown = np.exp(a * scalar(rational(sampled.period)))
    bend = np.exp(f * h) * c * ((f * f + 2 * f * a + a * a) * grown)
    total, weight = scalar(0), inverse
    for _ in range(sampled.k):
        start = scalar(0)
        for j in range(m):
            curved = _frobenius(weight) * bend
            weight = weight @ step_F
            end = spectral_norm(weight @ seen[j + 1])
            total = total + h * (start + end) / 2 + h * h * h * curved / 12
            start = end
    return total


def _frobenius(X: Any) -> Any:
    return scalar(sum(x * x for x in X.flat)).sqrt()
