"""Point observers for linear systems with jumps: the formulas.

    xhat' = A xhat + L (y - C xhat) + B u + (b_lower + b_upper)/2              between jumps
    xhat+ = G xhat- + M (y- - C xhat-) + E w + (c_lower + c_upper)/2           at jumps

The error obeys e' = F e, e+ = H e- (`equations.estimation_error`); it is stable for every
sequence of dwell times in a range if one P > 0 gives H' e^{F' theta} P e^{F theta} H < P for all
theta in it.
Source: C. Briat, Convex conditions for robust stability analysis and stabilization of linear
aperiodic impulsive and sampled-data systems under dwell-time constraints, Automatica 49 (2013),
Theorem 3; applied to (A - L C, G - M C).

Notation
    P, Z        Lyapunov matrix (n x n) and P M (n x p): the inequality below is affine in them
    flows       e^{F theta} at k dwell times, (k, n, n)
    seen        what M is multiplied with: C, or C G for a measurement after the jump
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def objection(options: Any) -> str | None:
    """A request that would not be honoured in this version, or None; one sentence."""
    if options.get("schedule") not in (None, "auto", 0):
        return f"observer.schedule = {options['schedule']!r} is not available in this version."
    return None


def measured_at_jump(G: Array, C: Array, jump_measurement: str) -> Array:
    """The matrix X with H = G - M X."""
    return C @ G if jump_measurement == "after" else C


def post_jump_inequality(P: Array, Z: Array, G: Array, seen: Array, flows: Array) -> Array:
    """[[P, (P G - Z seen) e^{F theta}]', *], P] > 0, (k, 2n, 2n): the error after a jump shrinks.

    By Schur's complement it says ((G - M seen) e^{F theta})' P (G - M seen) e^{F theta} < P with
    M = P^-1 Z: the map from after one jump to after the next. Its products are those of the
    pre-jump map e^{F theta} H, so that one family is stable if and only if the other is.
    """
    moved = (P @ G - Z @ seen) @ flows
    same = np.broadcast_to(P, flows.shape)
    return np.block([[same, np.swapaxes(moved, -1, -2)], [moved, same]])
