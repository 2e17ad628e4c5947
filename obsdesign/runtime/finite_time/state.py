"""The state of a finite-time observer between two samples."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.finite_time.known_inputs import KnownInput
from obsdesign.runtime.finite_time.tape import Tape
from obsdesign.runtime.state_marks import MISSING, Axes, Inputs, Past, Radii, States, UnboundedRadii


class CachedRadius(NamedTuple):
    """A radius that holds as long as everything it depends on stays below the entries here.

    w, x: absolute values; forced: `HeldInput.size`; square: squared length of the window;
    shift_rounding: the array itself; w_rounding: the one that enters the radius.
    """

    w: States
    x: States
    forced: States
    square: float
    shift_rounding: Radii
    w_rounding: Radii
    radius: UnboundedRadii


class HeldInput(NamedTuple):
    """Known input u until the next one; drive: its contribution to (w, C w) in a period.

    size: |B| |u| + |b_mid|.
    """

    u: Inputs
    drive: Annotated[Matrix, Axes("d")]
    size: States


class Filling(NamedTuple):
    """Contents of the window: instants in it, and those of them without a sample.

    full: was the estimate taken from a full window, False with gaps, None not yet; moderate: are
    x, w and the residuals below `MODERATE`?
    """

    instants: int
    missing: int
    full: bool | None
    moderate: bool


class StateBounds(NamedTuple):
    """|state - centre| <= radius, for an observer with bounds.

    w_rounding: largest error that w gathers in a period, at the period's end; w_error: what it has
    gathered since the last instant, carried to the next one; shift_rounding: rounding of the
    residuals when w was shifted; cached_radius: the last one.
    """

    centre: States
    radius: UnboundedRadii
    w_rounding: Radii
    w_error: Radii
    shift_rounding: Radii
    cached_radius: CachedRadius | None


class FiniteTimeState(NamedTuple):  # a frozen dataclass of this size costs more than the step
    """Everything the next step needs, just after time t.

    x: estimate; w: known response; window: (k p,) residuals y - C w, oldest first, NaN where a
    sample is missing; known: known inputs of (14) as printed; since_shift: instants since w was
    shifted onto the estimate; last_instant: its time; anchor_time, periods_since_anchor: an
    instant, and how many periods ago it was; tape, tape_end: where the window may grow.
    """

    t: float
    x: States
    w: States
    held: HeldInput
    window: Annotated[Matrix, MISSING, Axes("kp")]
    known: KnownInput | None
    filling: Filling
    bounds: StateBounds
    since_shift: int
    last_instant: Past | None
    anchor_time: Past
    periods_since_anchor: int
    started: bool
    tape: Tape | None = None
    tape_end: int = 0
