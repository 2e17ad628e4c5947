"""The state of an interval observer between two samples, and the box that it begins with."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.boxes import initial_bounds, midpoint
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.interval.model import Model
from obsdesign.runtime.state_marks import (
    UNBOUNDED,
    Axes,
    Inputs,
    Outputs,
    Past,
    StackedBox,
    UnboundedRadii,
)


class Course(NamedTuple):
    """Bounds since a sample on the period or a jump, beside those of the rows that came between.

    since: its time; now: that of the last row; radius: (n,) at the first; path: (2n,), the centre
    carried along to the second, after a bound of what rounding has added to it.
    """

    since: Past
    now: Past
    radius: UnboundedRadii
    path: Annotated[Matrix, UNBOUNDED, Axes("2n")]


class HeldBounds(NamedTuple):
    """What bounds of a row leave to the step after it, as inputs of `VaryingKernels`.

    b: (2k,), shifts of the middle of b, or of w where b = Bw w, and parts of the declared radii;
    v: (p,), parts of those of the noise of the measurement that the step starts from.
    """

    b: Annotated[Matrix, Axes("2k")]
    v: Outputs


class IntervalState(NamedTuple):
    """Everything the next step needs, just after time t.

    box: (2n,), [lower; -upper] in the observer's coordinates; u: input that holds; y: measurement
    that the next step may start from; sampled: time of the last one used; refutation: since when,
    and why, the bounds are void, "" while they hold; phase: time of the last sample that was a
    period after another one, or began anew (periodic samples only), NaN before the first; is_usual:
    is it ordinary, and were all numbers of the last step below `MODERATE`? course: None where the
    box is just after a sample on the period or a jump (periodic samples only); bounds: those that
    hold up to the next row, None as declared; largest: of |x|, as long as a box of the state that
    the design has proved may not hold yet (`state_box`), else None.
    """

    t: float
    box: StackedBox
    u: Inputs
    y: Outputs | None
    guard: DwellGuard
    started: bool
    sampled: Past
    refutation: str = ""
    phase: Past = math.nan
    is_usual: bool = False
    course: Course | None = None
    bounds: HeldBounds | None = None
    largest: UnboundedRadii | None = None

    @property
    def is_ordinary(self) -> bool:
        """Does the next step need the box, the inputs and the measurement alone?"""
        return (
            not self.refutation
            and self.course is None
            and self.bounds is None
            and self.largest is None
        )


def first_box(model: Model, n: int, lower: ArrayLike, upper: ArrayLike) -> Matrix:
    """The box in the observer's coordinates that bounds of x give; ValueError if they are none."""
    low, high = initial_bounds(n, lower, upper)
    if model.S is None:
        return np.concatenate([low, -high])
    with np.errstate(over="ignore", invalid="ignore"):  # the next step reports what overflowed
        return ends_of(model.from_plant(*midpoint(low, high)))


def ends_of(box: Matrix) -> Matrix:
    """[lower; -upper], rounded outward, of a box [r; m]."""
    radius, centre = np.split(box, 2)
    ends: Matrix = np.nextafter(np.concatenate([centre - radius, -centre - radius]), -np.inf)
    return ends
