"""Kernels of an interval observer: of steps, by cells of lengths or of their own; of jumps."""

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
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.interval.cell_rows import Maps
from obsdesign.runtime.interval.kernel import Kernel, Result, crossed
from obsdesign.runtime.interval.kernel_rows import Cuts, is_known_from_strip, kernel
from obsdesign.runtime.interval.map_series import MapSeries
from obsdesign.runtime.interval.maps import BoxMap, flow_and_jump_spread, jump_maps, step_maps
from obsdesign.runtime.interval.model import Model, observer_model
from obsdesign.runtime.interval.path import PathMap, around_path
from obsdesign.runtime.interval.state import Course
from obsdesign.runtime.interval.step_cells import StepCells, Usual
from obsdesign.runtime.jump import no_jumps
from obsdesign.runtime.step_cache import SHORT_STEP_ULPS, decimal_unit, shared_step

# kernels of usual steps that are kept, and lengths as they come for which
_KEPT, _MOST_LENGTHS = 256, 4096
# of each kernel, by name: maps that lead to boxes, first that of the step, and to strips of y1
_CUTS = {
    "none": (["none"], []),
    "start": (["start", "none"], []),
    "end": (["end", "none"], ["none"]),
    "sampled": (["sampled", "none"], ["none"]),
    "both": (["start", "end", "none"], ["start", "none"]),
}
# where nothing is left to know from y0
_WITHOUT_START = {"both": "end", "start": "none"}
# where in a cell that is decided
_PLACES = (-1.0, 0.0, 1.0)


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

    def __init__(self, map_of: Callable[[str], BoxMap], build: Callable[[str], Kernel]) -> None:
        super().__init__()
        self._map_of = map_of
        self._build = build
        self._maps: dict[str, BoxMap] = {}
        self._paths: dict[str, PathMap] = {}

    def __missing__(self, name: str) -> Kernel:
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            self[name] = built = self._build(name)
        return built

    def box_map(self, name: str) -> BoxMap:
        """The map `name` of the step."""
        if name not in self._maps:
            self._maps[name] = self._map_of(name)
        return self._maps[name]

    def path(self, name: str) -> PathMap:
        """The map `name` of the path of a `Course`."""
        if name not in self._paths:
            self._paths[name] = PathMap.from_map(self.box_map(name))
        return self._paths[name]


