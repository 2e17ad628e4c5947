"""Kernels of an interval observer: one set for each length of a step, and those of jumps."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.base import vector
from obsdesign.runtime.boxes import BoundsFault
from obsdesign.runtime.interval.kernel import Kernel, KernelParts, Result, crossed
from obsdesign.runtime.interval.kernel_rows import Cuts, is_known_from_strip, kernel
from obsdesign.runtime.interval.maps import BoxMap, flow_and_jump_spread, jump_maps, step_maps
from obsdesign.runtime.interval.model import Model, observer_model
from obsdesign.runtime.interval.path import PathMap, around_path
from obsdesign.runtime.interval.state import Course
from obsdesign.runtime.jump import no_jumps
from obsdesign.runtime.step_cache import shared_step

# step lengths as they come, before rounding: a few dozen differences of decimal time stamps
_RECENT = 1024


class JumpSample(NamedTuple):
    """A sample at a jump.

    u: inputs of the step that leads to it; parts: of its own bounds (`VaryingKernels`).
    """

    y: Matrix | None
    w: ArrayLike | None
    u: Matrix
    parts: Matrix


class KernelsOfStep(dict[str, Kernel]):
    """Kernels of one step by name, each made by `build` when it is first needed; and its maps."""

    def __init__(self, maps: Mapping[str, BoxMap], build: Callable[[str], Kernel]) -> None:
        super().__init__()
        self.maps = maps
        self._build = build
        self._paths: dict[str, PathMap] = {}

    def __missing__(self, name: str) -> Kernel:
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            self[name] = built = self._build(name)
        return built

    def path(self, name: str) -> PathMap:
        """The map `name` of the path of a `Course`."""
        if name not in self._paths:
            self._paths[name] = PathMap.from_map(self.maps[name])
        return self._paths[name]


class StepKernels:
    """Kernels, made when they are first needed.

    gains: of a design of kind `interval`. Of a step: "none" without a measurement, "start", "end"
    and "both" with one there (continuous y), "sampled" (periodic samples).
    """

    def __init__(self, gains: IntervalGains) -> None:
        self.gains = gains
        self.is_periodic = gains.is_periodic
        # one output and no inputs: most of the time of a step is spent calling
        self._is_short = gains.p == 1 and not gains.columns["u"]
        self._steps: OrderedDict[tuple[float, int], KernelsOfStep] = OrderedDict()
        self._jump_spreads: OrderedDict[tuple[float, int], tuple[Matrix, Matrix]] = OrderedDict()
        self._recent: dict[tuple[float, int], KernelsOfStep] = {}
        # (length as it comes, exponent of the later time) -> the kernel of a sample there, in parts
        self._usual: dict[tuple[float, int], KernelParts] = {}
        # length -> the last of them that was used
        self.latest: dict[float, KernelParts] = {}

    @cached_property
    def model(self) -> Model:
        """The plant in the observer's coordinates, enclosed."""
        with np.errstate(over="ignore", invalid="ignore"):
            return observer_model(self.gains)

    def for_step(self, h: float, size: float) -> KernelsOfStep:
        """Kernels of a step of about h between time stamps of magnitude `size`."""
        key = (h, math.frexp(size)[1])
        kernels = self._recent.get(key)
        if kernels is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
                self._usual.clear()
                self.latest.clear()
            kernels = shared_step(self._steps, h, size, self._built)
            self._recent[key] = kernels
            if h > 0.0 and self._is_short:
                chosen = kernels["sampled" if self.is_periodic else "both"]
                if chosen.moderate:
                    self._usual[key] = chosen.in_parts(key[1])
        return kernels

    def usual(self, h: float, t: float) -> KernelParts | None:
        """The kernel of a step h > 0 to a sample at t, in parts; None where there is none yet."""
        parts = self._usual.get((h, math.frexp(t)[1]))
        if parts is not None:
            self.latest[h] = parts
        return parts

    def with_sample(self, h: float, size: float, has_start: bool) -> Kernel:
        """The kernel of a step with a sample at its end; has_start: and one at its start."""
        mode = "sampled" if self.is_periodic else "both" if has_start else "end"
        return self.for_step(h, size)[mode]

    @cached_property
    def still(self) -> KernelsOfStep:
        """Kernels of a step of length zero."""
        return self.for_step(0.0, 0.0)

    @property
    def keeps_course(self) -> bool:
        """Are whole steps between samples made beside those of their rows (`course`)?"""
        return self.is_periodic

    @property
    def declared(self) -> StepKernels:
        """Kernels for the declared bounds of b, c and v."""
        return self

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Kernels of a jump: with the correction M (y - C x), and without."""
        return self._of_jump(self.model, jump_maps(self.model, self.gains))

    def _of_jump(self, model: Model, maps: dict[bool, BoxMap]) -> dict[bool, Kernel]:
        return {
            corrected: self._with_cuts(model, *self._chosen_at_jump(corrected, maps))
            for corrected in maps
        }

    def _chosen_at_jump(self, corrected: bool, maps: Mapping[bool, BoxMap]) -> tuple[BoxMap, Cuts]:
        """The map of a jump, with its correction or without, and what it is cut with."""
        is_after = self.gains.jump_measurement == "after"
        return maps[corrected], Cuts([maps[False]], [maps[False]] if corrected and is_after else [])

    def after_jump(self, before: Result, jump: JumpSample, course: Course | None) -> list[Result]:
        """The results after a jump and, with samples as events, after the sample just after it.

        before: just before the jump; course: up to it, as long as no sample ended it. A box that
        was cut with its sample is inside the one without it, and so is its image.
        """
        gains = self.gains
        if gains.G is None:
            raise no_jumps()
        inputs = 0 if gains.E is None else gains.E.shape[1]
        w = np.zeros(inputs) if jump.w is None else vector(jump.w, inputs, "w")
        known = np.concatenate([w, jump.parts]) if jump.parts.size else w
        y = jump.y if gains.jump_measurement != "none" else None
        k = self.jumps[y is not None]
        after = k.after(before.box, None, y, known)
        if course is not None:
            after = self.shared(after, self.declared._after_course(course, w), jump.u)
        if y is None or gains.jump_measurement != "after" or not self.is_periodic:
            return [after]
        k = self.still["sampled"]
        return [after, k.after(after.box, None, y, jump.u)]

    def _after_course(self, course: Course, known: Matrix) -> Matrix:
        """The box after a jump that ends a course."""
        t = course.now
        size = max(abs(t), abs(course.since))
        spread = partial(flow_and_jump_spread, self.model, self.gains)
        R, g = shared_step(self._jump_spreads, t - course.since, size, spread)
        return around_path(self._jump_path.after(course.path, None, known), R, g, course.radius)

    @cached_property
    def _jump_path(self) -> PathMap:
        return PathMap.from_map(jump_maps(self.model, self.gains)[False])

    def shared(self, used: Result, box: Matrix, u: Matrix) -> Result:
        """The intersection of a result with a further box; the bounds are cut with those of it."""
        k = self.still["none"]
        both = np.maximum(used.box, box)
        whole = k.after(both, None, None, np.zeros_like(u))
        ends = np.maximum(
            np.concatenate([used.lower, -used.upper]), np.concatenate([whole.lower, -whole.upper])
        )
        if crossed(both) or crossed(ends):
            return used._replace(fault=used.fault or BoundsFault.CROSSED)
        size = max(used.size, whole.size)
        return Result(both, ends[: k.n], -ends[k.n :], size, used.fault or whole.fault)

    def _built(self, h: float, h_error: float) -> KernelsOfStep:
        with np.errstate(over="ignore", invalid="ignore"):
            maps = step_maps(self.model, h, h_error, is_periodic=self.is_periodic)
        return KernelsOfStep(maps, lambda name: self._kernel(name, maps))

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        """The kernel `name` of a step with these maps."""
        return self._with_cuts(self.model, *self._chosen(name, maps))

    def _chosen(self, name: str, maps: Mapping[str, BoxMap]) -> tuple[BoxMap, Cuts]:
        """The map of the kernel `name`, and what it is cut with."""
        free = maps["none"]
        if name in ("both", "start") and self._is_known_from_strip(maps["start"], free):
            name = "end" if name == "both" else "none"
        if name in ("none", "start"):
            return maps[name], Cuts([free])
        started = [maps["start"]] if name == "both" else []
        ended = [maps["end"]] if name == "both" else []
        chosen = started[0] if started else maps.get(name, free)  # "end" of no step is its start
        return chosen, Cuts([*ended, free], [*started, free])

    def _is_known_from_strip(self, start: BoxMap, free: BoxMap) -> bool:
        model = self.model
        return model.S is None and is_known_from_strip(start, free, self.gains.C, model.V)

    def _with_cuts(self, model: Model, step: BoxMap, cuts: Cuts) -> Kernel:
        return kernel(model, step, self.gains.C, cuts)
