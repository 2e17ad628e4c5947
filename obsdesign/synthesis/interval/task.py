"""Synthesis of gains in given coordinates: the open gains, and the width as their function.

In z, x = S z, y in units `rows` and time in units 1 / `pace`, the width system of gains (L, M) is

    W = Mz(A - L C),  N = |G - M C_J|,  f = f0 + 2 |L| V,  h = h0 + 2 |M| V

with every matrix in them; C_J maps the state before a jump to the measurement at the jump. A gain
that is given is part of A and f0 (of G and h0), and nothing is open there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.time_budget import TimeBudget
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.analysis.interval.requirements import objective_of
from obsdesign.equations.estimation_error import idle_gains, seen_before_jump
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.problem.options import IntervalOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.convex_gain import ConvexGain, UserConstraints, convex_gains
from obsdesign.synthesis.interval.units import (
    balanced_units,
    gain_caps,
    given_limit,
    pace_of_search,
)

# negative entries below this share of the largest are rounding of a zero that was intended
ROUNDING = 1e-12


@dataclass(frozen=True)
class Task:
    """What is searched for in which units: everything in z and its time.

    open_L, open_M: is the gain free; limits: (n, p), may be inf. positive: form
    `cooperative`, A - L C Metzler and G - M C_J >= 0; weights (n,): of the width; pre_jump: of the
    width just before jumps, instead of its time average. low, high: dwell times (inf, inf without
    jumps). S: (n, n), rows: (p,), pace: units of time to one of the plant's; L0, M0: given gains,
    in z; gain_limit: largest entry of a gain in the plant's coordinates, may be inf. constraints:
    on "L" and "M" in the plant's coordinates and time, those of gains that are open.
    """

    A: Matrix
    G: Matrix | None
    C: Matrix
    C_jump: Matrix
    f0: Matrix
    h0: Matrix
    V: Matrix
    low: float
    high: float
    open_L: bool
    open_M: bool
    limit_L: Matrix
    limit_M: Matrix
    positive: bool
    weights: Matrix
    pre_jump: bool
    S: Matrix
    rows: Matrix
    pace: float
    gain_limit: float
    L0: Matrix
    M0: Matrix
    constraints: Mapping[str, ConvexGain]

    @classmethod
    def from_problem(
        cls,
        problem: Problem,
        positive: bool,
        S: Matrix | None,
        given: Mapping[str, Array],
        user: UserConstraints | None = None,
        *,
        units: BalancedPlant | None = None,
    ) -> Task:
        """The task in coordinates S (None: the plant's own, in balanced units), in balanced time.

        given: L, M as far as fixed; user: constraints beside those of the problem; units:
        `balanced_units` of the problem where they are known.
        """
        plant = problem.plant
        n, p = plant.n, plant.p
        units = balanced_units(problem) if units is None else units
        basis = np.diag(units.sizes) if S is None else S
        inward: Matrix = np.asarray(np.linalg.inv(basis))
        C, V = plant.output.C, problem.require_noise_bound()
        L, M = (np.asarray(given.get(name, np.zeros((n, p)))) for name in ("L", "M"))
        low, high = (math.inf, math.inf) if plant.jump is None else problem.require_dwell_time()
        G, C_jump, h0 = _jump_error(plant, M, basis, inward, V)
        f0 = plant.flow.disturbance_width(inward) + 2 * np.abs(inward @ L) @ V
        pace = pace_of_search(problem, units)
        limit_L, limit_M = gain_caps(problem, S, units, pace)
        constraints = _open_gains(problem, given, user)
        return cls(
            A=inward @ (plant.flow.A - L @ C) @ basis / pace, G=G,
            C=C @ basis / units.rows[:, None],
            C_jump=C_jump @ basis / units.rows[:, None],
            f0=f0 / pace, h0=h0, V=V / units.rows, low=low * pace, high=high * pace,
            open_L="L" in constraints, open_M="M" in constraints, constraints=constraints,
            limit_L=limit_L, limit_M=limit_M, positive=positive,
            weights=width_weights(problem) @ np.abs(basis),
            pre_jump=problem.options_as(IntervalOptions).width == "pre_jump",
            S=basis, rows=units.rows, pace=pace, gain_limit=given_limit(problem),
            L0=inward @ L * units.rows / pace, M0=inward @ M * units.rows,
        )  # fmt: skip

    def with_equal_weights(self) -> Task:
        """The same for the time average of all widths alike; itself, if it is that."""
        weights = np.abs(self.S).sum(axis=0)
        if not self.pre_jump and np.allclose(weights, self.weights, rtol=1e-12, atol=0.0):
            return self
        return replace(self, weights=weights, pre_jump=False)

    @cached_property
    def is_constrained(self) -> bool:
        """Is there a constraint on an open gain?"""
        return any(not entry.is_free() for entry in self.constraints.values())

    @property
    def is_constrained_by_user(self) -> bool:
        """Is there one that only the program can meet?"""
        return any(entry.user is not None for entry in self.constraints.values())

    def gains(self, L: Matrix, M: Matrix) -> tuple[Matrix, Matrix]:
        """(L, M) in the plant's coordinates and time, for L, M in z.

        With the zeros and the norm of their constraints.
        """
        outward = self._outward(self.L0 + L, self.M0 + M)
        # the last digit is of the change of units: a gain that cancels an entry cancels it again
        L, M = (np.reshape([float(f"{x:.15g}") for x in K.flat], K.shape) for K in outward)
        return self._rounded("L", L), self._rounded("M", M)

    def _outward(self, L: Matrix, M: Matrix) -> tuple[Matrix, Matrix]:
        return self.S @ (L * self.pace) / self.rows, self.S @ M / self.rows

    def _rounded(self, name: str, K: Matrix) -> Matrix:
        entry, whole = self.constraints.get(name), at_most(self.gain_limit, K)
        return whole if entry is None else entry.rounded(whole)

    def within(self, L: Matrix, M: Matrix) -> tuple[Matrix, Matrix]:
        """The gains clipped to the limits and to structure and norm, in z."""
        L, M = np.clip(L, -self.limit_L, self.limit_L), np.clip(M, -self.limit_M, self.limit_M)
        if not self.is_constrained:
            return L, M
        return self.inward(*self.gains(L, M))

    def inward(self, L: Matrix, M: Matrix) -> tuple[Matrix, Matrix]:
        """Open gains in z, for (L, M) in the plant's coordinates and time; zero if not open."""
        in_z = [np.linalg.solve(self.S, K * self.rows) for K in (L / self.pace, M)]
        return np.where(self.open_L, in_z[0], 0.0), np.where(self.open_M, in_z[1], 0.0)

    def system(self, L: Matrix, M: Matrix) -> WidthSystem:
        """The width system of gains in z."""
        W = absolute_metzler(self.A - L @ self.C)
        N = None if self.G is None else np.abs(self.G - M @ self.C_jump)
        f, h = self.f0 + 2 * np.abs(L) @ self.V, self.h0 + 2 * np.abs(M) @ self.V
        h_jump = None if N is None else h
        return WidthSystem(W=W, f=f, N=N, h=h_jump, K=None, k=None, out=np.abs(self.S))

    def is_admissible(self, L: Matrix, M: Matrix) -> bool:
        """Do the gains keep limits, constraints and, in form `cooperative`, the signs?"""
        if self.is_constrained and not all(
            entry.is_met(entry.rounded(gain), error)
            for entry, gain, error in self.constrained(L, M)
        ):
            return False
        if np.any(np.abs(L) > self.limit_L * (1 + ROUNDING)):
            return False
        if np.any(np.abs(M) > self.limit_M * (1 + ROUNDING)):
            return False
        if not self.positive:
            return True
        F = self.A - L @ self.C
        off = F[~np.eye(len(F), dtype=bool)]
        if off.size and off.min() < -ROUNDING * np.abs(F).max():
            return False
        if self.G is None:
            return True
        H = self.G - M @ self.C_jump
        return bool(H.min() >= -ROUNDING * np.abs(self.G).max())

    def constrained(self, L: Matrix, M: Matrix) -> Iterator[tuple[ConvexGain, Matrix, Matrix]]:
        """Yield the constraints on each open gain, the gain, and the error's matrix with it.

        The gain in the plant's coordinates, without the rounding of `gains`; both in its time.
        """
        flow_gain, jump_gain = self._outward(L, M)
        for name, entry in self.constraints.items():
            if name == "L":
                yield entry, flow_gain, (self.A - L @ self.C) * self.pace
            elif self.G is not None:
                yield entry, jump_gain, self.G - M @ self.C_jump


@dataclass(frozen=True)
class GainSearch:
    """A problem, the gains that it gives, the budget, and a user's constraints on the others."""

    problem: Problem
    given: Mapping[str, Array]
    budget: TimeBudget
    user: UserConstraints | None = None

    @property
    def objective(self) -> str:
        """What open gains are chosen for."""
        return objective_of(self.problem)

    def task(self, positive: bool, S: Matrix | None) -> Task:
        """The task in coordinates S (None: the plant's own)."""
        return Task.from_problem(
            self.problem, positive, S, self.given, self.user, units=self.units
        )  # fmt: skip

    @cached_property
    def units(self) -> BalancedPlant:
        """`balanced_units` of the problem, which take longer than the rest of a task."""
        return balanced_units(self.problem)


def _open_gains(
    problem: Problem, given: Mapping[str, Array], user: UserConstraints | None
) -> dict[str, ConvexGain]:
    """Gains that are chosen, neither given nor without effect, with the constraints on them."""
    idle = idle_gains(problem.plant)
    constraints = convex_gains(problem.options_as(IntervalOptions), user)
    kept = {*given, *idle}
    return {name: own for name, own in constraints.items() if name not in kept}


def width_weights(problem: Problem) -> Matrix:
    """Weights (n,) of the widths of the states, one on average."""
    n = problem.plant.n
    stated = problem.options_as(IntervalOptions).width_weights
    given = np.ones(n) if stated is None else np.array(stated)
    weights: Matrix = given / given.max()
    return weights * (n / float(weights.sum()))


def at_most(limit: float, K: Matrix) -> Matrix:
    """A gain without what rounding alone took beyond the limit."""
    return np.where(np.abs(K) <= limit * (1 + ROUNDING), np.clip(K, -limit, limit), K)


def _jump_error(
    plant: Plant, M: Matrix, basis: Matrix, inward: Matrix, V: Matrix
) -> tuple[Matrix | None, Matrix, Matrix]:
    """(S^-1 (G - M C_jump) S, C_jump, width that jumps add); without jumps (None, C, 0).

    basis: S; inward: its inverse; V: radius of the noise.
    """
    C = plant.output.C
    if plant.jump is None:
        return None, C, np.zeros(plant.n)
    C_jump = seen_before_jump(plant.jump.G, C, plant.output.jump_measurement)
    added = plant.jump.disturbance_width(inward) + 2 * np.abs(inward @ M) @ V
    return inward @ (plant.jump.G - M @ C_jump) @ basis, C_jump, added
