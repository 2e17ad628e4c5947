"""Bounds for plants with parameters: effects as large as the box of each stage allows.

    x' = A x + B u + b + sum p_i (A_i x + B_i u),  |p_i| <= 1, free to change at any time

Each effect acts along known columns (`equations.set_membership.effects`), as a disturbance w with
|w| <= |row (x, u)|. Over a step of length h from a box around m with radii r,

    |x| <= X = e^{M h} (|x(0)| + h f),   M = max(Mz(A), 0) + sum |A_i|,  f = |B| u + sum |B_i| u + b
    |row (x, u)| <= |row (m, u)| + |row| r + h (|row A| X + sum |row A_i| X + |row| f)

and at a jump the box before it bounds the rows. What parameters add to y widens the strip of a
sample by sum |C_i x| over the box of its time. Where x is known to stay in a box, stated or proved,
so are these, from when on it counts (`runtime.state_box`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, expm, raised
from obsdesign.equations.set_membership.effects import Factors
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.set_membership.model import Disturbance, Model
from obsdesign.runtime.set_membership.stages import Stage, magnitude
from obsdesign.runtime.set_membership.tape import Tape


@dataclass(frozen=True)
class Rows:
    """Rows of effects on a flow or a jump, in balanced units.

    of_state (r, n), of_inputs (r, k); factors: their columns; most: bounds (columns,) that the
    stated box gives, infinite without one; places: of the columns among active ones of the
    disturbance, -1 where inactive.
    """

    of_state: Matrix
    of_inputs: Matrix
    factors: Factors
    most: Matrix
    places: list[int]

    @staticmethod
    def from_factors(
        factors: Factors, bounds: Matrix | float, scales: Matrix, disturbance: Disturbance
    ) -> Rows:
        """The rows of effects whose columns are the last ones of a disturbance."""
        n, count = len(scales), factors.columns.shape[1]
        first = len(disturbance.lower) - count
        active = disturbance.active.tolist()
        places = [active.index(first + k) if first + k in active else -1 for k in range(count)]
        most = np.broadcast_to(bounds, count)
        rows = factors.rows
        return Rows(rows[:, :n] / scales, rows[:, n:], factors, most, places)

    def at(self, box: Matrix, inputs: Matrix, more: Matrix | float = 0.0) -> Matrix:
        """Bounds (r,) of |row (x, u)| for x in a box (2, n) and `more` (r,) beside."""
        centre, radius = midpoint(box[0], box[1])
        middle = self.of_state @ centre + self.of_inputs @ inputs
        size = np.abs(self.of_state) @ np.abs(centre) + np.abs(self.of_inputs) @ np.abs(inputs)
        terms = len(centre) + len(inputs) + 4
        total = np.abs(middle) + np.abs(self.of_state) @ radius + more
        return np.asarray(raised(total + terms * UNIT * size, 2 * terms))

    def radii(self, stage: Stage, sizes: Matrix) -> Stage:
        """The stage with radii of the columns of effects, from bounds of their rows."""
        bounds = np.fmin(self.factors.bounds(sizes), self.most)
        radius = stage.radius.copy()
        for place, bound in zip(self.places, bounds.tolist(), strict=True):
            if place >= 0:
                radius[place] = bound
        return stage._replace(radius=radius)


@dataclass(frozen=True)
class EffectBounds:
    """Bounds of effects along the stages of a design.

    counts_box: are they those in the stated box too, if there is one?
    """

    gains: SetMembershipGains
    model: Model
    counts_box: bool = True

    def driven(self, stage: Stage, box: Matrix) -> Stage:
        """The stage with bounds of its effects, from the box before it."""
        if stage.jump:
            rows = self._jump
            inputs = stage.known[: rows.of_inputs.shape[1]]
            return rows.radii(stage, rows.at(box, inputs))
        rows, inputs = self._flow, stage.known[: self.gains.m]
        h = math.nextafter(stage.h + 4 * math.ulp(stage.size), math.inf) if stage.h > 0 else 0.0
        force = self._force(stage, inputs)
        X = raised(self._growth(h) @ raised(magnitude(box) + h * force, 4), 2 * self.model.n)
        size = np.abs(rows.of_state)
        change = h * raised(self._rates @ X + size @ force, 4 * self.model.n)
        near = rows.at(box, inputs, change)
        far = raised(size @ X + np.abs(rows.of_inputs) @ np.abs(inputs), 4 * self.model.n)
        return rows.radii(stage, np.fmin(near, far))

    def widened(self, tape: Tape) -> Tape:
        """The tape with the strip of its last stage wider by what parameters add to y."""
        stage = tape.stages[-1]
        if stage.strip is None:
            return tape
        centre, radius = midpoint(tape.box[0], tape.box[1])
        added = np.zeros(len(self.model.C))
        for C in self._outputs:
            size = np.abs(C) @ (radius + (len(centre) + 4) * UNIT * np.abs(centre))
            added = added + np.abs(C @ centre) + size
        most = self._most(self.gains.output_effect)
        added = np.fmin(raised(added, 4 * len(centre) + 2 * len(self._outputs)), most)
        strip = np.stack([
            np.nextafter(stage.strip[0] - added, -np.inf),
            np.nextafter(stage.strip[1] + added, np.inf),
        ])  # fmt: skip
        strip = np.where(added > 0, strip, stage.strip)
        stages = (*tape.stages[:-1], stage._replace(strip=strip))
        return tape._replace(stages=stages)

    def _most(self, in_box: Matrix | None) -> Matrix | float:
        """Bounds of effects in the stated box, infinite where it does not count."""
        return np.inf if in_box is None or not self.counts_box else in_box

    def _force(self, stage: Stage, inputs: Matrix) -> Matrix:
        """Bound (n,) of |B u + b| and of what parameters add to B u."""
        flow, n = self.model.flow, self.model.n
        own = len(flow.lower) - self._flow.factors.columns.shape[1]
        size = np.abs(stage.known[self.gains.m :])
        size[flow.active] += stage.radius[: len(flow.active)]
        force = np.abs(flow.matrix[:, :own]) @ size[:own]
        of_inputs = np.abs(self.model.inputs) + self._added_inputs
        return np.asarray(raised(force + of_inputs @ np.abs(inputs), 2 * (n + len(size)) + 8))

    def _growth(self, h: float) -> Matrix:
        """Upper bound of e^{M h}; kept for the last few lengths."""
        if h not in self._growths:
            if len(self._growths) >= 64:
                self._growths.clear()
            with np.errstate(over="ignore", invalid="ignore"):
                exponent = Enclosure.exactly(raised(self._comparison * h, 2))
                self._growths[h] = expm(exponent).magnitude
        return self._growths[h]

    @cached_property
    def _growths(self) -> dict[float, Matrix]:
        return {}

    @cached_property
    def _flow(self) -> Rows:
        own = self.gains
        return Rows.from_factors(
            own.flow_factors, self._most(own.flow_effect), self.model.scales, self.model.flow
        )

    @cached_property
    def _jump(self) -> Rows:
        own, (jump,) = self.gains, self.model.jumps
        most = self._most(own.jump_effect)
        return Rows.from_factors(own.jump_factors, most, self.model.scales, jump.c)

    @cached_property
    def _of_flow(self) -> list[Matrix]:
        """Sizes of the effects on A and B, (n, n + m), in balanced units."""
        s = self.model.scales
        columns = np.concatenate([s, np.ones(self.gains.m)])
        return [np.abs(X) * s[:, None] / columns for X in self.gains.effects_on("A", "B")]

    @cached_property
    def _added(self) -> Matrix:
        """Sum of the sizes of all effects on A and B, (n, n + m)."""
        total = np.zeros((self.model.n, self.model.n + self.gains.m))
        for X in self._of_flow:
            total = total + X
        return np.asarray(raised(total, len(self._of_flow)))

    @cached_property
    def _added_inputs(self) -> Matrix:
        return self._added[:, self.model.n :]

    @cached_property
    def _comparison(self) -> Matrix:
        """M (n, n) >= 0 with |x|' <= M |x| + f, such that |x| does not fall in between."""
        A = self.model.A
        own = np.where(np.eye(len(A)) > 0, np.maximum(A, 0.0), np.abs(A))
        return np.asarray(raised(own + self._added[:, : self.model.n], 2))

    @cached_property
    def _rates(self) -> Matrix:
        """Bound (r, n) of |row A| and of what parameters add to it."""
        rows, n = self._flow.of_state, self.model.n
        size = np.abs(rows)
        exact = np.abs(rows @ self.model.A) + (n + 2) * UNIT * (size @ np.abs(self.model.A))
        return np.asarray(raised(exact + size @ self._added[:, :n], 4 * n))

    @cached_property
    def _outputs(self) -> list[Matrix]:
        """Effects on C in balanced units."""
        listed = (*self.gains.effects, *self.gains.rounding)
        return [effect.C / self.model.scales for effect in listed if effect.C is not None]
