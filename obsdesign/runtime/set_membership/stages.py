"""The tape of stages that a bound looks back at, and its arrays.

A stage is a step of time or a jump, and the measurement taken after it, if any. Between two stages
the state is z_k, for which a certified box is stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from obsdesign.runtime.set_membership.model import Model
from obsdesign.runtime.set_membership.tables import Table, Tables
from obsdesign.runtime.state_marks import (
    MISSING,
    RADIUS,
    Axes,
    Below,
    Box,
    Past,
    Radii,
    States,
    Step,
)


class Targets(NamedTuple):
    """What is bounded: the rows l (B, n) of l'z after the stages `places` (B,) of a window.

    T - 1 for the state now, -1 for the one before the oldest stage.
    """

    rows: Matrix
    places: Indices

    def with_more(self, others: Targets) -> Targets:
        """These and others."""
        return Targets(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))


class Stage(NamedTuple):
    """One stage: all that its arrays are made from.

    t: time after it; h: length of its step and size: of the time stamps, for the enclosure of the
    step; jump: it is a jump. known (k,): inputs, then the middle of the disturbance; drift,
    drift_error (n,): what is added for them; radius (width,): radii of the columns of the
    disturbance. strip (2, p): lower and upper bounds of C z after it, NaN for an output that is
    missing, None without a measurement. box (2, n): certified bounds of z after it. ends_row: it is
    the last stage of its row. spread: largest width that was predicted, without a measurement.
    event: of a jump, its place among the events. in_time: all stated times were kept at its row.
    """

    t: Past
    h: Step
    size: float
    jump: bool
    known: Annotated[Matrix, Axes("k")]
    drift: States
    drift_error: Radii
    radius: Annotated[Matrix, RADIUS, Axes("w")]
    strip: Annotated[Matrix, MISSING, Axes("2 p")] | None
    box: Box
    ends_row: bool
    spread: float = 0.0
    event: Annotated[int, Below("events")] = 0
    in_time: bool = True

    @property
    def is_still(self) -> bool:
        """Is it a measurement alone, without any time since the stage before?"""
        return self.h == 0.0 and not self.jump

    def continues(self, before: Stage) -> bool:
        """Is it the flow of the stage before, which ended without a measurement?"""
        return (
            before.strip is None
            and not (before.jump or self.jump)
            and before.in_time == self.in_time
            and np.array_equal(before.known, self.known)
            and np.array_equal(before.radius, self.radius)
        )

    def driven(self, table: Table) -> Stage:
        """The stage with the drift that its table gives, and any box."""
        drift, error = drift_of(table, self.known)
        nothing = np.full((2, len(drift)), np.inf) * [[-1.0], [1.0]]
        return self._replace(drift=drift, drift_error=error, box=nothing)

    def standing_still(self) -> Stage:
        """Its measurement alone, where the state after it is where a tape begins."""
        zero = np.zeros_like(self.drift)
        return self._replace(
            h=0.0, jump=False, drift=zero, drift_error=zero, radius=np.zeros_like(self.radius)
        )


@dataclass(frozen=True)
class Window:
    """Arrays of T stages, oldest first; start (2, n): the box before the first.

    Phi (T, n, n), drift (T, n) and their errors; columns (T, n, 3, pieces, width), spread, length
    (T, 1, 1, 1), radius (T, 1, 1, width): see `Table`. strips (T, 2, p): zeros without a sample;
    sampled (T, p); times (T,): after each stage. sizes (T + 1, n): bound of |z| before the first
    stage and after each. C (p, n).
    """

    start: Matrix
    Phi: Matrix
    phi_error: Matrix
    drift: Matrix
    drift_error: Matrix
    columns: Matrix
    column_error: Matrix
    spread: Matrix
    length: Matrix
    radius: Matrix
    strips: Matrix
    sampled: NDArray[np.bool_]
    times: Matrix
    sizes: Matrix
    C: Matrix
    tables: tuple[Table, ...]

    def __len__(self) -> int:
        return len(self.Phi)


def magnitude(box: Matrix) -> Matrix:
    """Bound of |z| in a box (..., 2, n): (..., n)."""
    return np.asarray(np.abs(box).max(axis=-2))


def drift_of(table: Table, known: Matrix) -> tuple[Matrix, Matrix]:
    """(forced @ known, its error): what known inputs and middles of disturbances add to z."""
    driven = table.forced @ Enclosure.exactly(known[:, None])
    return driven.mid[:, 0], driven.rad[:, 0]


def table_of(tables: Tables, stage: Stage) -> Table:
    """The table of a stage."""
    return tables.jumps[stage.event] if stage.jump else tables.for_step(stage.h, stage.size)


def window_of(
    model: Model, tables: Tables, start: Matrix, stages: Sequence[Stage], last: Matrix | None
) -> Window:
    """The arrays of stages; last: size of z after the last one, None where it is not known yet."""
    listed = tuple(table_of(tables, stage) for stage in stages)
    T, n, p = len(stages), model.n, len(model.C)
    pieces = max(table.pieces for table in listed)
    columns, column_error = np.zeros((2, T, n, 3, pieces, model.width))
    spread = np.zeros((T, n, 2, pieces, model.width))
    for k, table in enumerate(listed):
        columns[k, :, :, : table.pieces] = table.columns
        column_error[k, :, :, : table.pieces] = table.column_error
        spread[k, :, :, : table.pieces] = table.sizes
    strips = np.full((T, 2, p), np.nan)
    for k, stage in enumerate(stages):
        if stage.strip is not None:
            strips[k] = stage.strip
    sampled = ~np.isnan(strips[:, 0])
    sizes = magnitude(np.array([start, *(stage.box for stage in stages)]))
    sizes[T] = 0.0 if last is None else last
    return Window(
        start=start, Phi=np.array([t.Phi for t in listed]),
        phi_error=np.array([t.phi_error for t in listed]),
        drift=np.array([s.drift for s in stages]),
        drift_error=np.array([s.drift_error for s in stages]),
        columns=columns, column_error=column_error, spread=spread,
        length=np.array([t.length for t in listed])[:, None, None, None],
        radius=np.array([s.radius for s in stages])[:, None, None, :],
        strips=np.where(sampled[:, None], strips, 0.0), sampled=sampled,
        times=np.array([s.t for s in stages]), sizes=sizes, C=model.C, tables=listed,
    )  # fmt: skip


def sampled_strip(y: Matrix, lower: Matrix, upper: Matrix) -> Matrix:
    """(2, p): outward bounds of y - v for lower <= v <= upper."""
    pad = 2.0 * UNIT
    low, high = y - upper, y - lower
    return np.stack([
        np.where((y == low) & (upper == 0), low, low - raised(pad * np.abs(low), 1)),
        np.where((y == high) & (lower == 0), high, high + raised(pad * np.abs(high), 1)),
    ])  # fmt: skip
