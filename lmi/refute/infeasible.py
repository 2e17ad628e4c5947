"""No common P exists for these dwell times: a dual certificate, checked in balls.

Matrices Z_i >= 0 with sum (Z_i - M_i Z_i M_i') < 0 rule out every P > 0 with P - M_i' P M_i >= 0
for all i, since sum tr Z_i (P - M_i' P M_i) = tr P sum (Z_i - M_i Z_i M_i') < 0. This says nothing
about stability: a system may well be stable without a common P.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import (
    PRECISIONS,
    Exact,
    ball,
    certify_positive_definite,
    exact,
    exp_times,
    precision,
)
from lmi.verdict import Verdict, proved, undecided


def prove_no_common(
    F: ArrayLike, H: ArrayLike, thetas: Sequence[float], multipliers: ArrayLike
) -> Verdict:
    """Proved: no P > 0 has M(theta)' P M(theta) <= P at these theta, M = e^{F theta} H.

    F, H (n, n) floats or exact rationals; multipliers (k, n, n) floats, one for each theta.
    """
    flow, jump = exact(F), exact(H)
    Z = np.asarray(multipliers, dtype=np.float64)
    if Z.shape != (len(thetas), *flow.shape) or not np.isfinite(Z).all() or not len(Z):
        return undecided("one finite n x n multiplier is needed for each theta")
    if not np.array_equal(Z, np.swapaxes(Z, 1, 2)):
        return undecided("the multipliers are not symmetric")
    scaling = Scaling.from_pair(flow, jump, max(thetas))
    flow, jump = scaling.map(flow), scaling.map(jump)
    weights = [scaling.dual(exact(X)) for X in Z]
    for bits in PRECISIONS:
        with precision(bits):
            if _certified(flow, jump, thetas, weights):
                return proved(thetas=list(thetas), multipliers=Z.tolist(), bits=bits)
    return undecided("the multipliers prove nothing")


def _certified(flow: Exact, jump: Exact, thetas: Sequence[float], Z: list[Exact]) -> bool:
    total = ball(0 * Z[0])
    for theta, weight in zip(thetas, Z, strict=True):
        weighted = ball(weight)
        if not certify_positive_definite(weighted):
            return False
        M = exp_times(flow, theta) * ball(jump)
        total = total + M * weighted * M.transpose() - weighted
    return certify_positive_definite(total)
