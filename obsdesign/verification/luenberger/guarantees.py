"""Guarantees of point observers with jumps, in sentences."""

from __future__ import annotations

from obsdesign.document import Claim, Guarantee
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles, stated_weights
from obsdesign.verification.absent_signals import absent_signals
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.gain_constraints import IDS, constraint_sentences
from obsdesign.verification.luenberger import error_bound
from obsdesign.verification.luenberger.discrete_time import step_guarantees
from obsdesign.verification.luenberger.parameters import uncertain_guarantees, uncertain_warnings
from obsdesign.verification.rates import rates_sentence
from obsdesign.verification.state_widths import StateWidths, errors_of_claim


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those of the problem that are not proved."""
    plant = problem.plant
    if plant.flow.dt is not None:
        return step_guarantees(problem, claims)
    verdicts = {claim.id: claim.verdict for claim in claims}
    own = (stated_poles.ID, stated_weights.ID, *IDS)
    needed = [name for name in verdicts if name not in ("decay_rate", "rates", *own)]
    ends = "" if plant.jump is None else str(Dwell.from_problem(problem))
    when = f" for every sequence of dwell times in {ends}" if ends else ""
    at_jumps = plant.output.measured == "at_jumps"
    measured = "With y measured at every jump" if at_jumps else "With y measured continuously"
    free = absent_signals(plant)
    sentences = [] if plant.parameters else [
        (f"{measured} and without {free}, the estimation error tends to zero{when}.", needed),
        (f"{measured}, bounded {free} leave the estimation error bounded{when}.", needed),
    ]  # fmt: skip
    if "decay_rate" in verdicts:
        rate = problem.options_as(LuenbergerOptions).decay_rate
        sentences.append((f"The error decays like e^(-{rate!r} t){when}.", [*needed, "decay_rate"]))
    sentences += [(f"{measured}: {text}", ids) for text, ids in rates_sentence(claims, "the error")]
    sentences += [
        (f"{claim.statement[0].upper()}{claim.statement[1:]}.", [claim.id])
        for claim in claims
        if claim.id in (stated_poles.ID, stated_weights.ID)
    ]
    sentences += constraint_sentences(claims)
    result = [Guarantee.from_verdicts(text, ids, verdicts) for text, ids in sentences]
    if plant.parameters:
        result = [*uncertain_guarantees(problem, claims, needed, measured, when), *result]
    if not at_jumps:
        sampled = "Convergence for samples at a given spacing is not claimed."
        result.append(Guarantee.not_proved(sampled))
    return tuple(result)


def states(problem: Problem, claims: tuple[Claim, ...]) -> tuple[StateWidths, ...]:
    """Proved bound of the error of each state, of a plant with parameters."""
    return errors_of_claim(problem, claims, error_bound.ID, "always")


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """What is not proved of a plant with parameters."""
    return uncertain_warnings(problem, claims) if problem.plant.parameters else ()
