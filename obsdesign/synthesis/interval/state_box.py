"""Candidates for uncertain plants: those of the nominal plant with wider bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import EntriesByClaim, Matrix
from lmi.solvers import Solvers, merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.interval.requirements import reason_against_parameters
from obsdesign.analysis.nominal import NominalProblem
from obsdesign.analysis.widened import StateBounds, widened, without_box
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.errors import DoesNotApply, InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate
from obsdesign.synthesis.convex_gain import UserConstraints
from obsdesign.synthesis.interval.corrections import corrections
from obsdesign.synthesis.interval.signal_sizes import SignalSizes
from obsdesign.synthesis.interval.sourced_width import SourcedSearch
from obsdesign.synthesis.state_box import proposed_box


@dataclass(frozen=True)
class BoxedProblem:
    """A stated problem, and the nominal one that is solved for it.

    certificates: of the box; solvers: those that it took.
    """

    stated: Problem
    nominal: NominalProblem
    certificates: EntriesByClaim = field(default_factory=dict)
    solvers: Solvers = ()

    def completed(
        self, candidates: Iterator[Candidate], sourced: SourcedSearch | None
    ) -> Iterator[Candidate]:
        """The candidates, with the parameters and the box of the state.

        sourced: where there is no box, what certifies their radius.
        """
        if not self.nominal.entries:
            yield from candidates
            return
        for candidate in candidates:
            gains = candidate.gains
            if isinstance(gains, IntervalGains):
                gains = self.with_parameters(gains)
                if sourced is not None:
                    yield sourced.completed(candidate, gains)
                    continue
            yield replace(
                candidate, gains=gains, solvers=merged(candidate.solvers, self.solvers),
                certificates={**candidate.certificates, **self.certificates},
            )  # fmt: skip

    def with_parameters(self, gains: IntervalGains) -> IntervalGains:
        """Gains with the parameters, and gains on the measured part of their effects."""
        gains = IntervalGains.from_document({**gains.to_document(), **self.nominal.entries})
        measured = self.stated.plant.output.measured
        return replace(gains, **corrections(gains, measured, self._sizes, gains.noise_bound))

    @cached_property
    def _sizes(self) -> Matrix:
        """Typical magnitudes of the states (n,): of the box in which they stay, where it is known.

        One where it is a point, and any number will do.
        """
        if not self.nominal.is_bounded:
            return SignalSizes.from_problem(self.stated, self.nominal.problem).x
        lower, upper = (
            np.asarray(self.nominal.entries[f"state_{end}"]) for end in ("lower", "upper")
        )
        largest = np.maximum(np.abs(lower), np.abs(upper))
        return np.where(largest > 0, largest, 1.0)

    def sourced(self, budget: TimeBudget, user: UserConstraints | None) -> SourcedSearch | None:
        """The search without a box of the state; None with one, or without parameters."""
        if self.nominal.is_bounded:
            return None
        return SourcedSearch(self.stated, self.nominal.problem, budget, user)


def boxed_problem(problem: Problem) -> BoxedProblem:
    """The problem itself, or that of its nominal plant with the effects of parameters in bounds.

    DoesNotApply where the state has no known bounds.
    """
    plant = problem.plant
    if not plant.parameters:
        return BoxedProblem(problem, NominalProblem(problem))
    if reason := reason_against_parameters(problem):
        raise InputError(reason)
    if (stated := StateBounds.stated(plant)) is not None:
        return BoxedProblem(problem, widened(problem, stated).nominal)
    try:
        box = proposed_box(plant)
    except DoesNotApply as error:
        if plant.output.measured != "periodic":
            return BoxedProblem(problem, without_box(problem))
        raise DoesNotApply(
            f"[state], bounds of x, is required by kind 'interval' for this plant with "
            f"{plant.parameters[0].entry}: {error}.",
            "state",
        ) from None
    nominal = widened(problem, box.bounds).nominal
    return BoxedProblem(problem, nominal, {"state_box": box.certificate}, box.solvers)
