"""Candidates for uncertain plants: those of the nominal plant with wider bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim
from lmi.arithmetic.balls import exact
from lmi.solvers import Solvers, merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.folded import StateBounds, absolute_plant, folded, nominal
from obsdesign.analysis.interval.requirements import reason_against_parameters
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.interval.corrections import corrections
from obsdesign.synthesis.interval.sourced_width import with_sources
from obsdesign.synthesis.interval.tube import proved_width, solvers_of_tube


@dataclass(frozen=True)
class CertainProblem:
    """A problem without parameters, and what its candidates have besides.

    stated: the problem itself; entries: of the gains; certificates: of the box, None where the
    state has no known bounds; solvers: those that it took.
    """

    stated: Problem
    problem: Problem
    entries: Entries = field(default_factory=dict)
    certificates: EntriesByClaim | None = field(default_factory=dict)
    solvers: Solvers = ()

    def completed(self, candidates: Iterator[Candidate], budget: TimeBudget) -> Iterator[Candidate]:
        """The candidates, with the parameters and the box of the state."""
        if not self.entries:
            yield from candidates
            return
        for candidate in candidates:
            gains = candidate.gains
            if isinstance(gains, IntervalGains):
                gains = IntervalGains.from_document({**gains.to_document(), **self.entries})
                gains = replace(gains, **corrections(gains, self.problem.plant.output.measured))
                if self.certificates is None:
                    yield with_sources(candidate, gains, self.stated, budget)
                    continue
            yield replace(
                candidate, gains=gains, solvers=merged(candidate.solvers, self.solvers),
                certificates={**candidate.certificates, **(self.certificates or {})},
            )  # fmt: skip


def certain_problem(problem: Problem) -> CertainProblem:
    """The problem itself, or that of its nominal plant with the effects of parameters in bounds.

    DoesNotApply where the state has no known bounds.
    """
    plant = problem.plant
    if not plant.parameters:
        return CertainProblem(problem, problem)
    if reason := reason_against_parameters(problem):
        raise InputError(reason)
    if (stated := StateBounds.stated(plant)) is not None:
        certain = folded(problem, stated)
        return CertainProblem(problem, certain.problem, certain.entries)
    try:
        system, certificate = _proposed_box(plant)
    except DoesNotApply:
        if plant.output.measured == "periodic":
            raise
        return CertainProblem(problem, *nominal(problem), certificates=None)
    always = np.array(certificate["always"])
    before = np.array(certificate.get("before_jump", certificate["always"]))
    tube = np.array(certificate["tube"])
    certain = folded(problem, StateBounds.proved(tube, always, before))
    return CertainProblem(
        problem, certain.problem, certain.entries, {"state_box": certificate},
        solvers_of_tube(system),
    )  # fmt: skip


def _proposed_box(plant: Plant) -> tuple[WidthSystem, Entries]:
    """A proved tube of |x|, as a certificate; DoesNotApply where there is none."""
    dwell = (0.0, np.inf)
    if plant.jump is not None and plant.jump.dwell_time is not None:
        dwell = plant.jump.dwell_time
    certificate, reason = None, "its |x| is not proved to stay bounded by itself"
    try:
        W, f, N, h = absolute_plant(plant, exact)
        unit = exact(np.eye(plant.n))
        system = WidthSystem(W=W, f=f, N=N, h=h, K=None, k=None, out=unit)
        certificate = proved_width(system, *dwell, vanishing=True)
    except DoesNotApply as error:
        reason = str(error)
    if certificate is None:
        raise DoesNotApply(
            f"[state], bounds of x, is required by kind 'interval' for this plant with "
            f"{plant.parameters[0].entry}: {reason}.",
            "state",
        )
    return system, certificate
