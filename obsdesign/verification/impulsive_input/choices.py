"""Refutations of an observer for impulsive inputs that no other choice would avoid.

Window, margin, K, exponents and operator that the problem leaves open are chosen by synthesis: a
witness against one choice is no witness against the problem.
"""

from __future__ import annotations

from collections.abc import Mapping

from obsdesign.document import Claim
from obsdesign.equations.impulsive_input.rule import operator_is_open
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness, open_choices

# what each claim depends on, beside the plant
_INTEGRAL: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "window": ("window",),
    "samples": ("window",),
    "hurwitz": ("K",),
    "exponents": ("K", "exponents"),
    "rank": ("K", "exponents", "window"),
    "ratio": ("K", "exponents", "window", "margin"),
    "uniqueness": ("K", "exponents", "window", "margin"),
}
_SAMPLES: Mapping[str, tuple[str, ...]] = {
    "observable": (),
    "window": ("window",),
    "rank": ("operator", "window"),
    "uniqueness": ("operator",),
}


def mark_inevitable(problem: Problem, operator: str, claim: Claim) -> Claim:
    """Mark the witness of a claim that no open choice would change."""
    names = (_INTEGRAL if operator == "integral" else _SAMPLES).get(claim.id, ("operator",))
    open_names = open_choices(problem, *names) - {"operator"}
    if "operator" in names and operator_is_open(problem):
        open_names.add("operator")
    if _is_inevitable(problem, claim):
        open_names.clear()
    return mark_witness(claim, open_names)


def _is_inevitable(problem: Problem, claim: Claim) -> bool:
    """Is the claim false for every choice, by counting samples, features or ages?"""
    witness = claim.evidence.get("witness", {})
    low, _ = problem.require_dwell_time()
    period = float(problem.plant.output.period or 0.0)
    if claim.id == "window":  # no window, or none of one period, is shorter
        return low <= period
    if claim.id == "samples":  # a window below the dwell time holds less than two periods
        return "samples" in witness and low <= (1 if operator_is_open(problem) else 2) * period
    count = len(problem.options.get("exponents", ())) * problem.plant.p
    if claim.id == "exponents":
        return count > 0 and "features" in witness
    return claim.id == "uniqueness" and count == 1 and "ages" in witness
