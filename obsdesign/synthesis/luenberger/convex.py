"""Convex wishes about a gain K as constraints on (P, Z = P K), and the gain that comes out.

    norm       P >= s I, [[P, Z], [Z', s norm^2 I]] >= 0: K'K = Z'P^-2 Z <= Z'P^-1 Z / s <= norm^2
    structure  P block diagonal over the rows of K with equal patterns: then Z has the pattern of K
    regions    inequalities of `equations.luenberger.regions`

All are sufficient, with one P for all of them; s is free, so that the unit of P does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.find.constrained import Constraints, Expression
from lmi.solvers import Solvers
from obsdesign.equations.luenberger import regions as formulas
from obsdesign.problem.gain_wishes import GainWishes

# shares by which a wish is narrowed for the solver, whose digits and rounding then fit in
_NORM_SHARE, _REGION_SHARE = 1e-6, 1e-6


@dataclass(frozen=True)
class GainVariables:
    """CVXPY expressions of a user's constraints, in the units of the problem file.

    P (n, n) > 0. For the flow PL = P L (n, p), and PM is None; at jumps PM = P M, and PL is None.
    """

    P: Expression
    PL: Expression | None = None
    PM: Expression | None = None


UserConstraints = Callable[[GainVariables], Iterable[Expression]]


@dataclass(frozen=True)
class ConvexGain:
    """What is wanted of the gain "L" or "M": stated wishes and a user's constraints."""

    gain: str
    wishes: GainWishes
    user: UserConstraints | None = None

    def is_free(self) -> bool:
        """Is nothing wanted that takes more than the bare inequality?"""
        return self.wishes == GainWishes() and self.user is None

    @property
    def solvers(self) -> Solvers:
        """What a search for the gain calls."""
        return ("Clarabel",) if self.is_free() else ("CVXPY/Clarabel",)

    def text(self) -> str:
        """What states the wishes."""
        own = [] if self.user is None else ["constraints"]
        return " and ".join([*self.wishes.options(), *own])

    def constraints(self, sizes: Array, pace: float = 1.0) -> Constraints:
        """Constraints on (P, Z) in units, D = diag(sizes), (n,).

        P = D P_file D, Z = D Z_file / pace. ValueError for constraints of a user that are none.
        """

        def both(values: Sequence[Expression]) -> list[Expression]:
            P, Z = values
            own = self._by_user(P, Z, sizes, pace)
            return [*self._structure(P, Z), *self._norm(P, Z, sizes, pace), *own]

        return both

    def inequalities(self, PK: Array, P: Array, pace: float = 1.0) -> list[Array]:
        """Those of the regions, (m, m) each; PK: P times the error's matrix, in units of pace."""
        wishes, result = self.wishes, list[Array]()
        if wishes.decay is not None:
            decay = wishes.decay / pace * (1 + _REGION_SHARE)
            result.append(formulas.half_plane_inequality(PK, P, decay))
        if wishes.sector is not None:
            half_angle = wishes.sector * (1 - _REGION_SHARE)
            result.append(formulas.sector_inequality(PK, half_angle))
        if wishes.disc is not None:
            centre, radius = wishes.disc.centre / pace, wishes.disc.radius / pace
            radius *= 1 - _REGION_SHARE
            result.append(formulas.disc_inequality(PK, P, centre, radius))
        return result

    def rounded(self, K: Array) -> Array:
        """The gain with exact zeros where they are wanted, its norm below the largest one."""
        pattern, norm = self.wishes.pattern, self.wishes.norm
        exact = K if pattern is None else np.where(np.array(pattern) != 0, K, 0.0)
        if norm is None:
            return exact
        excess = float(np.linalg.norm(exact, 2)) / (norm * (1 - 1e-12))
        return exact / excess if excess > 1 else exact

    def _structure(self, P: Expression, Z: Expression) -> list[Expression]:
        import cvxpy as cp

        if self.wishes.pattern is None:
            return []
        pattern = np.array(self.wishes.pattern)
        apart = (pattern[:, None, :] != pattern[None, :, :]).any(axis=-1).astype(float)
        return [cp.multiply(1 - pattern, Z) == 0, cp.multiply(apart, P) == 0]

    def _norm(self, P: Expression, Z: Expression, sizes: Array, pace: float) -> list[Expression]:
        import cvxpy as cp

        if self.wishes.norm is None:
            return []
        norm = self.wishes.norm / pace * (1 - _NORM_SHARE)
        scale = cp.Variable(nonneg=True)  # s norm^2
        corner = scale * np.eye(Z.shape[1])
        return [
            P >> scale / norm**2 * np.diag(sizes**2),
            cp.bmat([[P, Z], [Z.T, corner]]) >> 0,
        ]

    def _by_user(self, P: Expression, Z: Expression, sizes: Array, pace: float) -> list[Expression]:
        import cvxpy as cp

        if self.user is None:
            return []
        rows = np.tile(sizes[:, None] / pace, Z.shape[1])
        variables = GainVariables(
            cp.multiply(1 / np.outer(sizes, sizes), P),
            **{f"P{self.gain}": cp.multiply(1 / rows, Z)},
        )
        given = self.user(variables)
        if not isinstance(given, list | tuple) or not all(
            isinstance(entry, cp.constraints.constraint.Constraint) for entry in given
        ):
            raise ValueError(
                f"a list of CVXPY constraints is required for {self.gain}; got {given!r}"
            )
        return list(given)
