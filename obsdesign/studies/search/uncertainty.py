"""How wide all ranges of parameters may be: a bracket of the factor, proved on one side.

Every range keeps its middle and is so many times as wide. What is proved is `robust_stability`, of
the plant by itself; what refutes are parameters and dwell times.
"""

from __future__ import annotations

import math

from lmi.decide.dwell_search import Bracket
from lmi.decide.uncertain_search import UncertainProblem, uncertain_bracket
from lmi.prove.parameter_cells import certificate_of
from lmi.time_budget import TimeBudget
from obsdesign import workflow
from obsdesign.analysis.nominal import stability_dwell, stability_family
from obsdesign.document import Claim
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.result import SearchResult
from obsdesign.verification.luenberger.robust_stability import robust_claim


def require_parameters(problem: Problem) -> None:
    """InputError unless it is a point observer of a plant with parameters and dwell times."""
    if problem.require_kind() != "luenberger":
        raise InputError(
            f"--for largest_uncertainty is not available for kind {problem.require_kind()!r} in "
            "this version."
        )
    if not problem.plant.parameters:
        raise InputError(
            "--for largest_uncertainty: [[parameter]] is required; the plant has none."
        )
    jump = problem.plant.jump
    if jump is not None and math.isfinite(jump.dwell_jitter):
        raise InputError("--for largest_uncertainty is not available with jump.dwell_jitter.")
    stability_family(problem.plant)
    stability_dwell(problem)


def search_uncertainty(problem: Problem, accuracy: float, budget: TimeBudget) -> workflow.Outcome:
    """One attempt at the bracket with this budget."""
    family, (low, high) = stability_family(problem.plant), stability_dwell(problem)
    searched = UncertainProblem(family, low, high, "factor", accuracy, budget)
    bracket = uncertain_bracket(searched)
    kind, claims = problem.require_kind(), _claims(problem, bracket)
    if bracket.proved is None:
        verdict = bracket.verdict or "undecided"
        return workflow.Outcome(verdict, kind, claims, _result(bracket, accuracy), None)
    gap = bracket.relative_gap
    is_tight = gap is not None and gap <= accuracy
    is_proved = all(claim.verdict == "proved" for claim in claims)
    verdict = "proved" if is_proved and is_tight else "undecided"
    return workflow.Outcome(verdict, kind, claims, _result(bracket, accuracy), None)


def _claims(problem: Problem, bracket: Bracket) -> tuple[Claim, ...]:
    """Robust stability at the proved factor, or why the nominal plant is not stable."""
    if bracket.proved is None:
        return (robust_claim(problem, bracket.obstacle, factor=0.0),)
    certificate = certificate_of(bracket.certificate)
    return (robust_claim(problem, certificate, factor=bracket.proved),)


def _result(bracket: Bracket, accuracy: float) -> dict[str, object]:
    witness = bracket.obstacle.get("witness")
    reason = bracket.obstacle.get("reason") or (witness or {}).get("reason")
    return SearchResult(
        proved=bracket.proved, not_proved=bracket.not_proved, not_proved_verdict=bracket.verdict,
        accuracy=accuracy, open=bracket.relative_gap, reason=reason, witness=witness,
        ended=bracket.ended,
    ).to_dict()  # fmt: skip
