"""What the claims of an uncertain plant are about: a nominal one, in a box of the state."""

from __future__ import annotations

from lmi.arithmetic.arrays import EntriesByClaim
from obsdesign.analysis.interval.requirements import reason_against_parameters
from obsdesign.analysis.nominal import NominalProblem
from obsdesign.analysis.widened import widened, without_box
from obsdesign.document import Claim
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.verification.assumptions import STATE_BOX
from obsdesign.verification.consistency import inconsistent
from obsdesign.verification.state_box import state_box


def nominal_in_box(
    problem: Problem, certificates: EntriesByClaim
) -> tuple[NominalProblem | None, tuple[Claim, ...]]:
    """The problem itself where it has no parameters, else with their effects in its bounds.

    And the claims on the box; None where there is no such problem, the claims are then all.
    certificates: {"state_box": tube} where the box is not stated; it is proved.
    """
    if not problem.plant.parameters:
        return NominalProblem(problem), ()
    if reason := reason_against_parameters(problem):
        return None, (inconsistent(reason),)
    try:
        claims, bounds = state_box(problem.plant, certificates.get(STATE_BOX, {}))
        if bounds is not None:
            return widened(problem, bounds).nominal, claims
    except DoesNotApply as error:
        return None, (inconsistent(str(error)),)
    if problem.plant.output.measured != "periodic":
        return without_box(problem), ()
    reason = "[state] is missing, and the design holds no box that could be proved"
    return None, (inconsistent(reason),)
