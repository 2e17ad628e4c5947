"""An uncertain plant as a certain one with more disturbance and more noise.

Where x stays in a known box, what a parameter adds is bounded: x' = A x + B u + b~ with the nominal
A, B and |b~ - b| <= sum |A_i x + B_i u|, x+ and y likewise. Each claim about the nominal plant with
these bounds then holds for the uncertain one, whatever the parameters do inside their ranges.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix, NewEntries, Value
from obsdesign.analysis.nominal import NominalProblem, nominal_body, nominal_problem
from obsdesign.document import jsonable
from obsdesign.equations.interval.splits import absolute_metzler
from obsdesign.equations.parameters import (
    EffectGains,
    KnownSizes,
    NormalForm,
    effect_sizes,
    fractions_of,
    rounded_up,
)
from obsdesign.equations.plant import Plant as PlantNumbers
from obsdesign.errors import DoesNotApply
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem


@dataclass(frozen=True)
class StateBounds:
    """lower <= x <= upper (n,) at every instant, and just before jumps; floats.

    tube (n,): of a box that was proved: it holds once |x| <= tube, just after a jump if there are
    any. None of one that is stated.
    """

    lower: Matrix
    upper: Matrix
    lower_before_jump: Matrix
    upper_before_jump: Matrix
    tube: Matrix | None = None

    @staticmethod
    def stated(plant: Plant) -> StateBounds | None:
        """The box [state] of a plant, None where there is none."""
        if plant.state is None:
            return None
        lower, upper = plant.state.lower, plant.state.upper
        return StateBounds(lower, upper, lower, upper)

    @staticmethod
    def proved(tube: Matrix, always: Matrix, before_jump: Matrix) -> StateBounds:
        """|x| <= always, |x| <= before_jump just before jumps, once |x| <= tube."""
        return StateBounds(-always, always, -before_jump, before_jump, tube)


@dataclass(frozen=True)
class Widened:
    """A problem without parameters, and what it has taken into its bounds.

    flow, jump (n,), output (p,): what parameters add to x', x+ and y at most, rounded up; inputs:
    bounds of known inputs that this counts on, under their names in a design.
    """

    problem: Problem
    bounds: StateBounds
    flow: Matrix
    jump: Matrix
    output: Matrix
    effects: tuple[EffectGains, ...]
    inputs: Mapping[str, Matrix | None]

    @property
    def nominal(self) -> NominalProblem:
        """The problem without parameters, and what a design stores of them."""
        return NominalProblem(self.problem, self.entries)

    @property
    def entries(self) -> NewEntries:
        """What a design stores of the parameters."""
        entries: NewEntries = {
            "effects": [effect.to_document() for effect in self.effects],
            "flow_effect": self.flow,
            "output_effect": self.output,
            "state_lower": self.bounds.lower,
            "state_upper": self.bounds.upper,
        }
        if self.bounds.tube is not None:
            entries |= {"state_tube": self.bounds.tube}
        if self.problem.plant.jump is not None:
            entries |= {
                "jump_effect": self.jump,
                "pre_jump_lower": self.bounds.lower_before_jump,
                "pre_jump_upper": self.bounds.upper_before_jump,
            }
        return entries | {key: own for key, own in self.inputs.items() if own is not None}


def widened(problem: Problem, bounds: StateBounds) -> Widened:
    """The problem with the nominal plant, its bounds widened by the effects of all parameters.

    DoesNotApply where a known input is uncertain and has no bound.
    """
    plant = problem.plant
    require_input_bounds(plant)
    form = NormalForm.from_plant(plant)
    sizes = effect_sizes(form, _known(plant, bounds))
    flow, jump_size, output = (np.array([rounded_up(v) for v in size]) for size in sizes)
    stored = tuple(map(EffectGains.from_effect, form.effects))
    jump = plant.jump
    inputs = {
        "input_bound": plant.flow.input_bound,
        "jump_input_bound": None if jump is None else jump.input_bound,
    }
    return Widened(
        _with_effects(problem, form, sizes), bounds, flow, jump_size, output, stored, inputs
    )


def without_box(problem: Problem) -> NominalProblem:
    """The nominal problem with bounds as stated, and what a design stores besides."""
    form = NormalForm.from_plant(problem.plant)
    effects = [EffectGains.from_effect(effect).to_document() for effect in form.effects]
    return NominalProblem(nominal_problem(problem), {"effects": effects}, is_bounded=False)


def _with_effects(problem: Problem, form: NormalForm, sizes: tuple[Array, Array, Array]) -> Problem:
    """The problem with nominal matrices, bounds widened by these sizes, without parameters."""
    body = nominal_body(problem, form)
    _widen(body["flow"], sizes[0])
    if "jump" in body:
        _widen(body["jump"], sizes[1])
    if "noise_bound" in body["output"]:
        body["output"]["noise_bound"] = _widened_noise(body["output"]["noise_bound"], sizes[2])
    return Problem.from_dict(jsonable(body))


def require_input_bounds(plant: Plant) -> None:
    """DoesNotApply where a parameter acts on a known input without an input_bound."""
    blocks = {"B": ("flow", plant.flow), "E": ("jump", plant.jump)}
    for parameter in plant.parameters:
        for key in parameter.effects:
            name, block = blocks.get(key, ("", None))
            if block is not None and block.input_bound is None:
                raise DoesNotApply(
                    f"{name}.input_bound is required by {parameter.entry}.{key}, whose effect it "
                    "bounds; it is missing.",
                    f"{name}.input_bound",
                )


def absolute_plant(
    plant: Plant, lift: Callable[[Matrix], Array]
) -> tuple[Array, Array, Array | None, Array | None]:
    """(W, f, N, h) with |x|' <= W |x| + f, |x+| <= N |x| + h, whatever the parameters; exact.

    N, h: None without jumps. DoesNotApply where a known input has no bound: |x| then has none.
    """
    flow, jump = plant.flow, plant.jump
    for name, block, inputs in (("flow", flow, flow.B), ("jump", jump, jump and jump.E)):
        if block is not None and inputs is not None and block.input_bound is None:
            raise DoesNotApply(f"{name}.input_bound is missing", f"{name}.input_bound")
    form = NormalForm.from_plant(plant, lift)
    W = absolute_metzler(form.A) + _sum(form.on("A"), form.A)
    f = _largest(lift, *flow.b_bounds) + _driven(form, "B", flow.input_bound, lift)
    if jump is None or form.G is None:
        return W, f, None, None
    N = abs(form.G) + _sum(form.on("G"), form.A)
    h = _largest(lift, *jump.c_bounds) + _driven(form, "E", jump.input_bound, lift)
    return W, f, N, h


def _sum(effects: tuple[Array, ...], like: Array) -> Array:
    total = 0 * like
    for values in effects:
        total = total + abs(values)
    return total


def _driven(
    form: NormalForm, key: str, bound: Matrix | None, lift: Callable[[Matrix], Array]
) -> Array:
    """|B| u, B with all its effects; zeros without known inputs."""
    columns = getattr(form, key)
    if columns is None or bound is None:
        return 0 * form.A[:, 0]
    result: Array = (abs(columns) + _sum(form.on(key), columns)) @ lift(bound)
    return result


def _largest(lift: Callable[[Matrix], Array], lower: Matrix, upper: Matrix) -> Array:
    return lift(np.maximum(np.abs(lower), np.abs(upper)))


def _known(plant: PlantNumbers, bounds: StateBounds) -> KnownSizes:
    flow, jump = plant.flow, plant.jump
    before = (fractions_of(bounds.lower_before_jump), fractions_of(bounds.upper_before_jump))
    u = flow.input_bound
    w = None if jump is None else jump.input_bound
    return KnownSizes(
        fractions_of(bounds.lower), fractions_of(bounds.upper), before,
        None if u is None else fractions_of(u), None if w is None else fractions_of(w),
    )  # fmt: skip


def _widen(block: NewEntries, added: Array) -> None:
    """Widen the disturbance of a block by so much to both sides, rounded outward."""
    ends = block["disturbance"]
    lower, upper = fractions_of(ends["lower"]), fractions_of(ends["upper"])
    if "disturbance_matrix" in block:
        affected = np.flatnonzero(added).tolist()
        units = np.eye(len(added))[:, affected]
        block["disturbance_matrix"] = np.hstack([block["disturbance_matrix"], units]).tolist()
        added, zeros = added[affected], fractions_of(np.zeros(len(affected)))
        before = len(lower)
        lower, upper = np.append(lower, zeros), np.append(upper, zeros)
        added = np.append(fractions_of(np.zeros(before)), added)
    block["disturbance"] = {
        "lower": [-rounded_up(value) for value in added - lower],
        "upper": [rounded_up(value) for value in upper + added],
    }


def _widened_noise(stated: Value, added: Array) -> Value:
    """A noise bound widened to both sides, numbers or pairs as stated, rounded up."""
    if np.ndim(stated) < 2:
        return [rounded_up(Fraction(v) + d) for v, d in zip(stated, added, strict=True)]
    return [
        [-rounded_up(d - Fraction(low)), rounded_up(Fraction(high) + d)]
        for (low, high), d in zip(stated, added, strict=True)
    ]
