"""Condition to be proved, in exact numbers: M(theta)' P_target M(theta) < gamma^2 P_source."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
