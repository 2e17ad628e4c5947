"""One ordinary step of many plants of one design: states, samples and bounds in columns.

One product with the kernel of the step serves all plants: the numbers are those of a step of their
own but for the order of summation, which its margins do not depend on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from obsdesign.runtime.interval.kernel import Kernel, largest
from obsdesign.runtime.interval.step_kernels import StepKernels

# plants from which on a step side by side is faster
FEWEST_PLANTS = 8
# plants of one product: few enough for their numbers to stay in the cache
_TOGETHER = 2048


class Boxes(NamedTuple):
    """Plants just after their last sample, one per column.

    ends: (2n, plants), [lower; -upper] in the coordinates of the observer; y: (p, plants), the
    samples, None before the first; u: (m, plants), inputs that hold.
    """

    ends: Matrix
    y: Matrix | None
    u: Matrix

    def part(self, members: Indices) -> Boxes:
        """Some of the plants."""
        y = None if self.y is None else self.y[:, members]
        return Boxes(self.ends[:, members], y, self.u[:, members])


class BoxesStep(NamedTuple):
    """Boxes after a step, and bounds of x (n, plants).

    plausible: (plants,), False where no state inside the bounds can give the sample, where they
    overflowed, or where they crossed.
    """

    ends: Matrix
    lower: Matrix
    upper: Matrix
    plausible: NDArray[np.bool_]


class Group(NamedTuple):
    """Plants of one design that make the same step."""

    kernel: Kernel
    members: Indices

    def advanced(self, boxes: Boxes, measured: Matrix) -> BoxesStep:
        """The step of these boxes with the samples `measured` (p, plants) at its end."""
        k, plants = self.kernel, measured.shape[1]
        n, p = k.n, k.p
        ends, own = np.empty((2, 2 * n, plants))
        plausible = np.empty(plants, bool)
        v = np.empty((k.width, min(plants, _TOGETHER)))
        out = np.empty((len(k.rows), v.shape[1]))
        outer, inner = k.blocks
        for first in range(0, plants, _TOGETHER):
            some = slice(first, min(first + _TOGETHER, plants))
            part, result = v[:, : some.stop - first], out[:, : some.stop - first]
            self._fill(part, boxes, measured, some)
            k.fill_drives(part)
            np.matmul(k.rows, part, out=result)
            largest([result[block] for block in inner or outer], ends[:, some])
            if inner:
                largest([result[block] for block in outer], own[:, some])
            plausible[some] = (result[: 2 * p] >= 0).all(axis=0) & np.isfinite(result[2 * p])
        if not inner:
            own = ends
        lower, upper = own[:n], -own[n:]
        plausible &= (lower <= upper).all(axis=0)
        if inner:
            plausible &= (ends[:n] <= -ends[n:]).all(axis=0)
        return BoxesStep(ends, lower, upper, plausible)

    def _fill(self, v: Matrix, boxes: Boxes, measured: Matrix, some: slice) -> None:
        """v of some of the plants."""
        n2, p, middle = 2 * self.kernel.n, self.kernel.p, self.kernel.middle
        v[:n2] = boxes.ends[:, some]
        v[n2 : n2 + p] = 0.0 if boxes.y is None else boxes.y[:, some]
        v[n2 + p : n2 + 2 * p] = measured[:, some]
        known = n2 + 2 * p + len(boxes.u)
        v[n2 + 2 * p : known], v[known : middle - 1], v[middle - 1] = boxes.u[:, some], 0.0, 1.0
        np.abs(v[:middle], out=v[middle:])


def groups_of(
    kernels: StepKernels, plants: Indices, h: Matrix, size: Matrix, *, has_y: bool
) -> list[Group]:
    """Plants of one design by the kernel of their step, without those of small groups.

    h, size: length of the step and magnitude of its time stamps, (1,) for all or per plant of the
    fleet; has_y: there is a sample at the start.
    """
    if len(plants) < FEWEST_PLANTS:
        return []
    if len(h) == 1:
        return [Group(kernels.with_sample(float(h[0]), float(size[0]), has_y), plants)]
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
    return [Group(kernel, np.concatenate(alike)) for kernel, alike in members.values()]
