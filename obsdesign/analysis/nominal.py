"""The nominal plant of one with parameters, and the family of its stability by itself."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.arithmetic.balls import exact
from lmi.parameters import MOST_PARAMETERS, AffineFamily
from obsdesign.document import jsonable
from obsdesign.equations.estimation_error import idle_gains
from obsdesign.equations.parameters import NormalForm, rounded
from obsdesign.errors import InputError
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

# entries of blocks that are about parameters alone
_OF_PARAMETERS = {
    "flow": ("A_radius", "input_bound"),
    "jump": ("G_radius", "input_bound"),
    "output": ("C_radius",),
}


@dataclass(frozen=True)
class NominalProblem:
    """A problem without parameters, and what gains hold of those that a stated one has.

    is_bounded: are there none, or do its bounds include their effects in a box of the state?
    """

    problem: Problem
    entries: Entries = field(default_factory=dict)
    is_bounded: bool = True


def nominal_body(problem: Problem, form: NormalForm) -> NewEntries:
    """The problem file with nominal matrices, every parameter in the middle of its range."""
    body = problem.to_dict()
    for block, keys in _OF_PARAMETERS.items():
        body[block] = {key: v for key, v in body.get(block, {}).items() if key not in keys}
    body = {key: own for key, own in body.items() if own and key not in ("parameter", "state")}
    for block, key in (("flow", "A"), ("flow", "B"), ("jump", "G"), ("jump", "E"), ("output", "C")):
        if (values := getattr(form, key)) is not None:
            body[block][key] = rounded(values).tolist()
    return body


def nominal_problem(problem: Problem) -> Problem:
    """The same problem for the nominal plant, rounded to binary64 numbers."""
    body = nominal_body(problem, NormalForm.from_plant(problem.plant))
    return Problem.from_dict(jsonable(body))


def stability_family(plant: Plant) -> AffineFamily:
    """x' = A(p) x, x+ = G(p) x, exact; without jumps G = 0, which leaves the flow to decide.

    InputError where more parameters act on A, or on G, than have corners that can be listed.
    """
    form = NormalForm.from_plant(plant, exact)
    none = exact(np.zeros((plant.n, plant.n)))
    flows = [form.A] + [none if each.A is None else each.A for each in form.effects]
    jumps = [none if form.G is None else form.G]
    jumps += [none if each.G is None else each.G for each in form.effects]
    constant = tuple(each.constant for each in form.effects)
    family = AffineFamily(np.array(flows), np.array(jumps), constant)
    try:
        family.flow_vertices(), family.jump_vertices()
    except ValueError:
        raise InputError(
            f"parameter: at most {MOST_PARAMETERS} may act on flow.A, and on jump.G, where "
            f"stability is to be proved; the plant has {len(plant.parameters)}."
        ) from None
    return family


def stability_dwell(problem: Problem) -> tuple[float, float]:
    """The dwell times of that family: without jumps a flow that lasts."""
    return (0.0, np.inf) if problem.plant.jump is None else problem.require_dwell_time()


def reason_against_options(problem: Problem) -> str | None:
    """Reason against options of a point observer that parameters exclude, or None."""
    options = problem.options_as(LuenbergerOptions)
    if options.decay_rate > 0:
        return (
            "observer.decay_rate is not available with parameters: the error decays no faster than "
            "what the state adds to it."
        )
    if options.schedule is not None:
        return (
            "observer.schedule is not available with parameters: what they add to the error is "
            "bounded for one M alone; leave it out."
        )
    return None


def counted_inputs(plant: Plant) -> NewEntries:
    """Bounds of known inputs that bounds of an error count on, under their names in a design."""
    if not plant.parameters:
        return {}
    stated = {
        "input_bound": plant.flow.input_bound,
        "jump_input_bound": None if plant.jump is None else plant.jump.input_bound,
    }
    return {name: bound for name, bound in stated.items() if bound is not None}


def concerns_plant_alone(problem: Problem) -> bool:
    """Does the problem fix both gains to zero: is the stability of the plant all it is about?"""
    idle = idle_gains(problem.plant)
    return all(
        name in idle or (name in problem.gains and not np.any(problem.gains[name]))
        for name in ("L", "M")
    )
