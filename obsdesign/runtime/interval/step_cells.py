"""The cells of an observer's steps: series of their maps, and kernels from them.

Cells are made when a step first has its length in them. They do not depend on the steps that came
before, and so neither does any number.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from math import log
from threading import get_ident
from typing import NamedTuple

import numpy as np
from numpy import exp

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT
from obsdesign.runtime.enclosed_series import REACH, Cell
from obsdesign.runtime.interval.cell_kernels import Blank, CellKernel
from obsdesign.runtime.interval.cell_rows import Maps
from obsdesign.runtime.interval.kernel import Kernel, KernelParts, Product
from obsdesign.runtime.interval.map_series import Flows, MapSeries, StepSeries
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model
from obsdesign.runtime.length_cells import NEXT_TO_ZERO, LengthCells, Place
from obsdesign.runtime.step_cache import cached_step, shared_error

# cells of lengths between two powers of two, and how many cells have kernels, and maps, at a time
_MOST_CELLS, _KERNELS, _MAPS = 32, 80, 8
# the maps of a kernel by its name, from those of the steps of a cell by theirs
Choice = Callable[[str, Callable[[str], MapSeries]], Maps]


class Spot(NamedTuple):
    """Where a length is: its cell, its place x in it, and how far the true one may be from it."""

    place: Place
    x: float
    reach: float


# a kernel as a usual step takes it
Usual = tuple[Product, KernelParts]


class Room(NamedTuple):
    """A kernel of a cell that is written anew for each step (`CellKernel.blank`)."""

    blank: Blank
    usual: Usual


class StepCells:
    """Kernels of steps by the cells of their lengths, each made when it is first needed."""

    def __init__(self, model: Model, C: Matrix, choice: Choice, *, is_periodic: bool) -> None:
        self._model, self._C, self._choice = model, C, choice
        self._flows = Flows(model, is_periodic=is_periodic)
        self._lengths = LengthCells(self._flows.norm * REACH * (1.0 + 1e-6), _MOST_CELLS)
        self._series: OrderedDict[Place, StepSeries] = OrderedDict()
        self._kernels: OrderedDict[tuple[Place, str], CellKernel] = OrderedDict()
        self._rooms: OrderedDict[tuple[Place, int, int], Room | None] = OrderedDict()

    def spot(self, length: float, size: float) -> Spot | None:
        """Where a shared length is, between stamps of at most `size`; None where series are none.

        That is where steps are long for the flow, or their stamps are rough for them.
        """
        cell = self._lengths.place(length)
        if cell is None:
            return None
        place, x = cell
        reach = self._reach(place, size)
        return Spot(place, x, reach) if reach < REACH - 1.0 else None

    def kernel(self, name: str, spot: Spot) -> Kernel:
        """The kernel `name` of a step."""
        return self._of_cell(name, spot.place).kernel(spot.x, spot.reach)

    def box_map(self, name: str, spot: Spot) -> BoxMap:
        """The map `name` of a step."""
        return self._series_of(spot.place)[name].box_map(2.0 * spot.x - 1.0, spot.reach)

    def usual(self, name: str, step: tuple[float, int]) -> Usual | None:
        """The kernel `name` of a step until the next call in this thread; None as for `spot`.

        name: the same in all calls; step: shared length, and exponent of the time at its end.
        """
        length, exponent = step
        cell = self._lengths.place(length)
        if cell is None:
            return None
        place, x = cell
        key = (place, exponent, get_ident())
        room = self._rooms.get(key) or self._new_room(name, key)
        if room is None:
            return None
        (exponents, complete, coefficients, half), usual = room
        weights = exponents * log(x or NEXT_TO_ZERO)
        exp(weights, weights)
        (complete(weights) if complete else weights).dot(coefficients, half)
        return usual

    def _new_room(self, name: str, key: tuple[Place, int, int]) -> Room | None:
        place, exponent, _ = key
        return cached_step(self._rooms, key, lambda _: self._room(name, place, exponent))

    def _room(self, name: str, place: Place, exponent: int) -> Room | None:
        reach = self._reach(place, math.ldexp(0.5, exponent))
        if not reach < REACH - 1.0:
            return None
        own = self._of_cell(name, place)
        kernel, blank = own.blank(reach)
        if not kernel.moderate:
            return None
        return Room(blank, (kernel.product, kernel.in_parts(exponent)))

    def _reach(self, place: Place, size: float) -> float:
        """How far true places are from those of the stamps, anywhere in a cell."""
        half = self._lengths.ends(place)[1]
        return shared_error(math.ldexp(1.0, place[0]), size) / half * (1.0 + 4 * UNIT)

    def _of_cell(self, name: str, place: Place) -> CellKernel:
        return cached_step(self._kernels, (place, name), self._built, _KERNELS)

    def _built(self, key: tuple[Place, str]) -> CellKernel:
        place, name = key
        with np.errstate(over="ignore", invalid="ignore"):
            maps = self._choice(name, self._series_of(place).__getitem__)
            return CellKernel(self._model, self._C, maps)

    def _series_of(self, place: Place) -> StepSeries:
        def build(place: Place) -> StepSeries:
            return StepSeries(self._flows, Cell(*self._lengths.ends(place)))

        return cached_step(self._series, place, build, _MAPS)
