"""A nominal plant with what drives the error of a point observer, in floats, for any gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, to_float
from obsdesign.analysis.luenberger.driven_error import Drive
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_disturbance_matrix,
    jump_error_matrix,
)
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.estimated_bounds import estimated_bounds, settled_bounds
from obsdesign.synthesis.state_box import KnownBox


class GainPair(NamedTuple):
    """L, M (n, p)."""

    L: Matrix
    M: Matrix


@dataclass(frozen=True)
class DrivenPlant:
    """The nominal plant, with columns of what acts on e whatever the gains are.

    E (n, k) of what acts on e', D (p, k) of the same on y; K (n, l), D_jump (p, l): likewise at
    jumps; V (p,): noise; ends: of dwell times; units (n,): in which bounds of e are added. K,
    D_jump and ends are None without jumps.
    """

    plant: Plant
    E: Matrix
    D: Matrix
    V: Matrix
    units: Matrix
    K: Matrix | None = None
    D_jump: Matrix | None = None
    ends: tuple[float, float] | None = None

    @staticmethod
    def from_box(
        uncertain: Plant, nominal: Plant, box: KnownBox, ends: tuple[float, float]
    ) -> DrivenPlant:
        """In units of the box; ends: the shortest and the longest dwell time, of jumps."""
        zero = np.zeros((nominal.n, nominal.p))
        gains = LuenbergerGains.from_plant(nominal, L=zero, M=zero)
        drive = Drive.from_plant(uncertain, gains, box.bounds)
        radius = nominal.output.noise_radius
        V = np.zeros(nominal.p) if radius is None else radius
        E, D = _acting(drive.flow, drive.output)
        driven = DrivenPlant(nominal, E, D, V, box.units)
        if drive.jump is None or drive.sampled is None:
            return driven
        K, D_jump = _acting(drive.jump, drive.sampled)
        return replace(driven, K=K, D_jump=D_jump, ends=ends)

    @property
    def outputs(self) -> Matrix:
        """Sizes of y, (p,), for x of these units."""
        sizes: Matrix = np.abs(self.plant.output.C) @ self.units
        return np.where(sizes > 0, sizes, 1.0)

    def with_noise(self, part: float) -> DrivenPlant:
        """The same with noise of at least this part of the sizes of y."""
        return replace(self, V=np.maximum(self.V, part * self.outputs))

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
        if H is None or self.K is None or self.D_jump is None or self.ends is None:
            return self.flow_cost(gains.L)
        E = self._driving(gains.L)
        C, when = self.plant.output.C, self.plant.output.jump_measurement
        through = jump_disturbance_matrix(gains.M, C, self.plant.n, when)
        K = np.hstack([through @ self.K - gains.M @ self.D_jump, gains.M * self.V])
        bounds = np.minimum(
            estimated_bounds((F, E), (H, K), self.ends),
            estimated_bounds((absolute_metzler(F), np.abs(E)), (np.abs(H), np.abs(K)), self.ends),
        )
        return float((bounds / self.units).sum())

    def flow_cost(self, L: Matrix) -> float:
        """The same without jumps."""
        F = flow_error_matrix(self.plant.flow.A, L, self.plant.output.C)
        return float((settled_bounds(F, self._driving(L)) / self.units).sum())

    def _driving(self, L: Matrix) -> Matrix:
        """Columns of what acts on e between jumps."""
        return np.hstack([self.E - L @ self.D, L * self.V])


def _acting(columns: Exact, on_output: Exact) -> tuple[Matrix, Matrix]:
    """The columns of which either part is not zero, in floats."""
    both = np.vstack([to_float(columns), to_float(on_output)])
    top, bottom = np.split(both[:, both.any(axis=0)], [len(columns)])
    return top, bottom
