"""A fleet between two steps, its rows and its estimates, and a step as it is put together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.interval.side_by_side import Boxes, Group
from obsdesign.runtime.interval.state import IntervalState


class FleetState(NamedTuple):
    """Everything the next step needs; t: (plants,), or (1,) where all have one time.

    guards: of plants that have jumped; single: states of plants whose last step was not an ordinary
    one, which stand for their columns.
    """

    t: Matrix
    boxes: Boxes
    guards: Mapping[int, DwellGuard]
    single: Mapping[int, IntervalState]


class FleetEstimate(NamedTuple):
    """Bounds of x at t: lower, upper (n, plants), NaN for a plant without a row.

    t as in a `FleetState`; single: estimates of plants that took a step of their own, with status
    and events. All others are `ok`.
    """

    t: Matrix
    lower: Matrix
    upper: Matrix
    single: Mapping[int, Estimate]

    def plant(self, i: int) -> Estimate:
        """The estimate of one plant."""
        if i in self.single:
            return self.single[i]
        return Estimate(entry_of(self.t, i), None, self.lower[:, i], self.upper[:, i])


class FleetRows(NamedTuple):
    """A row of every plant: t (1,) or (plants,); y, u, w (k, plants); jump (plants,)."""

    t: Matrix
    y: Matrix
    u: Matrix | None
    w: Matrix | None
    jump: NDArray[np.bool_] | None

    def sample(self, i: int) -> Sample:
        """The sample of one plant."""
        u, w = (None if block is None else block[:, i] for block in (self.u, self.w))
        jump = self.jump is not None and bool(self.jump[i])
        return Sample(entry_of(self.t, i), self.y[:, i], u, w, jump)


class FleetDraft:
    """State and estimate of a step as it is put together; a plant with a row is open until then."""

    def __init__(self, state: FleetState, rows: FleetRows, plants: int) -> None:
        boxes = state.boxes
        self._ends, self._u = boxes.ends.copy(), boxes.u.copy()
        self.y = np.full(rows.y.shape, np.nan) if boxes.y is None else boxes.y.copy()
        self._lower, self._upper = np.full((2, len(boxes.ends) // 2, plants), np.nan)
        self.is_open = ~np.isnan(np.broadcast_to(rows.t, plants))
        self.single, self._guards = dict(state.single), dict(state.guards)
        self._estimates: dict[int, Estimate] = {}

    def take_group(self, group: Group, boxes: Boxes, rows: FleetRows) -> None:
        """Plants of a group, as far as their bounds are plausible."""
        done = group.advanced(boxes.part(group.members), rows.y[:, group.members])
        plants = group.members[done.plausible]
        for whole, part in (
            (self._ends, done.ends), (self._lower, done.lower), (self._upper, done.upper)
        ):  # fmt: skip
            whole[:, plants] = part[:, done.plausible]
        self.y[:, plants] = rows.y[:, plants]
        if rows.u is not None:
            self._u[:, plants] = rows.u[:, plants]
        self.is_open[plants] = False

    def take_single(
        self, plant: int, own: IntervalState, estimate: Estimate, stays_single: bool
    ) -> None:
        """A plant after a step of its own; its column is that step's unless it stays single."""
        self._lower[:, plant], self._upper[:, plant] = estimate.lower, estimate.upper
        self._estimates[plant] = estimate
        if stays_single:
            self.single[plant] = own
            return
        self.single.pop(plant, None)
        self._ends[:, plant] = own.box
        self._u[:, plant], self.y[:, plant] = own.u, own.y
        if own.guard.last_jump is not None:
            self._guards[plant] = own.guard

    def result(self, state: FleetState, rows: FleetRows) -> tuple[FleetState, FleetEstimate]:
        """What the step ends with."""
        t, absent = rows.t, np.isnan(rows.t)
        if absent.any():
            t = np.where(absent, state.t, t)
        boxes = Boxes(self._ends, self.y, self._u)
        estimate = FleetEstimate(rows.t, self._lower, self._upper, self._estimates)
        return FleetState(t, boxes, self._guards, self.single), estimate


def entry_of(values: Matrix, plant: int) -> float:
    """The entry of one plant, or the one that all share."""
    return float(values[plant if len(values) > 1 else 0])
