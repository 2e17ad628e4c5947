"""What drives the error of a point observer: disturbance, noise, parameters; exact columns.

    e' = F e + E d          F = A - L C, A and C nominal
    e+ = H e + K d          at jumps

with |d| <= 1, any course of it. A parameter adds p_i ((A_i - L C_i) x + B_i u) to e': where that
matrix has rank one, along its one direction, else entry by entry; what rounding the nominal
matrices to binary64 leaves out acts in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import Exact, exact, rank_factors
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.analysis.widened import StateBounds, require_input_bounds
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_disturbance_matrix,
    jump_error_matrix,
)
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.parameters import MATRICES, Effect, NormalForm, largest_in_box
from obsdesign.equations.plant import Disturbed
from obsdesign.errors import DoesNotApply
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem


@dataclass(frozen=True)
class DrivenError:
    """F (n, n), E (n, k); H (n, n), K (n, l) at jumps, None without any; exact."""

    F: Exact
    E: Exact
    H: Exact | None = None
    K: Exact | None = None


@dataclass(frozen=True)
class _Box:
    """lower <= z <= upper, exact (q,)."""

    lower: Exact
    upper: Exact

    @staticmethod
    def of_state(lower: Matrix, upper: Matrix) -> _Box:
        return _Box(exact(lower), exact(upper))

    def with_inputs(self, bound: Matrix | None) -> _Box:
        """The box of (x, u), |u| <= bound."""
        if bound is None:
            return self
        u = exact(bound)
        return _Box(np.append(self.lower, -u), np.append(self.upper, u))

    def columns(self, X: Exact) -> Exact:
        """Columns E with X z = E d for some |d| <= 1, whatever z is in the box."""
        directions, rows = rank_factors(X)
        if directions.shape[1] > 1:
            directions, rows = exact(np.eye(len(X))), X.T
        return _driving(directions * largest_in_box(rows.T, self.lower, self.upper))


def driven_error(plant: Plant, gains: LuenbergerGains, bounds: StateBounds | None) -> DrivenError:
    """The driven error of a design; bounds: of x, None where the plant has no parameters.

    Noise counts where noise_bound states it. `reason_against_error_bound` must give none.
    """
    L, C = exact(gains.L), exact(gains.C)
    F = flow_error_matrix(exact(gains.A), L, C)
    form = NormalForm.from_plant(plant, exact)
    flow = [_disturbance(plant.flow, gains.flow_drift), _noise(plant, L)]
    if bounds is not None:
        box = _Box.of_state(bounds.lower, bounds.upper)
        flow += _flow_effects(plant, _effects(form, gains), box, gains)
    if plant.jump is None:
        return DrivenError(F, np.hstack(flow))
    when, M = plant.output.jump_measurement, exact(gains.M)
    H = jump_error_matrix(exact(gains.jump_matrix), M, C, when)
    through = jump_disturbance_matrix(M, C, gains.n, when)
    kicks = [through @ _disturbance(plant.jump, gains.jump_drift), _noise(plant, M)]
    if bounds is not None:
        kicks += _jump_effects(plant, _effects(form, gains), bounds, gains)
    return DrivenError(F, np.hstack(flow), H, np.hstack(kicks))


def reason_against_error_bound(problem: Problem) -> str | None:
    """Reason against any bound of the error of a point observer, or None."""
    try:
        require_input_bounds(problem.plant)
    except DoesNotApply as error:
        return str(error)
    return reason_against_unbounded(problem.plant, "luenberger")


def _flow_effects(
    plant: Plant, effects: tuple[Effect, ...], box: _Box, gains: LuenbergerGains
) -> list[Exact]:
    """Columns of parameters, and of rounding, in e'."""
    columns, L = [], exact(gains.L)
    for effect in effects:
        on_state = _part(effect.A, gains.A) - L @ _part(effect.C, gains.C)
        columns.append(_columns(box, on_state, effect.B, plant.flow.input_bound))
    return columns


def _jump_effects(
    plant: Plant, effects: tuple[Effect, ...], bounds: StateBounds, gains: LuenbergerGains
) -> list[Exact]:
    """Columns of parameters, and of rounding, in e+; p of y and p of the jump may differ."""
    assert plant.jump is not None
    columns, when = list[Exact](), plant.output.jump_measurement
    M = exact(gains.M)
    through = jump_disturbance_matrix(M, exact(gains.C), gains.n, when)
    before = _Box.of_state(bounds.lower_before_jump, bounds.upper_before_jump)
    after = _Box.of_state(bounds.lower, bounds.upper)
    for effect in effects:
        on_jump = _columns(
            before, _part(effect.G, gains.jump_matrix), effect.E, plant.jump.input_bound
        )
        columns.append(through @ on_jump)
        measured = before if when == "before" else after
        columns.append(measured.columns(M @ _part(effect.C, gains.C)))
    return columns


def _columns(box: _Box, on_state: Exact, on_input: Array | None, bound: Matrix | None) -> Exact:
    """Columns of X x + Y u; Y None where the effect does not act on u."""
    if on_input is None:
        return box.columns(on_state)
    return box.with_inputs(bound).columns(np.hstack([on_state, on_input]))


def _effects(form: NormalForm, gains: LuenbergerGains) -> tuple[Effect, ...]:
    """Those of parameters, and what the stored nominal matrices lack of the exact ones."""
    lost: dict[str, Array] = {}
    for key in MATRICES:
        stored = getattr(gains, key)
        if stored is not None and (getattr(form, key) != exact(stored)).any():
            lost[key] = getattr(form, key) - exact(stored)
    return (*form.effects, Effect("rounding", True, **lost))


def _part(values: Array | None, like: Array) -> Array:
    return exact(np.zeros(like.shape)) if values is None else values


def _disturbance(block: Disturbed, drift: Matrix) -> Exact:
    """Columns of b less the float that the observer takes for its middle."""
    columns, lower, upper = (exact(values) for values in block.shaped_disturbance)
    beside = columns @ ((lower + upper) / 2) - exact(drift)
    return _driving(np.hstack([columns * ((upper - lower) / 2), beside[:, None]]))


def _noise(plant: Plant, gain: Exact) -> Exact:
    """Columns of noise by way of a gain (n, p); none where no bound is stated."""
    radius = plant.output.noise_radius
    return _driving(gain * exact(np.zeros(gain.shape[1]) if radius is None else radius))


def _driving(columns: Exact) -> Exact:
    """The columns that are not zero."""
    kept: Exact = columns[:, [bool((column != 0).any()) for column in columns.T]]
    return kept
