"""Witnesses against the problem among those against the gains that synthesis chose.

Window, margin, K, exponents and operator that the problem leaves open are chosen by synthesis: a
witness against one choice is no witness against the problem.
"""

from __future__ import annotations

from collections.abc import Mapping

from obsdesign.analysis.impulsive_input.requirements import operator_is_open
from obsdesign.document import Claim
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness, open_choices
from obsdesign.verification.impulsive_input.witnesses import (
    EqualFeatures,
    TooFewFeatures,
    TooFewSamples,
)

# gains and options that each claim depends on, beside the plant
_INTEGRAL: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "window": ("window",),
    "samples": ("window",),
    "hurwitz": ("K",),
    "exponents": ("K", "exponents"),
    "rank": ("K", "exponents", "window"),
    "ratio": ("K", "exponents", "window", "margin"),
    "uniqueness": ("K", "exponents", "window", "margin"),
    "smallest_weight": ("K", "exponents", "window", "margin"),
}
_SAMPLES: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "window": ("window",),
    "rank": ("operator", "window"),
    "uniqueness": ("operator",),
}


def mark_inevitable(problem: Problem, operator: str, claim: Claim) -> Claim:
    """The claim, its witness marked where no choice left open would change it."""
    names = (_INTEGRAL if operator == "integral" else _SAMPLES).get(claim.id, ("operator",))
    open_names = open_choices(problem, *names) - {"operator"}
    if "operator" in names and operator_is_open(problem):
        open_names.add("operator")
    if _is_inevitable(problem, claim):
        open_names.clear()
    return mark_witness(claim, open_names)


def _is_inevitable(problem: Problem, claim: Claim) -> bool:
    """Whether counting shows that no choice would do."""
    evidence = claim.evidence
    low, _ = problem.require_dwell_time()
    period = problem.plant.output.sample_spacing
    if claim.id == "window":  # no window, or none of one period, is shorter
        return low <= period
    if claim.id == "samples":  # a window below the dwell time holds less than two periods
        periods = 1 if operator_is_open(problem) else 2
        return TooFewSamples.from_evidence(evidence) is not None and low <= periods * period
    exponents = problem.options_as(ImpulsiveInputOptions).exponents
    count = len(exponents or ()) * problem.plant.p
    if claim.id == "exponents":
        return count > 0 and TooFewFeatures.from_evidence(evidence) is not None
    if claim.id == "uniqueness":
        return count == 1 and EqualFeatures.from_evidence(evidence) is not None
    return False