class StepKernels:
    """Kernels, made when they are first needed.

    gains: of a design of kind `interval`. Of a step: "none" without a measurement, "start", "end"
    and "both" with one there (continuous y), "sampled" (periodic samples).
    """

    def __init__(self, gains: IntervalGains) -> None:
        self.gains = gains
        self.is_periodic = gains.is_periodic
        self._sampled = "sampled" if self.is_periodic else "both"
        # one output, inputs of any size: most of the time of a step is spent calling
        self._is_short = gains.p == 1 and not (gains.is_uncertain and gains.columns["u"])
        self._steps: OrderedDict[tuple[float, int], KernelsOfStep] = OrderedDict()
        self._jump_spreads: OrderedDict[tuple[float, int], tuple[Matrix, Matrix]] = OrderedDict()
        # exponent of the later time -> shortest step that shares its length, and unit of lengths
        self._scales: dict[int, tuple[float, float]] = {}
        # (shared length, exponent of the later time): the last without a kernel that is kept, and
        # the kept ones of samples there, in parts
        self._previous: tuple[float, int] | None = None
        self._usual: dict[tuple[float, int], Usual] = {}
        # length as it comes -> the last of them that was used
        self.latest: dict[float, Usual] = {}

    @cached_property
    def model(self) -> Model:
        """The plant in the observer's coordinates, enclosed."""
        with np.errstate(over="ignore", invalid="ignore"):
            return observer_model(self.gains)

    def for_step(self, h: float, size: float) -> KernelsOfStep:
        """Kernels of a step of about h between time stamps of magnitude `size`."""
        return shared_step(
            self._steps, h, size, lambda length, error: self._of_length(length, error, size)
        )

    def usual(self, h: float, t: float) -> Usual | None:
        """The kernel of a step of about h to a sample at t, in parts; None where none is at hand.

        A length has a kernel that is kept once it comes twice in a row, or where cells have none.
        """
        exponent = math.frexp(t)[1]
        shortest, unit = self._scales.get(exponent) or self._scale(t)
        if not shortest <= h < math.inf:
            return None
        key = (round(h / unit) * unit, exponent)
        usual = self._usual.get(key)
        if usual is not None:
            self.latest[h] = usual
            return usual
        if key != self._previous and not self.is_periodic and self.cells is not None:
            self._previous = key
            usual = self.cells.usual(self._sampled, key)
            if usual is not None:
                return usual
        kernel = self.for_step(h, t)[self._sampled]
        if not kernel.moderate:
            return None
        if len(self._usual) >= _KEPT or len(self.latest) >= _MOST_LENGTHS:
            self._usual.clear()
            self.latest.clear()
        self._usual[key] = self.latest[h] = usual = kernel.product, kernel.in_parts(exponent)
        return usual

    def _scale(self, t: float) -> tuple[float, float]:
        """Shortest step that shares its length, inf where none is usual, and unit of lengths."""
        scale = (math.inf, 1.0)
        if self._is_short and 0.0 < t < math.inf:
            scale = (SHORT_STEP_ULPS * math.ulp(t), decimal_unit(t))
            self._scales[math.frexp(t)[1]] = scale
        return scale

    def with_sample(self, h: float, size: float, has_start: bool) -> Kernel:
        """The kernel of a step with a sample at its end; has_start: and one at its start."""
        return self.for_step(h, size)[self._sampled if has_start or self.is_periodic else "end"]

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

    @cached_property
    def cells(self) -> StepCells | None:
        """Kernels of all lengths of a cell at once; None where each length has its own."""
        choice = partial(_in_cell, self._is_known_from_strip)
        with np.errstate(over="ignore", invalid="ignore"):
            return StepCells(self.model, self.gains.C, choice, is_periodic=self.is_periodic)

    def _of_length(self, h: float, h_error: float, size: float) -> KernelsOfStep:
        """Kernels of a shared length: those of its cell, of the period its own."""
        if h == 0.0 or self.cells is None or self._is_period(h, size):
            return self.built(h, h_error)
        spot = self.cells.spot(h, size)
        if spot is None:
            return self.built(h, h_error)
        return KernelsOfStep(
            partial(self.cells.box_map, spot=spot), partial(self.cells.kernel, spot=spot)
        )

    def _is_period(self, h: float, size: float) -> bool:
        period = self.gains.period
        return period is not None and abs(h - period) <= time_tolerance(period, size)

    def built(self, h: float, h_error: float) -> KernelsOfStep:
        """Kernels of a length of its own, h >= 0, known up to h_error."""
        with np.errstate(over="ignore", invalid="ignore"):
            maps = step_maps(self.model, h, h_error, is_periodic=self.is_periodic)
        return KernelsOfStep(maps.__getitem__, lambda name: self._kernel(name, maps))

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        """The kernel `name` of a step with these maps."""
        return self._with_cuts(self.model, *self._chosen(name, maps))

    def _chosen(self, name: str, maps: Mapping[str, BoxMap]) -> tuple[BoxMap, Cuts]:
        """The map of the kernel `name`, and what it is cut with."""
        free = maps["none"]
        if name in ("both", "start") and self._is_known_from_strip(maps["start"], free):
            name = _WITHOUT_START[name]
        boxes, strips = ([maps.get(each, free) for each in names] for names in _CUTS[name])
        return boxes[0], Cuts(boxes[1:], strips)

    def _is_known_from_strip(self, start: BoxMap, free: BoxMap) -> bool:
        model = self.model
        return model.S is None and is_known_from_strip(start, free, self.gains.C, model.V)

    def _with_cuts(self, model: Model, step: BoxMap, cuts: Cuts) -> Kernel:
        return kernel(model, step, self.gains.C, cuts)


def _in_cell(
    is_known_from_strip: Callable[[BoxMap, BoxMap], bool],
    name: str,
    series: Callable[[str], MapSeries],
) -> Maps:
    """The maps of the kernel `name` for all steps of a cell."""
    if name in _WITHOUT_START and all(
        is_known_from_strip(series("start").box_map(s), series("none").box_map(s)) for s in _PLACES
    ):
        name = _WITHOUT_START[name]
    boxes, strips = ([series(each) for each in names] for names in _CUTS[name])
    return Maps(list({id(each): each for each in boxes}.values()), strips)
