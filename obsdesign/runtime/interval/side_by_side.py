"""One ordinary step of many plants of one design: states, samples and bounds in columns.

Rounding is bounded for the largest entry of every row, so that one vector serves all plants. The
bounds are not cut with the strip |C x - y| <= V.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, raised
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.step_kernels import StepKernels

# plants from which on a step side by side is faster
FEWEST_PLANTS = 8


class Boxes(NamedTuple):
    """Plants just after their last sample, one per column.

    centre, radius: (n, plants), in the coordinates of the observer; y: (p, plants), the samples,
    None before the first; u: (m, plants), inputs that hold.
    """

    centre: Matrix
    radius: Matrix
    y: Matrix | None
    u: Matrix

    def part(self, members: Indices) -> Boxes:
        """Some of the plants."""
        y = None if self.y is None else self.y[:, members]
        return Boxes(self.centre[:, members], self.radius[:, members], y, self.u[:, members])


class BoxesStep(NamedTuple):
    """Boxes after a step, and bounds of x (n, plants).

    plausible: (plants,), False where no state inside the bounds can give the sample, or where they
    overflowed.
    """

    centre: Matrix
    radius: Matrix
    lower: Matrix
    upper: Matrix
    plausible: NDArray[np.bool_]


class Group(NamedTuple):
    """Plants of one design that make the same step; S: coordinates x = S z."""

    S: Matrix | None
    kernel: Kernel
    members: Indices

    def advanced(self, boxes: Boxes, measured: Matrix) -> BoxesStep:
        """The step of these boxes with the samples `measured` (p, plants) at its end."""
        n, p, middle, rows = self.kernel.n, self.kernel.p, self.kernel.middle, self.kernel.rows
        start = np.zeros_like(measured) if boxes.y is None else boxes.y
        largest = (_largest(block) for block in (boxes.centre, start, measured, boxes.u))
        known = np.concatenate([*largest, np.ones(1)])
        X, checks = rows[n : 2 * n, n:middle], rows[2 * n : 2 * n + p]
        driven = _Driven(start, measured, boxes.u)
        centre = driven.added(X[:, :n] @ boxes.centre, X[:, n:])
        radius = rows[:n, :n] @ boxes.radius
        radius += raised(rows[:n, middle:] @ known, 4 * middle)[:, None]
        radius *= 1.0 + 8 * n * UNIT
        middles = driven.added(checks[:, n : 2 * n] @ boxes.centre, checks[:, 2 * n : middle])
        reach = checks[:, :n] @ boxes.radius
        reach += raised(checks[:, middle:] @ known, 4 * middle)[:, None]
        lower, upper = _bounds(self.S, centre, radius)
        reach -= np.abs(middles, out=middles)
        plausible = reach.min(axis=0) >= 0
        if not np.isfinite(upper.sum() - lower.sum()):
            plausible &= np.isfinite(upper - lower).all(axis=0)
        return BoxesStep(centre, radius, lower, upper, plausible)


class _Driven(NamedTuple):
    """What a step knows beside the box: y at its start and end, and inputs; columns are plants."""

    start: Matrix
    end: Matrix
    u: Matrix

    def added(self, total: Matrix, X: Matrix) -> Matrix:
        """`total`, which is overwritten, plus X [y at the start; y at the end; u; 1]."""
        p = len(self.end)
        total += X[:, p : 2 * p] @ self.end
        total += X[:, -1:]
        if X[:, :p].any():
            total += X[:, :p] @ self.start
        if len(self.u):
            total += X[:, 2 * p : -1] @ self.u
        return total


def groups_of(
    kernels: StepKernels, plants: Indices, h: Matrix, size: Matrix, *, has_y: bool
) -> list[Group]:
    """Plants of one design by the kernel of their step, without those of small groups.

    h, size: length of the step and magnitude of its time stamps, (1,) for all or per plant of the
    fleet; has_y: there is a sample at the start.
    """
    S = kernels.gains.S
    if len(plants) < FEWEST_PLANTS:
        return []
    if len(h) == 1:
        return [Group(S, kernels.with_sample(float(h[0]), float(size[0]), has_y), plants)]
    steps = np.column_stack([h[plants], np.frexp(size[plants])[1]])
    _, firsts, inverse, counts = np.unique(
        steps, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    members: dict[int, tuple[Kernel, list[Indices]]] = {}
    for k in np.flatnonzero(counts >= FEWEST_PLANTS):
        first = plants[firsts[k]]
        kernel = kernels.with_sample(float(h[first]), float(size[first]), has_y)
        alike = members.setdefault(id(kernel), (kernel, []))[1]
        alike.append(plants[inverse.reshape(-1) == k])
    return [Group(S, kernel, np.concatenate(alike)) for kernel, alike in members.values()]


def _bounds(S: Matrix | None, centre: Matrix, radius: Matrix) -> tuple[Matrix, Matrix]:
    """Return bounds of x = S z, rounded outward by widening the radius."""
    if S is not None:
        spread = raised(np.abs(S) @ (radius + 8 * len(S) * UNIT * np.abs(centre)), 4 * len(S))
        centre, radius = S @ centre, spread
    # in place: arrays of many plants are slow to allocate
    widened = np.abs(centre)
    widened += radius
    widened *= 4 * UNIT
    widened += radius
    return centre - widened, centre + widened


def _largest(values: Matrix) -> Matrix:
    """Largest absolute value of each row."""
    largest: Matrix = np.maximum(values.max(axis=1), -values.min(axis=1))
    return largest
