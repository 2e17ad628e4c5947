"""Kernels of an interval observer: one set for each length of a step, and those of jumps."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import raised
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.base import no_jumps, vector
from obsdesign.runtime.interval.kernel import Kernel, KernelParts, kernel, path_kernel
from obsdesign.runtime.interval.maps import (
    BoxMap,
    flow_and_jump_spread,
    jump_maps,
    step_maps,
)
from obsdesign.runtime.interval.model import Model, observer_model
from obsdesign.runtime.interval.state import Course, IntervalState, shared_box
from obsdesign.runtime.step_cache import shared_step

# step lengths as they come, before rounding: a few dozen differences of decimal time stamps
_RECENT = 1024


class JumpSample(NamedTuple):
    """A sample at a jump; is_off_period: it is early, so that no claim counts it.

    u: inputs of the step that leads to it; parts: of its own bounds (`VaryingKernels`).
    """

    y: Matrix | None
    w: ArrayLike | None
    is_off_period: bool
    u: Matrix
    parts: Matrix


class StepKernels:
    """Kernels, made when they are first needed.

    gains: of a design of kind `interval`. Of a step: "none" without a measurement, "start" and
    "end" with one there (continuous y), "sampled" (periodic samples), and for the path of a
    `Course` "path" and "sampled path".
    """

    def __init__(self, gains: IntervalGains) -> None:
        self.gains = gains
        self.is_periodic = gains.is_periodic
        self._steps: OrderedDict[tuple[float, int], dict[str, Kernel]] = OrderedDict()
        self._jump_spreads: OrderedDict[tuple[float, int], tuple[Matrix, Matrix]] = OrderedDict()
        self._recent: dict[tuple[float, int], dict[str, Kernel]] = {}
        # (length as it comes, exponent of the later time) -> the kernel of a sample there, in parts
        self.usual: dict[tuple[float, int], KernelParts] = {}

    @cached_property
    def model(self) -> Model:
        """The plant in the observer's coordinates, enclosed."""
        with np.errstate(over="ignore", invalid="ignore"):
            return observer_model(self.gains)

    def for_step(self, h: float, size: float) -> dict[str, Kernel]:
        """Kernels of a step of about h between time stamps of magnitude `size`."""
        key = (h, math.frexp(size)[1])
        kernels = self._recent.get(key)
        if kernels is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
                self.usual.clear()
            kernels = shared_step(self._steps, h, size, self._built)
            self._recent[key] = kernels
            if self.is_periodic:
                chosen = kernels["sampled"]
                if chosen.moderate:
                    self.usual[key] = chosen.in_parts()
        return kernels

    def with_sample(self, h: float, size: float, has_start: bool) -> Kernel:
        """The kernel of a step with a sample at its end; has_start: and one at its start."""
        mode = "sampled" if self.is_periodic else "start" if has_start else "end"
        return self.for_step(h, size)[mode]

    @cached_property
    def still(self) -> Mapping[str, Kernel]:
        """Kernels of a step of length zero."""
        return self.for_step(0.0, 0.0)

    @property
    def declared(self) -> StepKernels:
        """Kernels for the declared bounds of b, c and v."""
        return self

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Kernels of a jump: with the correction M (y - C x), and without."""
        return {
            corrected: kernel(self.model, step, step, self.gains.C, strips=False)
            for corrected, step in jump_maps(self.model, self.gains).items()
        }

    def after_jump(
        self, step: Mapping[str, Kernel], out: Matrix, state: IntervalState, jump: JumpSample,
        course: Course | None,
    ) -> tuple[Kernel, Matrix]:  # fmt: skip
        """The result after a jump, from `out` just before it; `step`: the kernels that led there.

        With samples as events: the sample and the jump, one after the other, then cut with the
        jump corrected by M. course: up to the jump, as long as no sample ended it.
        """
        gains = self.gains
        if gains.G is None:
            raise no_jumps()
        inputs = 0 if gains.E is None else gains.E.shape[1]
        w = np.zeros(inputs) if jump.w is None else vector(jump.w, inputs, "w")
        known = np.concatenate([w, jump.parts]) if jump.parts.size else w
        n2 = len(state.box)
        uses_sample = jump.y is not None and gains.jump_measurement != "none"
        if not self.is_periodic:
            return self._jumped(out[:n2], known, jump.y if uses_sample else None)
        k, after = self._jumped(out[:n2], known, None)
        if course is not None:
            k, after = self.shared(k, after, [self.declared._after_course(course, w)], jump.u)
        if not uses_sample:
            return k, after
        if gains.jump_measurement == "after":
            k, free = self.still["sampled"], after
            after = k.rows.dot(k.vector(free[:n2], None, jump.y, jump.u))
            if jump.is_off_period:
                k, after = self.shared(k, after, [free[:n2]], jump.u)
        if np.any(gains.M):
            plain = step["none"]
            before = plain.rows.dot(plain.vector(state.box, state.y, None, jump.u))
            _, corrected = self._jumped(before[:n2], known, jump.y)
            box = shared_box(after[:n2], corrected[:n2], k.n)
            k = self.still["none"]
            after = k.rows.dot(k.vector(box, None, None, jump.u))
        return k, after

    def _jumped(self, box: Matrix, known: Matrix, y: Matrix | None) -> tuple[Kernel, Matrix]:
        """The result of a jump from a box just before it, corrected by M if y is there."""
        k = self.jumps[y is not None]
        return k, k.rows.dot(k.vector(box, None, y, known))

    def _after_course(self, course: Course, known: Matrix) -> Matrix:
        """The box after a jump that ends a course."""
        path = self._jump_path.rows.dot(self._jump_path.vector(course.path, None, None, known))
        n, t = len(course.radius), course.now
        size = max(abs(t), abs(course.since))
        spread = partial(flow_and_jump_spread, self.model, self.gains)
        R, g = shared_step(self._jump_spreads, t - course.since, size, spread)
        reach = raised(R @ course.radius + g, 2 * n)
        return np.concatenate([raised(reach + path[:n], 1), path[n:]])

    @cached_property
    def _jump_path(self) -> Kernel:
        return path_kernel(jump_maps(self.model, self.gains)[False], self.gains.p)

    def shared(
        self, chosen: Kernel, used: Matrix, boxes: Sequence[Matrix], u: Matrix
    ) -> tuple[Kernel, Matrix]:
        """The result of the intersection of `used` with further boxes, inside the first of them.

        Reported bounds are cut with those of `used`, unless the intersection is empty.
        """
        n = chosen.n
        k = self.still["none"]
        box = boxes[0]
        for other in (*boxes[1:], used[: 2 * n]):
            box = shared_box(box, other, n)
        out: Matrix = k.rows.dot(k.vector(box, None, None, np.zeros_like(u)))
        lower, upper = chosen.bounds(used)
        ends = np.maximum(out[-2 * n :], np.concatenate([lower, -upper]))
        if (ends[:n] <= -ends[n:]).all():
            out[-2 * n :] = ends
        return k, out

    def _built(self, h: float, h_error: float) -> dict[str, Kernel]:
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            maps = step_maps(self.model, h, h_error, is_periodic=self.is_periodic)
            built = {name: self._kernel(name, maps) for name in maps}
            if self.is_periodic:
                built["path"] = path_kernel(maps["none"], self.gains.p)
                built["sampled path"] = path_kernel(maps["sampled"], self.gains.p)
        return built

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        predicted = maps["start" if name == "start" else "none"]
        strips = name == "sampled"
        return kernel(self.model, maps[name], predicted, self.gains.C, strips=strips)
