"""A nominal plant with what drives the error of a point observer, in floats, for any gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import to_float
from obsdesign.analysis.luenberger.driven_error import driven_error
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_disturbance_matrix,
    jump_error_matrix,
)
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.parameters import largest_in_box
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.estimated_bounds import driven_bounds, settled_bounds
from obsdesign.synthesis.state_box import KnownBox


class GainPair(NamedTuple):
    """L, M (n, p)."""

    L: Matrix
    M: Matrix


@dataclass(frozen=True)
class DrivenPlant:
    """The nominal plant, columns E (n, k), K (n, l) of what acts on e whatever the gains are.

    V, V_jump (p,): noise of samples between jumps and at them, effects of parameters on y counted
    with their largest size; ends: of dwell times; units (n,): in which bounds of e are added. K,
    V_jump and ends are None without jumps.
    """

    plant: Plant
    E: Matrix
    V: Matrix
    units: Matrix
    K: Matrix | None = None
    V_jump: Matrix | None = None
    ends: tuple[float, float] | None = None

    @staticmethod
    def from_box(
        uncertain: Plant, nominal: Plant, box: KnownBox, ends: tuple[float, float]
    ) -> DrivenPlant:
        """In units of the box; ends: the shortest and the longest dwell time, of jumps."""
        n, p, bounds = nominal.n, nominal.p, box.bounds
        zero = np.zeros((n, p))
        gains = LuenbergerGains.from_plant(nominal, L=zero, M=zero)
        error = driven_error(uncertain, gains, bounds)
        radius = nominal.output.noise_radius
        noise = np.zeros(p) if radius is None else radius
        V = noise + _output_effects(uncertain, bounds.lower, bounds.upper)
        driven = DrivenPlant(nominal, to_float(error.E), V, box.units)
        if error.K is None:
            return driven
        sampled = (bounds.lower, bounds.upper)
        if nominal.output.jump_measurement == "before":
            sampled = (bounds.lower_before_jump, bounds.upper_before_jump)
        at_jumps = noise + _output_effects(uncertain, *sampled)
        return replace(driven, K=to_float(error.K), V_jump=at_jumps, ends=ends)

    @property
    def outputs(self) -> Matrix:
        """Sizes of y, (p,), for x of these units."""
        sizes: Matrix = np.abs(self.plant.output.C) @ self.units
        return np.where(sizes > 0, sizes, 1.0)

    def with_noise(self, part: float) -> DrivenPlant:
        """The same with noise of at least this part of the sizes of y."""
        least = part * self.outputs
        jump = None if self.V_jump is None else np.maximum(self.V_jump, least)
        return replace(self, V=np.maximum(self.V, least), V_jump=jump)

    def matrices(self, gains: GainPair) -> tuple[Matrix, Matrix | None]:
        """F = A - L C, and the error's matrix at jumps."""
        C, jump = self.plant.output.C, self.plant.jump
        F = flow_error_matrix(self.plant.flow.A, gains.L, C)
        if jump is None:
            return F, None
        return F, jump_error_matrix(jump.G, gains.M, C, self.plant.output.jump_measurement)

    def cost(self, gains: GainPair) -> float:
        """Sum of the bounds of e in these units, an estimate; infinite where e does not decay.

        With jumps the smaller bounds of the error itself and of the comparison of its moduli.
        """
        F, H = self.matrices(gains)
        if H is None or self.K is None or self.V_jump is None or self.ends is None:
            return self.flow_cost(gains.L)
        E = np.hstack([self.E, gains.L * self.V])
        C, when = self.plant.output.C, self.plant.output.jump_measurement
        through = jump_disturbance_matrix(gains.M, C, self.plant.n, when)
        K = np.hstack([through @ self.K, gains.M * self.V_jump])
        bounds = np.minimum(
            driven_bounds((F, E), (H, K), self.ends),
            driven_bounds((absolute_metzler(F), np.abs(E)), (np.abs(H), np.abs(K)), self.ends),
        )
        return float((bounds / self.units).sum())

    def flow_cost(self, L: Matrix) -> float:
        """The same without jumps."""
        F = flow_error_matrix(self.plant.flow.A, L, self.plant.output.C)
        E = np.hstack([self.E, L * self.V])
        return float((settled_bounds(F, E) / self.units).sum())


def _output_effects(uncertain: Plant, lower: Matrix, upper: Matrix) -> Matrix:
    """Largest effect of parameters on y in a box of x, (p,)."""
    total = np.zeros(uncertain.p)
    for parameter in uncertain.parameters:
        low, high = parameter.range
        X = parameter.effects.get("C")
        if X is not None:
            total += (high - low) / 2 * largest_in_box(X, lower, upper)
    return total
