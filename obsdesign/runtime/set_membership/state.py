"""The state of a multiplier observer between two rows."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.set_membership.stages import Stage
from obsdesign.runtime.state_marks import (
    ROWS,
    Axes,
    Box,
    Inputs,
    MeasuredRow,
    Past,
    UnboundedRadii,
)


class SetMembershipState(NamedTuple):
    """Everything the next row needs, just after time t; in balanced units z = scales * x.

    box (2, n): bounds of z; start (2, n): bounds before the oldest of the stages; u: input that
    holds; held (2, k): bounds of the flow's disturbance up to the next row; guards: of every event;
    sampled: time of the last measurement of every sensor; sent (p,): values that sensors on change
    sent last, NaN without; refutation: since when, and why, the bounds are void, "" while they
    hold; recent: the boxes after the last rows, the latest one last: one more than `fixed_lag` at
    most; largest: bounds of |x|, as long as a box of the state may not hold, else None.
    """

    t: float
    box: Box
    start: Box
    stages: tuple[Stage, ...]
    u: Inputs
    held: Annotated[Matrix, ROWS, Axes("2 b")]
    guards: tuple[DwellGuard, ...]
    started: bool
    sampled: tuple[Past, ...]
    sent: MeasuredRow
    refutation: str = ""
    recent: tuple[Box, ...] = ()
    largest: UnboundedRadii | None = None
