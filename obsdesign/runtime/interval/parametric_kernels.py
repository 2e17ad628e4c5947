"""Kernels of an interval observer of a plant with parameters.

A drive |F v| is an input of a kernel whose column is zero but for an error, the weight of the
drive: so much, of any sign. Forms are multiplied first, from the same v (`Kernel.fill_drives`);
what their rounding and the errors of F may add, times the weights, is an error of other columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from obsdesign.equations.interval.certain_bounds import without_effects
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.runtime.boxes import midpoint
from obsdesign.runtime.interval.drives import Drives, FormTable, Radius, common_forms, spread_out
from obsdesign.runtime.interval.effects import Effects, effects_of
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.kernel_rows import (
    Bounded,
    Contained,
    Cuts,
    Rows,
    kernel_of_rows,
    measurement,
)
from obsdesign.runtime.interval.maps import BoxMap, jump_maps, step_maps
from obsdesign.runtime.interval.model import Model, exactly, observer_model, rounded
from obsdesign.runtime.interval.parametric_jumps import parametric_jump_maps
from obsdesign.runtime.interval.parametric_steps import parametric_step_maps
from obsdesign.runtime.interval.step_cells import StepCells
from obsdesign.runtime.interval.step_kernels import KernelsOfStep, StepKernels

# a map, and what else contains the state
Choice = tuple[BoxMap, Cuts]


class ParametricKernels(StepKernels):
    """Kernels whose radii follow the effect that parameters have on the estimate.

    Where the state has known bounds, effects are bounded too, and the bounds of b, c and v of
    `model` include them: its boxes, those of a plant that is certain, cut the others.
    """

    @cached_property
    def own_gains(self) -> IntervalGains:
        """The gains with bounds of b, c and v alone, without effects."""
        return without_effects(self.gains)

    @cached_property
    def own_model(self) -> Model:
        """The nominal plant with those bounds, enclosed: its stored numbers are rounded."""
        with np.errstate(over="ignore", invalid="ignore"):
            return observer_model(self.own_gains, relative_error=UNIT)

    @cached_property
    def effects(self) -> Effects:
        """What parameters add, in the observer's coordinates."""
        return effects_of(self.gains, self.own_model)

    @property
    def cells(self) -> StepCells | None:
        """None: radii that follow effects have kernels for each length."""
        return None

    @property
    def keeps_course(self) -> bool:
        """Are whole steps made too? Of boxes in known bounds of the state alone."""
        return super().keeps_course and self._has_state_bounds

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Kernels of a jump: with the correction M (y - C x), and without."""
        own = parametric_jump_maps(self.own_model, self.effects, self.own_gains)
        bounded = jump_maps(self.model, self.gains)
        return {
            corrected: self._driven(
                self._chosen_at_jump(corrected, own), self._chosen_at_jump(corrected, bounded)
            )
            for corrected in own
        }

    def built(self, h: float, h_error: float) -> KernelsOfStep:
        """Kernels of a length of its own, h >= 0, known up to h_error."""
        with np.errstate(over="ignore", invalid="ignore"):
            own = parametric_step_maps(
                self.own_model, self.effects, h, h_error, is_periodic=self.is_periodic
            )
            bounded = own
            if self._has_state_bounds:
                bounded = step_maps(self.model, h, h_error, is_periodic=self.is_periodic)
        return KernelsOfStep(
            bounded.__getitem__,
            lambda name: self._driven(self._chosen(name, own), self._chosen(name, bounded)),
        )

    def _is_known_from_strip(self, start: BoxMap, free: BoxMap) -> bool:
        return False

    @property
    def _has_state_bounds(self) -> bool:
        return self.gains.state_lower is not None

    def _state_rows(self, columns: int) -> Rows | None:
        """The known bounds of x as rows of a kernel, None without any."""
        lower, upper = self.gains.state_lower, self.gains.state_upper
        if lower is None or upper is None:
            return None
        centre, radius = midpoint(lower, upper)
        X = np.zeros((len(centre), columns))
        X[:, -1] = centre
        return Rows(exactly(X), np.zeros((len(centre), len(centre))), radius)

    def _driven(self, own: Choice, bounded: Choice) -> Kernel:
        """The kernel of a map, cut with all others; bounded: those of known bounds of the state."""
        choices, V = [own], self.model.V
        if self._has_state_bounds:
            step, cuts = bounded
            others = ([undriven(each, V) for each in maps] for maps in (cuts.boxes, cuts.strips))
            choices.append((undriven(step, V), Cuts(*others)))
        listed = [_listed(*each) for each in choices]
        table, rows = driven_rows([each for boxes, strips in listed for each in (*boxes, *strips)])
        groups = []
        for boxes, strips in listed:
            groups.append((rows[: len(boxes)], rows[len(boxes) : len(boxes) + len(strips)]))
            rows = rows[len(boxes) + len(strips) :]
        model, columns = self.own_model, groups[0][0][0].states.X.mid.shape[1]
        known = self._state_rows(columns)
        chosen = kernel_of_rows(
            model, rounded(self.gains.C, model.relative_error), *groups[0],
            measurement(model, columns), None if known is None else Bounded(*groups[1], known),
        )  # fmt: skip
        return replace(chosen, forms=_signed(table.forms, chosen)) if len(table) else chosen


def _listed(step: BoxMap, cuts: Cuts) -> tuple[list[BoxMap], list[BoxMap]]:
    """All boxes of a kernel, its step first, and all strips."""
    return [step, *(each for each in cuts.boxes if each is not step)], [*cuts.strips]


def kernels_of(gains: IntervalGains) -> StepKernels:
    """The kernels of a design."""
    return ParametricKernels(gains) if gains.is_uncertain else StepKernels(gains)


def driven_rows(maps: Sequence[BoxMap]) -> tuple[FormTable, list[Contained]]:
    """States and the noise of a sample for each map, with all forms of them as further inputs."""
    columns = maps[0].X.mid.shape[1]
    drives = [each for step in maps for each in _drives(step)]
    table, places = common_forms(drives, columns)
    forms = table.forms
    terms = 4 * (columns + len(table)) + 8
    error = forms.rad + terms * UNIT * np.abs(forms.mid)
    weights = [
        spread_out(each.weights, own, len(table)) for each, own in zip(drives, places, strict=True)
    ]
    rows = []
    for step, of_states, of_sample in zip(maps, weights[::2], weights[1::2], strict=True):
        assert step.sample is not None
        blank = exactly(np.zeros((len(step.sample.g), columns)))
        rows.append(
            Contained(
                Rows(_with_weights(step.X, of_states, error), step.R, step.g),
                Rows(_with_weights(blank, of_sample, error), step.sample.R, step.sample.g),
            )
        )
    return table, rows


def undriven(step: BoxMap, V: Matrix) -> BoxMap:
    """A map of a plant that is certain, whose samples err by V."""
    n, columns = step.X.mid.shape
    sample = Radius(np.zeros((len(V), n)), V, Drives.none(len(V), columns))
    return replace(step, drives=Drives.none(n, columns), sample=sample)


def _drives(step: BoxMap) -> tuple[Drives, Drives]:
    """Those of the states and of the sample."""
    assert step.drives is not None
    assert step.sample is not None
    return step.drives, step.sample.drives


def _with_weights(X: Enclosure, weights: Matrix, error: Matrix) -> Enclosure:
    """X with the columns of forms before the last; error (forms, columns): of forms, per |v|."""
    terms = 2 * error.size + 8
    rad = raised(X.rad + weights @ error, terms) if weights.any() else X.rad
    mids = (X.mid[:, :-1], np.zeros_like(weights), X.mid[:, -1:])
    return Enclosure(np.hstack(mids), np.hstack([rad[:, :-1], raised(weights, 8), rad[:, -1:]]))


def _signed(forms: Enclosure, kernel: Kernel) -> Matrix:
    """Forms of [m; y0; y1; u; 1] as those of v, in which [lower; -upper] stands for m."""
    n, K = kernel.n, len(forms.mid)
    M, known, last = forms.mid[:, :n], forms.mid[:, n:-1], forms.mid[:, -1:]
    return np.ascontiguousarray(np.hstack([0.5 * M, -0.5 * M, known, np.zeros((K, K)), last]))
