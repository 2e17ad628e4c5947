"""What the claims of an uncertain plant are about: a certain one, in a box of the state."""

from __future__ import annotations

from dataclasses import dataclass

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from obsdesign.analysis.folded import Folded, folded, nominal
from obsdesign.analysis.interval.requirements import reason_against_parameters
from obsdesign.document import Claim
from obsdesign.errors import DoesNotApply
from obsdesign.problem.problem import Problem
from obsdesign.verification.assumptions import STATE_BOX
from obsdesign.verification.consistency import inconsistent
from obsdesign.verification.state_box import state_box


@dataclass(frozen=True)
class CertainPlant:
    """What claims of a plant are about.

    problem: without parameters; entries: what a design stores of them; claims: on the box; failed:
    the claims where there is no such problem, else empty; is_bounded: do its bounds include the
    effects of parameters?
    """

    problem: Problem
    entries: Entries
    claims: tuple[Claim, ...] = ()
    failed: tuple[Claim, ...] = ()
    is_bounded: bool = True


def certain_plant(problem: Problem, certificates: EntriesByClaim) -> CertainPlant:
    """The problem itself where it has no parameters, else with their effects in its bounds.

    certificates: {"state_box": tube} where the box is not stated; it is proved.
    """
    if not problem.plant.parameters:
        return CertainPlant(problem, {})
    if reason := reason_against_parameters(problem):
        return CertainPlant(problem, {}, failed=(inconsistent(reason),))
    try:
        claims, bounds = state_box(problem.plant, certificates.get(STATE_BOX, {}))
        if bounds is None and problem.plant.output.measured != "periodic":
            return CertainPlant(*nominal(problem), is_bounded=False)
        if bounds is None:
            reason = "[state] is missing, and the design holds no box that could be proved"
            return CertainPlant(problem, {}, failed=(inconsistent(reason),))
        certain: Folded = folded(problem, bounds)
    except DoesNotApply as error:
        return CertainPlant(problem, {}, failed=(inconsistent(str(error)),))
    return CertainPlant(certain.problem, certain.entries, claims)
