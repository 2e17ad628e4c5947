"""Uncertain plants for `set_membership`: the nominal problem, and effects of all parameters."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY
from obsdesign.analysis.nominal import NominalProblem, nominal_problem
from obsdesign.analysis.widened import StateBounds, widened
from obsdesign.equations.parameters import (
    EffectGains,
    NormalForm,
    fractions_of,
    largest_in_box,
    rounded_up,
)
from obsdesign.equations.set_membership.effects import Factors
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem


def in_box(problem: Problem, bounds: StateBounds | None) -> NominalProblem:
    """The nominal problem and the entries of parameters; the problem itself without any.

    bounds: of x, None where none are known. DoesNotApply for a rate of an unknown input beside
    parameters, or an uncertain input without a bound where x has one.
    """
    plant = problem.plant
    if not plant.parameters:
        return NominalProblem(problem)
    if plant.flow.d_bounds is not None and plant.flow.d_bounds.rate is not None:
        raise DoesNotApply(
            "flow.d_bounds.rate is not available with parameters for kind 'set_membership'; leave "
            "it out.",
            "flow.d_bounds",
        )
    form = NormalForm.from_plant(plant)
    own = nominal_problem(problem)
    effects = [EffectGains.from_effect(effect) for effect in form.effects]
    entries: dict[str, object] = {"effects": [effect.to_document() for effect in effects]}
    if roundings := form.roundings():
        entries["rounding"] = [
            EffectGains.from_effect(effect).to_document() for effect in roundings
        ]
    if bounds is None:
        return NominalProblem(own, entries, is_bounded=False)
    wider = widened(problem, bounds)
    entries |= {"state_lower": bounds.lower, "state_upper": bounds.upper}
    if bounds.tube is not None:
        entries |= {"state_tube": bounds.tube}
    entries |= {name: most for name, most in wider.inputs.items() if most is not None}
    gains = SetMembershipGains.from_plant(own.plant, window=1, steps=1, **entries)
    box = (bounds.lower, bounds.upper)
    of_flow = _largest(gains.flow_factors, box, plant.flow.input_bound)
    entries |= {"flow_effect": of_flow, "output_effect": wider.output}
    if plant.jump is not None:
        box = (bounds.lower_before_jump, bounds.upper_before_jump)
        of_jump = _largest(gains.jump_factors, box, plant.jump.input_bound)
        entries |= {"jump_effect": of_jump}
    return NominalProblem(own, entries)


def with_all_noise(gains: SetMembershipGains) -> SetMembershipGains:
    """Gains for claims about widths: the noise includes what parameters add to y in the box."""
    if gains.output_effect is None:
        return gains
    pairs = zip(gains.noise_bound.tolist(), gains.output_effect.tolist(), strict=True)
    bound = np.array([rounded_up(Fraction(V) + Fraction(d)) for V, d in pairs])
    return replace(gains, noise_bound=bound)


def _largest(factors: Factors, box: tuple[Matrix, Matrix], inputs: Matrix | None) -> Matrix:
    """Bounds of w of each column over the box, rounded up; positive, since inputs may be larger."""
    lower, upper = map(fractions_of, box)
    rows, n = fractions_of(factors.rows), len(lower)
    known = np.zeros(rows.shape[1] - n) if inputs is None else inputs
    sizes = largest_in_box(rows[:, :n], lower, upper)
    sizes = sizes + abs(rows[:, n:]) @ fractions_of(known)
    totals = fractions_of(factors.of_column) @ sizes
    return np.array([max(rounded_up(Fraction(total)), TINY) for total in totals.tolist()])
