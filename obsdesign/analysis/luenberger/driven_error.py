"""What drives the error of a point observer: disturbance, noise, parameters; exact columns.

    e' = F e + E d          F = A - L C, A and C nominal
    e+ = H e + K d          at jumps

with |d| <= 1, any course of it. A parameter adds p_i ((A_i - L C_i) x + B_i u) to e', a column for
each entry of x and u in its box, and one for the middle of the box; what rounding the nominal
matrices to binary64 leaves out acts in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.balls import Exact, Rational, exact
from obsdesign.analysis.unbounded_inputs import reason_against_unbounded
from obsdesign.analysis.widened import StateBounds, require_input_bounds
from obsdesign.equations.estimation_error import (
    flow_error_matrix,
    jump_disturbance_matrix,
    jump_error_matrix,
)
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.equations.parameters import MATRICES, Effect, NormalForm
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
        middle, radius = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2
        return np.hstack([(X @ middle)[:, None], X * radius])


@dataclass(frozen=True)
class Drive:
    """What acts on e but noise: E = flow - L output, K = (I - ..) jump - M sampled; exact.

    flow (n, k), output (p, k); jump (n, l), sampled (p, l), None without jumps.
    """

    flow: Exact
    output: Exact
    jump: Exact | None = None
    sampled: Exact | None = None

    @staticmethod
    def from_plant(plant: Plant, gains: LuenbergerGains, bounds: StateBounds | None) -> Drive:
        """Whatever L and M are; gains: the stored nominal plant, bounds: None without parameters.

        `reason_against_error_bound` must give none.
        """
        effects = () if bounds is None else _effects(NormalForm.from_plant(plant, exact), gains)
        flow = [_with_zeros(_disturbance(plant.flow, gains.flow_drift), gains.p)]
        jump = list[Exact]()
        if bounds is not None:
            box = _Box.of_state(bounds.lower, bounds.upper)
            flow += _flow_effects(plant, effects, box, gains)
        if plant.jump is not None:
            jump = [_with_zeros(_disturbance(plant.jump, gains.jump_drift), gains.p)]
        if plant.jump is not None and bounds is not None:
            jump += _jump_effects(plant, effects, bounds, gains)
        parts = np.split(np.hstack(flow), [gains.n])
        return Drive(*parts, *(np.split(np.hstack(jump), [gains.n]) if jump else ()))


def driven_error(plant: Plant, gains: LuenbergerGains, bounds: StateBounds | None) -> DrivenError:
    """The driven error of a design; bounds: of x, None where the plant has no parameters.

    Noise counts where noise_bound states it. `reason_against_error_bound` must give none.
    """
    L, C, M = exact(gains.L), exact(gains.C), exact(gains.M)
    F = flow_error_matrix(exact(gains.A), L, C)
    drive = Drive.from_plant(plant, gains, bounds)
    E = _driving(np.hstack([drive.flow - L @ drive.output, _noise(plant, L)]))
    if drive.jump is None or drive.sampled is None:
        return DrivenError(F, E)
    when = plant.output.jump_measurement
    H = jump_error_matrix(exact(gains.jump_matrix), M, C, when)
    through = jump_disturbance_matrix(M, C, gains.n, when)
    K = np.hstack([through @ drive.jump - M @ drive.sampled, _noise(plant, M)])
    return DrivenError(F, E, H, _driving(K))


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
    """Columns of parameters, and of rounding, in e', above those in y: p is the same."""
    columns = []
    for effect in effects:
        on_state = np.vstack([_part(effect.A, gains.A), _part(effect.C, gains.C)])
        on_input = None if effect.B is None else _with_zeros(effect.B, gains.p)
        columns.append(_columns(box, on_state, on_input, plant.flow.input_bound))
    return columns


def _jump_effects(
    plant: Plant, effects: tuple[Effect, ...], bounds: StateBounds, gains: LuenbergerGains
) -> list[Exact]:
    """Columns of parameters, and of rounding, in e+ and y; p of y and p of the jump may differ."""
    assert plant.jump is not None
    columns, when = list[Exact](), plant.output.jump_measurement
    before = _Box.of_state(bounds.lower_before_jump, bounds.upper_before_jump)
    after = _Box.of_state(bounds.lower, bounds.upper)
    for effect in effects:
        on_jump = _columns(
            before, _part(effect.G, gains.jump_matrix), effect.E, plant.jump.input_bound
        )
        on_output = (before if when == "before" else after).columns(_part(effect.C, gains.C))
        none = exact(np.zeros((gains.n, on_output.shape[1])))
        columns += [_with_zeros(on_jump, gains.p), np.vstack([none, on_output])]
    return columns


def _columns(box: _Box, on_state: Exact, on_input: Array | None, bound: Matrix | None) -> Exact:
    """Columns of X x + Y u; Y None where the effect does not act on u."""
    if on_input is None:
        return box.columns(on_state)
    return box.with_inputs(bound).columns(np.hstack([on_state, on_input]))


def _with_zeros(columns: Exact, count: int) -> Exact:
    """The columns above so many zero rows."""
    return np.vstack([columns, exact(np.zeros((count, columns.shape[1])))])


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
    return np.hstack([columns * ((upper - lower) / 2), beside[:, None]])


def _noise(plant: Plant, gain: Exact) -> Exact:
    """Columns of noise by way of a gain (n, p); zero where no bound is stated."""
    radius = plant.output.noise_radius
    return np.asarray(gain * exact(np.zeros(gain.shape[1]) if radius is None else radius))


def _driving(columns: Exact) -> Exact:
    """The columns that are not zero, those of the same direction in one: equal sums of |X E| 1."""
    sizes: dict[tuple[Rational, ...], Rational] = {}
    for column in columns.T:
        pivot = next((value for value in column if value != 0), None)
        if pivot is not None:
            direction = tuple(column / pivot)
            sizes[direction] = sizes.get(direction, 0) + abs(pivot)
    listed = [np.array(direction) * size for direction, size in sizes.items()]
    return np.array(listed, dtype=object).reshape(len(sizes), len(columns)).T
