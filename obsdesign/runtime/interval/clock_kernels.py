"""Kernels of an interval observer for several clocks: of a step, of a sample, of an event.

The box lives in the plant's own coordinates. A step multiplies its radius by e^{W h}, W = Mz(A),
in discrete time by |A|^k, the comparison system of which the widths are claimed: two steps are then
one step of their sum, so that a row without measurements adds rounding alone, and of two records
the one with more samples has the smaller boxes. Bounds of b and v are inputs of the kernels: rows
may narrow them.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.clock_gains import ClockedIntervalGains
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.clocks.time_grid import power_and_sum
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import Cuts, kernel
from obsdesign.runtime.interval.maps import BoxMap, driven, identity_map
from obsdesign.runtime.interval.model import Model, exactly, metzler_bound, size
from obsdesign.runtime.step_cache import cached_step, shared_step


class ClockKernels:
    """Kernels, made when they are first needed."""

    def __init__(self, gains: ClockedIntervalGains) -> None:
        self.gains = gains
        self._steps: OrderedDict[tuple[float, int], Kernel] = OrderedDict()
        self._counts: OrderedDict[int, Kernel] = OrderedDict()
        self._samples: dict[tuple[int, bytes], Kernel] = {}
        self._events: dict[tuple[int, bool], Kernel] = {}

    def step(self, h: float, size_of_t: float) -> Kernel:
        """Of a step of about h > 0 between time stamps of this magnitude.

        Its inputs are [u; middle of b; radius of b].
        """
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            return shared_step(self._steps, h, size_of_t, self._of_step)

    def steps(self, count: int) -> Kernel:
        """Of so many steps of discrete time; inputs as of `step`."""
        with np.errstate(over="ignore", invalid="ignore"):
            return cached_step(self._counts, count, self._of_steps)

    def sample(self, sensor: int, there: Matrix) -> Kernel:
        """Of a sample of a sensor of which these outputs are there; inputs: radii of the noise."""
        key = (sensor, there.tobytes())
        if key not in self._samples:
            self._samples[key] = self._of_sample(self.gains.outputs[sensor], there)
        return self._samples[key]

    def event(self, event: int, corrected: bool) -> Kernel:
        """Of an event, with its correction or without; inputs: [w; radii of the noise]."""
        key = (event, corrected)
        if key not in self._events:
            self._events[key] = self._of_event(event, corrected)
        return self._events[key]

    @cached_property
    def used(self) -> Matrix:
        """(e, p): does the correction at an event use an output?"""
        return np.asarray((self.gains.event_gains != 0).any(axis=1))

    @cached_property
    def _model(self) -> Model:
        """The plant without outputs and radii, with b as an input."""
        gains, n = self.gains, self.gains.n
        B = np.zeros((n, 0)) if gains.B is None else gains.B
        A, nothing = exactly(gains.A), np.zeros(n)
        return Model(
            A=A, C=exactly(np.zeros((0, n))), L=exactly(np.zeros((n, 0))),
            inputs=exactly(np.column_stack([B, np.eye(n)])), jump_inputs=exactly(np.zeros((n, 0))),
            b_rad=nothing, c_columns=None, c_rad=nothing, V=np.zeros(0), y_mid=np.zeros(0),
            width=metzler_bound(A), S=None, S_inverse=None,
        )  # fmt: skip

    def _of_step(self, h: float, error: float) -> Kernel:
        model, n = self._model, self.gains.n
        Phi, known = driven(model.A, model.inputs, h, error)
        growth, added = driven(exactly(model.width), exactly(np.eye(n)), h, error)
        return self._of_flow(Phi, known, (growth, added))

    def _of_steps(self, count: int) -> Kernel:
        model = self._model
        Phi, total = power_and_sum(model.A, count)
        widths = power_and_sum(exactly(np.abs(self.gains.A)), count)
        return self._of_flow(Phi, total @ model.inputs, widths)

    def _of_flow(
        self, Phi: Enclosure, known: Enclosure, widths: tuple[Enclosure, Enclosure]
    ) -> Kernel:
        """widths: maps of the radius of the box, and of that of b."""
        model, n = self._model, self.gains.n
        R, spread = (np.maximum(X.upper, 0.0) for X in widths)
        X = _hstack(Phi, known, _error(spread), _zeros(n, 1))
        return kernel(model, BoxMap(X, R, np.zeros(n)), np.zeros((0, n)), Cuts())

    def _of_sample(self, own: slice, there: Matrix) -> Kernel:
        gains, n = self.gains, self.gains.n
        C, L = gains.C[own][there], gains.L[:, own]
        p = len(C)
        model = replace(
            self._model, C=exactly(C), V=np.zeros(p), y_mid=np.zeros(p),
            inputs=exactly(np.zeros((n, p + 1))),
        )  # fmt: skip
        still = identity_map(model)
        boxes = [_corrected(L, C)] if there.all() and L.any() else []
        return kernel(model, still, C, Cuts(boxes, [still]), noise=np.ones(p))

    def _of_event(self, event: int, corrected: bool) -> Kernel:
        gains, own, n, p = self.gains, self.gains.events[event], self.gains.n, self.gains.p
        c_mid, c_rad = midpoint(*image_box(*own.disturbance))
        E = np.zeros((n, 0)) if own.E is None else own.E
        G, known = exactly(own.G), exactly(E)
        model = replace(self._model, C=exactly(gains.C), V=np.zeros(p), y_mid=np.zeros(p))
        ends = exactly(c_mid[:, None])
        X = _hstack(G, _zeros(n, 2 * p), known, _zeros(n, p), ends)
        plain = BoxMap(X, size(G), c_rad)
        if not corrected:
            return kernel(model, plain, gains.C, Cuts())
        M = exactly(gains.event_gains[event])
        H = G - M @ exactly(gains.C)
        X = _hstack(H, _zeros(n, p), M, known, _error(size(M)), ends)
        return kernel(model, plain, gains.C, Cuts([BoxMap(X, size(H), c_rad)]))


def _corrected(L: Matrix, C: Matrix) -> BoxMap:
    """x+ = x + L (y - C x), the radii of the noise as inputs."""
    n, p = L.shape
    K = exactly(np.eye(n)) - exactly(L) @ exactly(C)
    X = _hstack(K, _zeros(n, p), exactly(L), _error(size(exactly(L))), _zeros(n, 1))
    return BoxMap(X, size(K), np.zeros(n))


def _hstack(*blocks: Enclosure) -> Enclosure:
    return Enclosure(np.hstack([b.mid for b in blocks]), np.hstack([b.rad for b in blocks]))


def _zeros(rows: int, columns: int) -> Enclosure:
    return exactly(np.zeros((rows, columns)))


def _error(radius: Matrix) -> Enclosure:
    """Columns of inputs that add up to that much, of any sign."""
    return Enclosure(np.zeros_like(radius), radius)


def is_finite(k: Kernel, out: Matrix) -> bool:
    """Are all numbers of a result finite?"""
    return math.isfinite(out[2 * k.p])
