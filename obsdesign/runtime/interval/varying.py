"""Kernels for rows with bounds of b, c and v of their own.

Assumption 3 of Degue, Efimov, Richard (NOLCOS 2016): bounds may depend on time.
The comparison systems of `maps` are linear in the radii of b, c and v. So what the declared radius
of each entry adds to a radius is computed once for a step length, and a row multiplies it by the
part of the declared radius that its own bounds leave. Parts are further inputs of a kernel, of
which the column is zero but for an error: that much, of any sign. The middle of b and c is an
input as well; that of v is taken from the measurement.

    inputs of a step    u, shift of the middle of b, parts of b, of v at the start, at the end, 1
    inputs of a jump    w, shift of the middle of c, parts of c, of v, 1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.bounds import Bounds, DeclaredBounds, DeclaredBox, Pair, declared_noise
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import Cuts, kernel
from obsdesign.runtime.interval.maps import BoxMap, jump_maps, step_maps
from obsdesign.runtime.interval.model import Model, exactly, shapes
from obsdesign.runtime.interval.state import HeldBounds, IntervalState
from obsdesign.runtime.interval.step_cells import StepCells
from obsdesign.runtime.interval.step_kernels import KernelsOfStep, StepKernels

NO_PARTS = np.zeros(0)


class Row(NamedTuple):
    """How kernels take a row: with the declared bounds, or with its own.

    u: inputs of the step to it; y: its measurement less the shift of the middle of v, measured: as
    it came; parts: inputs of its jump after w; held: what the next step needs, None as declared.
    """

    kernels: StepKernels
    u: Matrix
    y: Matrix | None
    measured: Matrix | None
    parts: Matrix
    held: HeldBounds | None


def declared_bounds(gains: IntervalGains) -> DeclaredBounds:
    """Declared bounds of a design: those that bounds of a row must not exceed."""
    c = None if gains.G is None else DeclaredBox("c", *gains.jump_disturbance[1:])
    b = DeclaredBox("b", *gains.declared_disturbance[1:])
    return DeclaredBounds(b, c, declared_noise(gains.noise_bound, gains.noise_centre))


class VaryingKernels(StepKernels):
    """Kernels of steps and jumps with parts of the declared radii as further inputs."""

    def __init__(self, declared: StepKernels) -> None:
        super().__init__(declared.gains)
        self._declared = declared
        self.bounds = declared_bounds(self.gains)

    @property
    def declared(self) -> StepKernels:
        """Kernels for the declared bounds of b, c and v."""
        return self._declared

    def row(self, state: IntervalState, own: Bounds | None, y: Matrix | None) -> Row:
        """A row with bounds `own` after one that holds some, or none.

        ValueError where bounds are not inside the declared ones.
        """
        own = Bounds() if own is None else own
        b, v = declared = self._declared_parts
        used, c = y, self._no_shift_of_c
        if own.b is not None:
            b = _parts(self.bounds.b, own.b, self._middles[0])
        if own.v is not None:
            v, used = self._of_measurement(own.v, y)
        if own.c is not None:
            if self.bounds.c is None:
                raise ValueError(
                    "bounds of c need jumps, but this plant has none ([jump] is absent)."
                )
            c = _parts(self.bounds.c, own.c, self._middles[1])
        pairs = ((b, declared.b), (v, declared.v))
        holds = any(ours is not theirs and (ours != theirs).any() for ours, theirs in pairs)
        if state.bounds is None and not holds and (c == self._no_shift_of_c).all():
            return Row(self.declared, state.u, y, y, NO_PARTS, None)
        held = state.bounds or declared
        u = np.concatenate([state.u, held.b, held.v, v])
        parts = np.concatenate([c, v]) if c.size else c
        return Row(self, u, used, y, parts, HeldBounds(b, v) if holds else None)

    @cached_property
    def _declared_parts(self) -> HeldBounds:
        """No shift, and all of the declared radii."""
        entries = len(self._middles[0][0])
        return HeldBounds(np.repeat([0.0, 1.0], entries), np.ones(self.gains.p))

    @cached_property
    def _no_shift_of_c(self) -> Matrix:
        """The same of c; empty without jumps."""
        return (
            NO_PARTS if self.bounds.c is None else np.repeat([0.0, 1.0], len(self.bounds.c.lower))
        )

    def _of_measurement(self, pair: Pair | None, y: Matrix | None) -> tuple[Matrix, Matrix | None]:
        """(parts of the noise's radii, y less the shift of its middle)."""
        shift, radius, full = _shifted(self.bounds.v, pair, self._middles[2])
        if y is None:
            return _ratio(radius, full), None
        used = y - shift  # rounded where there is a shift
        radius = np.where(shift == 0.0, radius, raised(radius + UNIT * np.abs(used), 2))
        return _ratio(radius, full), used

    @cached_property
    def _middles(self) -> tuple[tuple[Matrix, Matrix], ...]:
        """(middle, radius) of b, of c and of v, as the declared kernels have them."""
        gains, n = self.gains, self.gains.n
        c = (np.zeros(n), np.zeros(n)) if gains.G is None else midpoint(*gains.jump_disturbance[1:])
        b = midpoint(*gains.declared_disturbance[1:])
        return b, c, (self.declared.model.y_mid, gains.noise_bound)

    @cached_property
    def _shapes(self) -> tuple[Enclosure | None, Enclosure | None]:
        """Columns of b and of c, None where the bounds are those of b and c."""
        return shapes(self.gains)

    @property
    def cells(self) -> StepCells | None:
        """None: rows with bounds of their own have kernels for each length."""
        return None

    @cached_property
    def model(self) -> Model:
        """The plant without radii of disturbances and noise, with shifts of b and c as inputs."""
        model, b, c = self.declared.model, *self._shapes
        identity = exactly(np.eye(self.gains.n))
        return replace(
            model,
            inputs=_before_last(model.inputs, model.inward(identity if b is None else b)),
            jump_inputs=_before_last(model.jump_inputs, identity if c is None else c),
            b_rad=np.zeros_like(model.b_rad), c_rad=np.zeros_like(model.c_rad),
            V=np.zeros(self.gains.p),
        )  # fmt: skip

    @cached_property
    def _models(self) -> tuple[tuple[Model | None, ...], ...]:
        """For each entry of b, c and v the model with its declared radius alone; None if zero."""
        model, shape = self.model, self._shapes[0]
        b, c, v = (np.diag(radius) for _, radius in self._middles)
        return (
            tuple(
                replace(model, b_rad=model.spread(row, shape)) if row.any() else None for row in b
            ),
            tuple(replace(model, c_rad=row) if row.any() else None for row in c),
            tuple(replace(model, V=row) if row.any() else None for row in v),
        )

    def built(self, h: float, h_error: float) -> KernelsOfStep:
        """Kernels of a length of its own, h >= 0, known up to h_error."""
        b, _, v = self._models
        maps, *of_entries = (
            None if model is None
            else step_maps(model, h, h_error, is_periodic=self.is_periodic)
            for model in (self.model, *b, *v)
        )  # fmt: skip
        assert maps is not None
        widened = {}
        for name, step in maps.items():
            added = [None if each is None else each[name].g for each in of_entries]
            of_b, of_v = added[: len(b)], added[len(b) :]
            unused = [None] * len(of_v)
            ends = [*of_v, *unused] if name == "start" else [*unused, *of_v]
            widened[name] = _with_parts(step, [*of_b, *ends])
        return KernelsOfStep(widened.__getitem__, lambda name: self._kernel(name, widened))

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Kernels of a jump: with the correction M (y - C x), and without."""
        _, c, v = self._models
        maps, *of_entries = (
            None if model is None else jump_maps(model, self.gains)
            for model in (self.model, *c, *v)
        )
        assert maps is not None
        widened = {
            corrected: _with_parts(
                step, [None if each is None else each[corrected].g for each in of_entries]
            )
            for corrected, step in maps.items()
        }
        return self._of_jump(self.model, widened)

    def _is_known_from_strip(self, start: BoxMap, free: BoxMap) -> bool:
        return False

    def _with_cuts(self, model: Model, step: BoxMap, cuts: Cuts) -> Kernel:
        return kernel(model, step, self.gains.C, cuts, noise=self.gains.noise_bound)


def _parts(declared: DeclaredBox, pair: Pair | None, middle: tuple[Matrix, Matrix]) -> Matrix:
    """[shift of the middle; part of the declared radius], (2n,)."""
    shift, radius, full = _shifted(declared, pair, middle)
    return np.concatenate([shift, _ratio(radius, full)])


def _shifted(
    declared: DeclaredBox, pair: Pair | None, middle: tuple[Matrix, Matrix]
) -> tuple[Matrix, Matrix, Matrix]:
    """(shift, radius, declared radius): all values are within radius of declared middle + shift."""
    lower, upper = declared.completed(pair)
    centre, full = middle
    shift = lower + (0.5 * upper - 0.5 * lower) - centre
    reach = np.maximum(upper - centre - shift, centre + shift - lower)
    rounding = 8 * UNIT * (np.abs(lower) + np.abs(upper) + np.abs(centre) + np.abs(shift))
    radius = raised(np.maximum(reach, 0.0) + rounding, 4)
    same = (lower == declared.lower) & (upper == declared.upper)
    return np.where(same, 0.0, shift), np.where(same, full, radius), full


def _ratio(radius: Matrix, full: Matrix) -> Matrix:
    """radius / full rounded up, 1 where they are equal."""
    same = radius == full
    parts: Matrix = np.nextafter(radius / np.where(same | (full == 0.0), 1.0, full), np.inf)
    return np.where(same, 1.0, parts)


def _before_last(known: Enclosure, more: Enclosure) -> Enclosure:
    """Columns before the last one, that of the input 1."""
    pairs = ((known.mid, more.mid), (known.rad, more.rad))
    return Enclosure(*(np.hstack([all_[:, :-1], new, all_[:, -1:]]) for all_, new in pairs))


def _with_parts(step: BoxMap, added: Sequence[Matrix | None]) -> BoxMap:
    """The map with an input for each entry: an error of up to what the entry adds to the radius."""
    zero = np.zeros(len(step.g))
    radii = np.column_stack([zero if column is None else column for column in added])
    return replace(step, X=_before_last(step.X, Enclosure(np.zeros_like(radii), radii)))
