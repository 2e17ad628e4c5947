"""Convex constraints on a gain K, as constraints on (P, Z = P K).

    norm       P >= s I, [[P, Z], [Z', s norm^2 I]] >= 0: K'K = Z'P^-2 Z <= Z'P^-1 Z / s <= norm^2
    structure  P block diagonal over the rows of K with equal patterns: then Z has the pattern of K
    regions    inequalities of `equations.regions`

All are sufficient, with one P for all of them; s is free, so that the unit of P does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.find.affine import Unknown
from lmi.find.constrained import Constraints, Expression, inequality_blocks
from lmi.solvers import Solvers
from lmi.time_budget import Remark
from obsdesign.equations import regions as formulas
from obsdesign.errors import InputError
from obsdesign.problem.gain_constraints import ConstrainedGains, Disc, GainConstraints
from obsdesign.synthesis.candidate import Candidate

# shares by which a constraint is narrowed for the solver, whose digits and rounding then fit in
_NORM_SHARE, _REGION_SHARE = 1e-6, 1e-6


@dataclass(frozen=True)
class GainVariables:
    """CVXPY expressions, the argument of `constraints` of `design` and `investigate`.

    In the coordinates and units of the problem file. P (n, n) > 0; for the flow PL = P L (n, p),
    and PM is None; at jumps PM = P M (n, p), and PL is None. P is known up to a factor only. Of
    kind `interval` P = S^-T X S^-1 with X diagonal: with S = I, a constraint on the entries of
    row i of a gain is one on those of P L against P[i, i].
    """

    P: Expression
    PL: Expression | None = None
    PM: Expression | None = None


UserConstraints = Callable[[GainVariables], Iterable[Expression]]


def inactive_constraints(
    entry: ConvexGain, K: Matrix, F: Matrix, where: str = ""
) -> tuple[Remark, ...]:
    """Remarks on the constraints that a gain meets which was chosen without them.

    K (n, p): that gain; F (n, n): the matrix of the error with it; where: of which design.
    """
    return tuple(
        Remark(
            f"{where}{name} restricts nothing by itself: the {entry.gain} chosen without "
            "constraints meets it"
        )
        for name, part in entry.stated.parts(entry.gain).items()
        if replace(entry, stated=part).is_met(K, F)
    )


def unmet_constraints(label: str, gain: str) -> Candidate:
    """A candidate without gains where none are known that meet a user's constraints."""
    text = f"{label}: no {gain} found for constraints; the condition is sufficient, not necessary"
    return Candidate(label, None, searched=True, remarks=(Remark(text),))


@contextmanager
def refused_constraints() -> Iterator[None]:
    """Raise InputError for a user's constraints that CVXPY cannot use."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"constraints: {error}.") from None


def convex_gains(options: ConstrainedGains, user: UserConstraints | None) -> dict[str, ConvexGain]:
    """The constraints on "L" and "M", of a problem and of a user."""
    return {name: ConvexGain(name, options.gain_constraints(name), user) for name in ("L", "M")}


@dataclass(frozen=True)
class ConvexGain:
    """Constraints on the gain "L" or "M": those of the problem and a user's constraints."""

    gain: str
    stated: GainConstraints
    user: UserConstraints | None = None

    def is_free(self) -> bool:
        """Is there no constraint, so that nothing takes more than the bare inequality?"""
        return self.stated == GainConstraints() and self.user is None

    @property
    def solvers(self) -> Solvers:
        """What a search for the gain calls."""
        return ("Clarabel",) if self.is_free() else ("CVXPY/Clarabel",)

    def text(self) -> str:
        """Names of what states the constraints."""
        own = [] if self.user is None else ["constraints"]
        return " and ".join([*self.stated.options(), *own])

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
        stated, result = self.stated, list[Array]()
        if stated.decay is not None:
            decay = stated.decay / pace * (1 + _REGION_SHARE)
            result.append(formulas.half_plane_inequality(PK, P, decay))
        if stated.sector is not None:
            half_angle = stated.sector * (1 - _REGION_SHARE)
            result.append(formulas.sector_inequality(PK, half_angle))
        if stated.disc is not None:
            centre, radius = stated.disc.centre / pace, stated.disc.radius / pace
            radius *= 1 - _REGION_SHARE
            result.append(formulas.disc_inequality(PK, P, centre, radius))
        return result

    def blocks(
        self, error: tuple[Array, Array], P: Expression, Z: Expression, pace: float = 1.0
    ) -> list[Expression]:
        """Constraints that P (X - K output) is in the regions, for diagonal P = diag(p), Z = P K.

        P: p (n,), Z (n, p): CVXPY expressions, in coordinates and units of `pace` in which the
        error's matrix is X - K output; error: (X, output).
        """
        import cvxpy as cp

        (X, output), (n, count) = error, Z.shape

        def inequality(p: Array, z: Array, k: int) -> Array:
            weight = np.diag(p[:, 0])
            return self.inequalities(weight @ X - z @ output, weight, pace)[k][None]

        zeros = np.zeros((n, n))
        unknowns = [Unknown(n, 1), Unknown(n, count)]
        holds = []
        for k in range(len(self.inequalities(zeros, zeros))):
            values = [cp.reshape(P, (n, 1), order="F"), Z]
            (block,) = inequality_blocks(unknowns, partial(inequality, k=k), values)
            holds.append(block >> 0)
        return holds

    def is_met(self, K: Array, F: Array) -> bool:
        """Do K (n, p) and the error's matrix F (n, n) meet what the problem states, in floats?"""
        stated = self.stated
        if stated.pattern is not None and np.any(K[np.array(stated.pattern) == 0]):
            return False
        if stated.norm is not None and float(np.linalg.norm(K, 2)) > stated.norm:
            return False
        if not stated.has_region():
            return True
        if not np.isfinite(F).all():
            return False
        values = np.linalg.eigvals(F)
        room = _REGION_SHARE * float(np.abs(F).max(initial=0.0))
        return (
            (stated.decay is None or bool(values.real.max() < -stated.decay - room))
            and (stated.disc is None or _is_inside(values, stated.disc))
            and (
                stated.sector is None
                or bool(np.abs(np.angle(-values)).max() < stated.sector * (1 - _REGION_SHARE))
            )
        )

    def rounded(self, K: Matrix) -> Matrix:
        """The gain with exact zeros where they are wanted, its norm below the largest one."""
        pattern, norm = self.stated.pattern, self.stated.norm
        exact = K + 0.0 if pattern is None else np.where(np.array(pattern) != 0, K, 0.0)
        if norm is None:
            return exact
        excess = float(np.linalg.norm(exact, 2)) / (norm * (1 - 1e-12))
        return exact / excess if excess > 1 else exact

    def _structure(self, P: Expression, Z: Expression) -> list[Expression]:
        import cvxpy as cp

        if self.stated.pattern is None:
            return []
        pattern = np.array(self.stated.pattern)
        apart = (pattern[:, None, :] != pattern[None, :, :]).any(axis=-1).astype(float)
        return [cp.multiply(1 - pattern, Z) == 0, cp.multiply(apart, P) == 0]

    def _norm(self, P: Expression, Z: Expression, sizes: Array, pace: float) -> list[Expression]:
        import cvxpy as cp

        if self.stated.norm is None:
            return []
        norm = self.stated.norm / pace * (1 - _NORM_SHARE)
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


def _is_inside(values: Array, disc: Disc) -> bool:
    return bool(np.abs(values - disc.centre).max() < disc.radius * (1 - _REGION_SHARE))
