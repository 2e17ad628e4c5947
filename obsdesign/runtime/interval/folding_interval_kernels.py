"""The kernels of an interval observer: one set for each length of a step, and those of jumps."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.enclosure import Matrix, raised
from obsdesign.runtime.base import Vector, vector
from obsdesign.runtime.interval.kernel import Kernel, kernel, path_kernel
from obsdesign.runtime.interval.maps import (
    BoxMap,
    flow_and_jump_spread,
    flow_maps,
    free_map,
    identity_map,
    jump_maps,
    sampled,
)
from obsdesign.runtime.interval.model import Model, model
from obsdesign.runtime.interval.state import Course, IntervalState, shared_box
from obsdesign.runtime.step_cache import shared_step

# step lengths as they come, before rounding: a few dozen differences of decimal time stamps
_RECENT = 1024


class StepKernels:
    """Kernels, made when they are first needed.

    gains: of a design of kind `interval`. Of a step: "none" without a measurement, "start" and
    "end" with one there (continuous y), "sampled" (periodic samples), and for the path of a
    `Course` "path" and "sampled path".
    """

    def __init__(self, gains: Mapping[str, Any]) -> None:
        self.gains = gains
        self.periodic = "period" in gains
        self._steps: OrderedDict[tuple[float, int], dict[str, Kernel]] = OrderedDict()
        self._jumped: OrderedDict[tuple[float, int], tuple[Matrix, Matrix]] = OrderedDict()
        self._recent: dict[tuple[float, int], dict[str, Kernel]] = {}
        # (length as it comes, exponent of the later time) -> the kernel of a sample there, in parts
        self.usual: dict[tuple[float, int], tuple[Any, ...]] = {}

    @cached_property
    def model(self) -> Model:
        """The plant in the observer's coordinates, enclosed."""
        with np.errstate(over="ignore", invalid="ignore"):
            return model(self.gains)

    def at(self, h: float, size: float) -> dict[str, Kernel]:
        """For a step of about h between time stamps of magnitude `size`."""
        key = (h, math.frexp(size)[1])
        found = self._recent.get(key)
        if found is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
                self.usual.clear()
            found = shared_step(self._steps, h, size, self._built)
            self._recent[key] = found
            if self.periodic:
                chosen = found["sampled"]
                if chosen.moderate:
                    self.usual[key] = (chosen.rows, chosen.blank, *chosen.parts())
        return found

    @cached_property
    def still(self) -> Mapping[str, Kernel]:
        """Of no time passing."""
        return self.at(0.0, 0.0)

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Of a jump: with the correction M (y - C x), and without."""
        with np.errstate(over="ignore", invalid="ignore"):
            maps = jump_maps(self.model, self.gains)
        return {
            corrected: kernel(self.model, step, step, self.gains["C"], False)
            for corrected, step in maps.items()
        }

    def after_jump(
        self, step: Mapping[str, Kernel], out: Vector, state: IntervalState, y: Vector | None,
        w: ArrayLike | None, off: bool, course: Course | None,
    ) -> tuple[Kernel, Vector]:  # fmt: skip
        """The result after a jump, from `out` just before it; `step`: the kernels that led there.

        With samples as events: the sample and the jump, one after the other, then cut with the
        jump corrected by M. off: the sample is off the period. course: up to the jump, as long as
        no sample ended it.
        """
        if "G" not in self.gains:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        inputs = self.gains["E"].shape[1] if "E" in self.gains else 0
        known = np.zeros(inputs) if w is None else vector(w, inputs, "w")
        when = self.gains["jump_measurement"]

        def jumped(box: Vector, measured: bool) -> tuple[Kernel, Vector]:
            k = self.jumps[measured]
            return k, k.rows.dot(k.vector(box, None, y if measured else None, known))

        n2 = len(state.box)
        use = y is not None and when != "none"
        if not self.periodic:
            return jumped(out[:n2], use)
        k, after = jumped(out[:n2], False)
        if course is not None:
            k, after = self.shared(k, after, [self._after_course(course, known)], state.u)
        if not use:
            return k, after
        if when == "after":
            k, free = self.still["sampled"], after
            after = k.rows.dot(k.vector(free[:n2], None, y, state.u))
            if off:
                k, after = self.shared(k, after, [free[:n2]], state.u)
        if np.any(self.gains["M"]):
            plain = step["none"]
            before = plain.rows.dot(plain.vector(state.box, state.y, None, state.u))
            _, other = jumped(before[:n2], True)
            box = shared_box(after[:n2], other[:n2], k.n)
            k = self.still["none"]
            after = k.rows.dot(k.vector(box, None, None, state.u))
        return k, after

    def _after_course(self, course: Course, known: Vector) -> Vector:
        """The box after a jump that ends a course."""
        path = self._jump_path.rows.dot(self._jump_path.vector(course.path, None, None, known))
        n, t = len(course.radius), course.now
        size = max(abs(t), abs(course.since))
        R, g = shared_step(self._jumped, t - course.since, size, self._flow_and_jump)
        reach = raised(R @ course.radius + g, 2 * n)
        return np.concatenate([raised(reach + path[:n], 1), path[n:]])

    def _flow_and_jump(self, h: float, h_error: float) -> tuple[Matrix, Matrix]:
        return flow_and_jump_spread(self.model, self.gains, h, h_error)

    @cached_property
    def _jump_path(self) -> Kernel:
        return path_kernel(jump_maps(self.model, self.gains)[False], len(self.gains["C"]))

    def shared(
        self, chosen: Kernel, used: Vector, boxes: Sequence[Vector], u: Vector
    ) -> tuple[Kernel, Vector]:
        """The result of what `used` shares with further boxes, which the first of them bounds.

        What is reported is cut with all that the sample says, as far as that leaves something.
        """
        n = chosen.n
        k = self.still["none"]
        box = boxes[0]
        for other in (*boxes[1:], used[: 2 * n]):
            box = shared_box(box, other, n)
        out: Vector = k.rows.dot(k.vector(box, None, None, np.zeros_like(u)))
        lower, upper = chosen.bounds(used)
        ends = np.maximum(out[-2 * n :], np.concatenate([lower, -upper]))
        if (ends[:n] <= -ends[n:]).all():
            out[-2 * n :] = ends
        return k, out

    def _built(self, h: float, h_error: float) -> dict[str, Kernel]:
        plant = self.model
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            if h == 0.0:
                maps = {"none": identity_map(plant)}
            elif self.periodic:
                maps = {"none": free_map(plant, h, h_error)}
            else:
                maps = flow_maps(plant, h, h_error)
            if self.periodic:
                maps["sampled"] = sampled(plant, maps["none"], h, h_error)
        built = {name: self._kernel(name, maps) for name in maps}
        if self.periodic:
            p = len(self.gains["C"])
            built["path"] = path_kernel(maps["none"], p)
            built["sampled path"] = path_kernel(maps["sampled"], p)
        return built

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        predicted = maps["start" if name == "start" else "none"]
        return kernel(self.model, maps[name], predicted, self.gains["C"], name == "sampled")
