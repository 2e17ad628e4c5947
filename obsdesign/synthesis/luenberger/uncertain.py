"""Candidates for plants with parameters: nominal gains, and stability of the plant."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

from lmi.arithmetic.arrays import Entries
from lmi.decide.uncertain_stability import decide_uncertain
from lmi.prove.parameter_cells import certificate_of
from lmi.solvers import merged
from lmi.time_budget import TimeBudget
from obsdesign.analysis.nominal import stability_dwell, stability_family
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate


def with_robust_stability(
    problem: Problem, candidates: Iterator[Candidate], budget: TimeBudget
) -> Iterator[Candidate]:
    """The candidates of the nominal problem, each with what is known of the plant by itself."""
    family, ends = stability_family(problem.plant), stability_dwell(problem)
    verdict = decide_uncertain(family, *ends, budget=budget)
    certificate: Entries = verdict.evidence
    if verdict.outcome == "proved":
        certificate = certificate_of(verdict.evidence)
    if verdict.outcome != "proved":  # no gains change that
        candidates = itertools.islice(candidates, 1)
    for candidate in candidates:
        yield replace(
            candidate, solvers=merged(candidate.solvers, verdict.solvers),
            certificates={**candidate.certificates, "robust_stability": certificate},
        )  # fmt: skip
