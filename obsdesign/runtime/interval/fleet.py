"""Many plants at once, each with a design, sampling times, jumps and gaps of its own.

Plants of one design that make a step of one length, with a sample in time at its end and no jump,
are done side by side; every other one takes `IntervalObserver.step`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.boxes import JUMP, BoundsFault
from obsdesign.runtime.interval.fleet_state import (
    FleetDraft,
    FleetEstimate,
    FleetRows,
    FleetState,
    entry_of,
)
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.side_by_side import FEWEST_PLANTS, Boxes, Group, groups_of
from obsdesign.runtime.interval.state import IntervalState
from obsdesign.runtime.status import status_of

_PLANT = ("A", "B", "C", "G", "E", "flow_lower", "flow_upper", "jump_lower", "jump_upper",
          "noise_bound", "noise_centre", "jump_measurement",
          "disturbance_matrix", "disturbance_lower", "disturbance_upper",
          "jump_disturbance_matrix", "jump_disturbance_lower",
          "jump_disturbance_upper")  # fmt: skip


@dataclass(frozen=True)
class Fleet:
    """Executes an observer for each plant; plants of one design share one object.

    ValueError without any, or unless samples of all have the same columns.
    """

    observers: tuple[IntervalObserver, ...]

    def __post_init__(self) -> None:
        if not self.observers:
            raise ValueError("a fleet needs at least one observer.")
        if not all(isinstance(each, IntervalObserver) for each in self.observers):
            raise ValueError("observers of a fleet must be of plants with one event and one sensor")
        first = self.observers[0]
        for other, _ in self._designs:
            if (other.n, other.reads) != (first.n, first.reads):
                raise ValueError(
                    "observers of a fleet must have the same numbers of states, outputs and inputs."
                )

    def init(self, t: ArrayLike = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> FleetState:
        """State at time t, one or (plants,), from bounds of x, (n,) for all or (n, plants)."""
        n, times = self.observers[0].n, np.array(t, dtype=np.float64, ndmin=1)
        low, high = self._columns(lower, n), self._columns(upper, n)
        plants = zip(self.observers, low.T, high.T, strict=True)
        own = [
            each.init(entry_of(times, i), lower=a, upper=b) for i, (each, a, b) in enumerate(plants)
        ]
        ends = np.array([each.box for each in own]).T.copy()
        boxes = Boxes(ends, None, np.zeros((self._reads("u"), len(own))))
        single = {i: each for i, each in enumerate(own) if self._is_small or not each.is_ordinary}
        return FleetState(times, boxes, {}, single)

    def reset(
        self, state: FleetState, plant: int, *, lower: ArrayLike, upper: ArrayLike
    ) -> FleetState:
        """The same instant with new bounds of x of one plant: ends the refutation of its state."""
        own = self._own_state(state, plant)
        own = self.observers[plant].reset(own, lower=lower, upper=upper)
        return state._replace(single={**state.single, plant: own})

    def step(
        self,
        state: FleetState,
        t: ArrayLike,
        y: ArrayLike | None = None,
        *,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
    ) -> tuple[FleetState, FleetEstimate]:
        """Move every plant to its time, use its sample, and jump if it says so.

        t, jump: one for all or (plants,); y, u, w: (k,) for all or (k, plants). NaN in t: no row of
        this plant; NaN in y: a missing sample. ValueError if the time of a plant does not increase.
        """
        rows = FleetRows(
            t=np.array(t, dtype=np.float64, ndmin=1),
            y=self._columns(
                np.full(self._reads("y"), np.nan) if y is None else y, self._reads("y")
            ),
            u=None if u is None else self._columns(u, self._reads("u")),
            w=None if w is None else self._columns(w, self._reads("w")),
            jump=None if jump is None else np.broadcast_to(np.asarray(jump, bool), self._size),
        )
        if self._is_small:
            return self._one_by_one(state, rows)
        with np.errstate(over="ignore", invalid="ignore"):
            groups = self._groups(state, rows)
            if len(groups) == 1 and len(groups[0].members) == self._size:
                done = groups[0].advanced(state.boxes, rows.y)
                if done.plausible.all():
                    held = state.boxes.u if rows.u is None else rows.u
                    boxes = Boxes(done.ends, rows.y, held)
                    following = FleetState(rows.t, boxes, state.guards, {})
                    return following, FleetEstimate(rows.t, done.lower, done.upper, {})
            return self._mixed(state, rows, groups)

    def intersection(self, estimate: FleetEstimate) -> Estimate:
        """The intersection of all bounds; ValueError unless all designs are for one plant."""
        if self._differing_entry is not None:
            raise ValueError(f"observers must be for one plant; {self._differing_entry} differs.")
        return intersection([estimate.plant(i) for i in range(self._size)])

    def _one_by_one(self, state: FleetState, rows: FleetRows) -> tuple[FleetState, FleetEstimate]:
        """Every plant by a step of its own: all of them are in `state.single`."""
        single, estimates = dict(state.single), {}
        lower, upper = np.full((2, self.observers[0].n, self._size), np.nan)
        for i, observer in enumerate(self.observers):
            sample = rows.sample(i)
            if not math.isnan(sample.t):
                single[i], estimate = observer.step(single[i], sample)
                lower[:, i], upper[:, i] = estimate.lower, estimate.upper
                estimates[i] = estimate
        return state._replace(single=single), FleetEstimate(rows.t, lower, upper, estimates)

    def _mixed(
        self, state: FleetState, rows: FleetRows, groups: list[Group]
    ) -> tuple[FleetState, FleetEstimate]:
        """Groups side by side, every other plant that has a row by a step of its own."""
        draft = FleetDraft(state, rows, self._size)
        for group in groups:
            draft.take_group(group, state.boxes, rows)
        for i in np.flatnonzero(draft.is_open).tolist():
            observer = self.observers[i]
            own, estimate = observer.step(self._own_state(state, i), rows.sample(i))
            draft.take_single(i, own, estimate, not observer.clock.is_regular(own))
        if state.boxes.y is None:  # the column of a plant without any sample yet cannot say so
            for i in np.flatnonzero(np.isnan(draft.y).any(axis=0)).tolist():
                draft.single.setdefault(i, self._own_state(state, i))
        return draft.result(state, rows)

    def _groups(self, state: FleetState, rows: FleetRows) -> list[Group]:
        """Plants that make one step in time, with a sample at its end and no jump."""
        h, size = rows.t - state.t, np.maximum(np.abs(rows.t), np.abs(state.t))
        ordinary, has_y = self._is_ordinary(state, rows) & (h > 0), state.boxes.y is not None
        groups: list[Group] = []
        if not has_y and self._reads("u"):  # first samples, which state the known inputs
            return groups
        for observer, plants in self._designs:
            regular = ordinary
            if observer.known_inputs.u is not None:
                regular = regular & observer.known_inputs.kept(state.boxes.u.T)
            if has_y:
                regular = regular & observer.clock.regular_steps(h, rows.t)
            if len(regular) == 1:
                plants = plants[: len(plants) * int(regular[0])]
            else:
                plants = plants[regular[plants]]
            groups += groups_of(observer.kernels, plants, h, size, has_y=has_y)
        return groups

    def _is_ordinary(self, state: FleetState, rows: FleetRows) -> NDArray[np.bool_]:
        """Which plants, (1,) or (plants,), have a sample, no jump and an ordinary last step."""
        ordinary = np.ones(1, dtype=bool)
        for block in (rows.y, state.boxes.u):
            if not np.isfinite(block.sum()):
                ordinary = ordinary & np.isfinite(block).all(axis=0)
        if rows.jump is not None:
            ordinary = ordinary & ~rows.jump
        guards = state.guards.items()
        late = [i for i, guard in guards if guard.after(entry_of(rows.t, i), False)[1]]
        if late or state.single:
            ordinary = np.array(np.broadcast_to(ordinary, self._size))
            ordinary[[*late, *state.single]] = False
        return ordinary

    @cached_property
    def _designs(self) -> list[tuple[IntervalObserver, Indices]]:
        """Every observer with its plants."""
        places: dict[int, list[int]] = {}
        for i, observer in enumerate(self.observers):
            places.setdefault(id(observer), []).append(i)
        return [(self.observers[each[0]], np.array(each)) for each in places.values()]

    @cached_property
    def _differing_entry(self) -> str | None:
        """Name of an entry of the plant in which designs differ."""
        first = self.observers[0].gains
        for other, _ in self._designs:
            for name in _PLANT:
                if not np.array_equal(getattr(first, name), getattr(other.gains, name)):
                    return name
        return None

    @cached_property
    def _size(self) -> int:
        return len(self.observers)

    @cached_property
    def _is_small(self) -> bool:
        """Do all plants take steps of their own?"""
        return self._size < FEWEST_PLANTS

    def _reads(self, name: str) -> int:
        return int(self.observers[0].reads[name])

    def _columns(self, values: ArrayLike, rows: int) -> Matrix:
        """A new array (rows, plants) from one column for all or from one for each plant."""
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in ((rows,), (rows, self._size)):
            raise ValueError(
                f"an array must have shape {(rows,)} or {(rows, self._size)}; got {array.shape}."
            )
        return np.array(np.broadcast_to(array.reshape(rows, -1), (rows, self._size)))

    def _own_state(self, state: FleetState, plant: int) -> IntervalState:
        """The state of one plant."""
        if plant in state.single:
            return state.single[plant]
        t, boxes = entry_of(state.t, plant), state.boxes
        fresh = self.observers[plant].from_box(t, boxes.ends[:, plant].copy())
        if boxes.y is None:
            return fresh
        return fresh._replace(
            u=boxes.u[:, plant], y=boxes.y[:, plant], started=True, phase=t,
            guard=state.guards.get(plant, fresh.guard),
        )  # fmt: skip


def intersection(estimates: Sequence[Estimate]) -> Estimate:
    """The estimate of one plant, at one time, from those of several designs: inside all bounds.

    A guarantee about the width that one of them has, the intersection has. The status is `ok` if
    all are, else their objections, each once.
    """
    lower = np.array([each.lower for each in estimates], dtype=np.float64).max(axis=0)
    upper = np.array([each.upper for each in estimates], dtype=np.float64).min(axis=0)
    events = tuple(dict.fromkeys(event for each in estimates for event in each.events))
    objections = [text for _, text in events if text != JUMP]
    first = estimates[0]
    if (lower > upper).any():
        lower, upper = first.lower, first.upper
        objections.append(BoundsFault.CROSSED)
    status = status_of(list(dict.fromkeys(objections)))
    return Estimate(first.t, None, lower, upper, events=events, status=status)
