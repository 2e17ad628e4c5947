"""What is to be proved, in exact numbers: M(theta)' P_target M(theta) < gamma^2 P_source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.balls import Exact, exact

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Condition:
    """M(theta) = left e^{F theta} right (left None: the identity) for all theta in [low, high].

    F (n, n), left (m, n), right (n, m'): exact; P_source (m', m'), P_target (m, m): symmetric
    floats, taken exactly; gamma: float. others: matrices for which the same is to be proved, each
    in place of P_source.
    """

    F: Exact
    right: Exact
    P_source: Matrix
    P_target: Matrix
    low: float
    high: float
    left: Exact | None = None
    gamma: float = 1.0
    others: tuple[Matrix, ...] = ()


def common(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float, form: str, gamma: float
) -> Condition | str:
    """The condition that one P is decreased, or the reason why P cannot even be tried.

    form "before_jump": M = e^{F theta} H, state before jumps; "after_jump": M = H e^{F theta}.
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    if form not in ("before_jump", "after_jump"):
        raise ValueError(f"form must be before_jump or after_jump; got {form!r}")
    flow, jump, P = exact(F), exact(H), np.asarray(P, dtype=np.float64)
    if P.shape != flow.shape or not np.isfinite(P).all() or not np.array_equal(P, P.T):
        return "P is not a finite symmetric matrix"
    ends = float(low), float(high)
    if form == "before_jump":
        return Condition(flow, jump, P, P, *ends, gamma=gamma)
    return Condition(flow, exact(np.eye(len(P))), P, P, *ends, left=jump, gamma=gamma)
