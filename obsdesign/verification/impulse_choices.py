"""Which refutations of an observer for impulsive inputs no other choice would avoid.

Window, margin, K, exponents and operator that the problem leaves open are chosen by synthesis: a
witness against one choice is none against the problem.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from obsdesign.document import Claim
from obsdesign.equations.impulse_rule import operator_is_open
from obsdesign.problem import Problem

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


def of_all_choices(problem: Problem, operator: str, claim: Claim) -> Claim:
    """The claim, its witness marked `of_all_gains` where no choice left open would change it."""
    witness = claim.evidence.get("witness")
    if claim.verdict != "refuted" or witness is None:
        return claim
    table = _INTEGRAL if operator == "integral" else _SAMPLES
    needed = table.get(claim.id, ("operator",))
    if set(needed) & _left_open(problem) and not _is_inevitable(problem, claim.id, witness):
        return claim
    evidence = {**claim.evidence, "witness": {**witness, "of_all_gains": True}}
    return replace(claim, evidence=evidence)


def _left_open(problem: Problem) -> set[str]:
    names = ("window", "margin", "exponents")
    left = {name for name in names if name not in problem.options}
    left |= {"K"} - set(problem.gains)
    return left | ({"operator"} if operator_is_open(problem) else set())


def _is_inevitable(problem: Problem, name: str, witness: Mapping[str, Any]) -> bool:
    """Whether the witness holds although a choice is open: by counting."""
    low, _ = problem.require_dwell_time()
    period = float(problem.plant.output.period or 0.0)
    if name == "window":  # no window, or none of one period, is shorter
        return low <= period
    if name == "samples":  # a window below the dwell time holds less than two periods
        return "samples" in witness and low <= (1 if operator_is_open(problem) else 2) * period
    count = len(problem.options.get("exponents", ())) * problem.plant.p
    if name == "exponents":
        return count > 0 and "features" in witness
    return name == "uniqueness" and count == 1 and "ages" in witness
