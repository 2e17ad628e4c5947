"""The maps of a step as series in its length: those of `maps`, for all lengths of a cell.

Radii are sums of absolute values. Where one has the same sign all over the cell it is a series; the
others are series of which a step takes the absolute value (`Kinks`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from lmi.arithmetic.exponential import FLOW_PIECES
from obsdesign.runtime.enclosed_series import TERMS, Cell, Flow, Series
from obsdesign.runtime.interval.flow_systems import (
    comparison_blocks,
    comparison_system,
    with_inputs,
)
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model, exactly, metzler_bound, size


@dataclass(frozen=True)
class Kinks:
    """What absolute values add to a radius R r + g: sums over groups of them.

    values: series (k,) whose absolute values count; group: (k,) place of each among R (j, n, n)
    and g (j, n), of which a group adds its sum times one.
    """

    values: Series
    group: Indices
    R: Matrix
    g: Matrix

    @classmethod
    def none(cls, n: int) -> Kinks:
        """No absolute values."""
        values = Series(np.zeros((TERMS, 0)), np.zeros(0))
        return cls(values, np.zeros(0, int), np.zeros((0, n, n)), np.zeros((0, n)))

    def joined(self, other: Kinks) -> Kinks:
        """Those of both."""
        ours, theirs = self.values, other.values
        values = Series(
            np.concatenate([ours.mid, theirs.mid], axis=-1),
            np.concatenate([ours.rad, theirs.rad], axis=-1),
        )
        group = np.concatenate([self.group, len(self.R) + other.group])
        return Kinks(
            values, group, np.concatenate([self.R, other.R]), np.concatenate([self.g, other.g])
        )


@dataclass(frozen=True)
class MapSeries:
    """A `BoxMap` for the lengths of a cell. X: (n, n + 2p + m + 1); R: (n, n); g: (n, 1)."""

    X: Series
    R: Series
    g: Series
    kinks: Kinks

    def box_map(self, s: float, reach: float = 0.0) -> BoxMap:
        """The map at s and at all within `reach` of it (`Series.enclosure`)."""
        R, g = self.R.enclosure(s, reach).upper, self.g.enclosure(s, reach).upper[:, 0]
        values, kinks = self.kinks.values.enclosure(s, reach).magnitude, self.kinks
        sums = np.bincount(kinks.group, values, len(kinks.R))
        R = raised(R + np.tensordot(sums, kinks.R, axes=1), len(values) + 2)
        g = raised(g + sums @ kinks.g, len(values) + 2)
        return BoxMap(self.X.enclosure(s, reach), np.maximum(R, 0.0), np.maximum(g, 0.0))


class Flows:
    """The flows whose exponentials are the maps of a step (`flow_systems`)."""

    def __init__(self, model: Model, *, is_periodic: bool) -> None:
        self.model = model
        n, p = model.L.mid.shape
        W, b = exactly(metzler_bound(model.A)), exactly(model.b_rad[:, None])
        self.free = Flow(with_inputs(model.A, model.inputs))
        self.plant = Flow(model.A)
        self.piece = Flow(with_inputs(W, b).scaled(1.0 / FLOW_PIECES))
        self.corrected = Flow(with_inputs(model.A - model.L @ model.C, model.L))
        self.comparison = Flow(exactly(comparison_system(model)))
        self.blocks = comparison_blocks(n, p)
        used = [self.free, self.plant, self.piece]
        used += [] if is_periodic else [self.corrected, self.comparison]
        self.norm = max(each.norm for each in used)


@dataclass(frozen=True)
class StepSeries:
    """The maps of steps whose lengths lie in a cell, made when they are first needed."""

    flows: Flows
    cell: Cell
    _made: dict[str, MapSeries] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """The plant."""
        return self.flows.model

    def __getitem__(self, name: str) -> MapSeries:
        """The map `name` of `maps.step_maps`."""
        if name not in self._made:
            make = {
                "none": self._free, "sampled": self._sampled, "start": self._start, "end": self._end
            }[name]  # fmt: skip
            self._made[name] = make()
        return self._made[name]

    def _free(self) -> MapSeries:
        n = len(self.model.b_rad)
        return self._predicted(exactly(np.eye(n)), self._flow[0], self._flow[1])

    def _predicted(self, left: Enclosure, Phi: Series, known: Series) -> MapSeries:
        """The map of a step without measurements times left, a constant; Phi, known: so too."""
        signs = Phi.signs()
        R, of_R = _absolute(Phi, signs)
        g, of_g = self._on_the_way(left)
        kinks = of_R.joined(of_g)
        return MapSeries(self._side_by_side(Phi, None, None, known), R, g, kinks)

    def _sampled(self) -> MapSeries:
        """z+ = z + L (y - C z) at the end of the step, y measured there (`maps.sampled`)."""
        model = self.model
        if not size(model.L).any():
            return self["none"]
        K = exactly(np.eye(len(model.b_rad))) - model.L @ model.C
        Phi, forced = self._flow
        step = self._predicted(K, Phi.left_product(K), forced.left_product(K))
        X = self._side_by_side(
            Phi.left_product(K), None, Series.constant(model.L), forced.left_product(K)
        )
        noise = raised(size(model.L) @ model.V, 2 * (len(model.V) + 1))
        return MapSeries(X, step.R, step.g + Series.constant(exactly(noise[:, None])), step.kinks)

    def _start(self) -> MapSeries:
        Phi, forced = self._flow
        part = self._comparison
        X = self._side_by_side(Phi - self._K.right_product(self.model.C), self._K, None, forced)
        R, g = part["qq"] + part["q_rho"], part["q_1"] + part["q_2"]
        return MapSeries(X, R, g, Kinks.none(len(R.rad)))

    def _end(self) -> MapSeries:
        Phi, forced = self._flow
        n, part = len(Phi.rad), self._comparison
        outer = Series.constant(exactly(np.eye(n))) - self._K.right_product(self.model.C)
        X = self._side_by_side(outer.times(Phi), None, self._K, outer.times(forced))
        R = part["qq"] + (part["q_sig"].times(part["sig_rho"]) - part["q_rho"])
        g = part["q_1"] + (part["q_sig"].times(part["sig_2"]) - part["q_2"])
        return MapSeries(X, R, g, Kinks.none(n))

    @cached_property
    def _flow(self) -> tuple[Series, Series]:
        """(e^{A h}, int_0^h e^{A s} ds of the known inputs)."""
        n, whole = len(self.model.b_rad), self.flows.free.exponential(self.cell)
        return whole[:n, :n], whole[:n, n:]

    @cached_property
    def _K(self) -> Series:
        """int_0^h e^{(A - L C) s} ds L."""
        n = len(self.model.b_rad)
        return self.flows.corrected.exponential(self.cell)[:n, n:]

    @cached_property
    def _comparison(self) -> dict[str, Series]:
        """Blocks of the exponential of `comparison_system`."""
        whole = self.flows.comparison.exponential(self.cell)
        return {name: whole[where] for name, where in self.flows.blocks.items()}

    def _on_the_way(self, left: Enclosure) -> tuple[Series, Kinks]:
        """Bound of int_0^h |X e^{A s}| ds b_rad, X = left (`maps`)."""
        n = len(self.model.b_rad)
        flows = self.flows.plant.exponentials(self.cell, FLOW_PIECES).left_product(left)
        pushed = self.flows.piece.exponential(self.cell)[:n, n:]
        signs = flows.signs()
        fixed = np.where(np.isnan(signs), 0.0, signs)
        rad = np.where(np.isnan(signs), 0.0, flows.rad).sum(axis=0)
        total = Series((fixed * flows.mid).sum(axis=1), raised(
            rad + FLOW_PIECES * UNIT * flows.size.sum(axis=0), FLOW_PIECES))  # fmt: skip
        j, i, k = np.nonzero(np.isnan(signs))
        pushes = Series(pushed.mid[:, k, :, None], pushed.rad[k, :, None])
        open_flows = Series(flows.mid[:, j, i, k, None, None], flows.rad[j, i, k, None, None])
        values = open_flows.times(pushes)
        flat = Series(values.mid[..., 0, 0], values.rad[..., 0, 0])
        states, group = np.unique(i, return_inverse=True)
        kinks = Kinks(flat, group, np.zeros((len(states), n, n)), np.eye(n)[states])
        return total.times(pushed), kinks

    def _side_by_side(
        self, m: Series, start: Series | None, end: Series | None, known: Series
    ) -> Series:
        """Put the blocks of X side by side (`maps.box_map`)."""
        n, p = self.model.L.mid.shape
        unused = Series(np.zeros((TERMS, n, p)), np.zeros((n, p)))
        last = known[:, -1:]
        for K in (start, end):
            if K is not None:
                last = last - K.right_product(exactly(self.model.y_mid[:, None]))
        parts = (m, start or unused, end or unused, known[:, :-1], last)
        return Series(
            np.concatenate([each.mid for each in parts], axis=-1),
            np.concatenate([each.rad for each in parts], axis=-1),
        )


def _absolute(X: Series, signs: Matrix) -> tuple[Series, Kinks]:
    """|X| as a series where signs are known, and as kinks of R elsewhere."""
    n, fixed = len(X.rad), np.where(np.isnan(signs), 0.0, signs)
    i, j = np.nonzero(np.isnan(signs))
    units = np.zeros((len(i), n, n))
    units[np.arange(len(i)), i, j] = 1.0
    values = Series(X.mid[:, i, j], X.rad[i, j])
    kinks = Kinks(values, np.arange(len(i)), units, np.zeros((len(i), n)))
    return Series(fixed * X.mid, np.where(np.isnan(signs), 0.0, X.rad)), kinks
