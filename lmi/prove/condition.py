"""Condition to be proved, in exact numbers: M(theta)' P_target M(theta) < gamma^2 P_source."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact


@dataclass(frozen=True)
class Condition:
    """M(theta) = left e^{F theta} right (left None: the identity) for all theta in [low, high].

    F (n, n), left (m, n), right (n, m'): exact; P_source (m', m'), P_target (m, m): symmetric,
    floats, taken exactly, or exact; gamma: float. others: matrices for which the same is to be
    proved, each in place of P_source.
    """

    F: Exact
    right: Exact
    P_source: Matrix | Exact
    P_target: Matrix | Exact
    low: float
    high: float
    left: Exact | None = None
    gamma: float = 1.0
    others: tuple[Matrix | Exact, ...] = ()

    def balanced(self) -> Condition:
        """The same claim in the coordinates of the flow that balance it, exactly.

        Sources and targets of another size than the flow keep their own.
        """
        jump = self.right if self.left is None else self.right @ self.left
        if jump.shape != self.F.shape:  # other coordinates than the flow's do not bind it
            jump = 0 * self.F
        scaling = Scaling.from_pair(self.F, jump, self.high)
        if scaling.is_identity:
            return self
        n, right, left = len(self.F), scaling.rows(self.right), self.left
        sources, target = (self.P_source, *self.others), self.P_target
        if len(self.P_source) == n:
            right = scaling.columns(right)
            sources = tuple(scaling.form(exact(P)) for P in sources)
        if left is not None:
            left = scaling.columns(left)
            left = scaling.rows(left) if len(target) == n else left
        if len(target) == n:
            target = scaling.form(exact(target))
        return replace(
            self, F=scaling.map(self.F), right=right, left=left, P_source=sources[0],
            P_target=target, others=sources[1:],
        )  # fmt: skip


def common(
    F: ArrayLike, H: ArrayLike, P: ArrayLike, low: float, high: float, *, form: str, gamma: float
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
