"""Stability of a plant with parameters by itself: then the error of its observer decays.

e' = (A - L C) e + what parameters add, which vanishes as x does: where both the nominal error and
the plant are stable, so are the two together (block triangular).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lmi.arithmetic.arrays import Entries
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import prove_cells
from lmi.refute.parameter_words import refute_witness
from lmi.refute.spectral import steps_within
from lmi.verdict import Verdict, refuted, undecided
from obsdesign.analysis.nominal import stability_dwell, stability_family
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.parameter_ranges import in_units, parameter_ranges

ID = "robust_stability"
# the same, refuted: a plant may have an observer all the same
INSTABILITY = "robust_instability"
_SOURCE = (
    "Briat, Automatica 49 (2013), Theorem 2.4 (c); a matrix of the time since a jump, in exact "
    "arithmetic (docs/uncertain_plants.md)"
)


def robust_claim(problem: Problem, certificate: Entries, factor: float = 1.0) -> Claim:
    """Claim that x' = A(p) x, x+ = G(p) x is stable for all p in their ranges.

    certificate: {"certificate": ...} or {"witness": ...}; it is checked here, or not used. factor:
    by which all ranges are wider than stated. A witness concerns all gains: it is of the plant.
    """
    plant = problem.plant
    family = stability_family(plant).scaled(factor)
    verdict = _decided(problem, family, certificate)
    if verdict.outcome == "refuted":
        verdict = refuted(in_units(plant, verdict.witness, factor))
    ranges = parameter_ranges(plant)
    if factor != 1:
        ranges += f", {factor!r} times as wide around the middle"
    system, when = "x' = A(p) x", ""
    if plant.jump is not None:
        system += ", x+ = G(p) x"
        when = f", and for every sequence of dwell times in {Dwell.from_problem(problem)}"
    course = "every value" if all(each.constant for each in plant.parameters) else "every course"
    statement = (
        f"the plant by itself, {system}, tends to zero for {course} of its parameters, "
        f"{ranges}{when}"
    )
    return mark_witness(Claim.from_verdict(ID, statement, _SOURCE, verdict))


def _decided(problem: Problem, family: AffineFamily, certificate: Entries) -> Verdict:
    low, high = stability_dwell(problem)
    tree, witness = certificate.get("certificate"), certificate.get("witness")
    if isinstance(tree, Mapping):
        verdict = prove_cells(family, low, high, tree)
        if verdict.outcome != "proved":
            return verdict
        return Verdict("proved", {"certificate": dict(tree), **verdict.evidence})
    if isinstance(witness, Mapping):
        verdict = refute_witness(family, low, high, witness)
        if verdict.outcome == "refuted" and not _is_within_jitter(problem, verdict.witness):
            return undecided("the dwell times that destabilise it change faster than dwell_jitter")
        return verdict
    reason = certificate.get("reason", "no certificate was given or found")
    return Verdict("undecided", {**certificate, "reason": str(reason)})


def _is_within_jitter(problem: Problem, witness: Entries) -> bool:
    """Do the dwell times of a witness change as slowly as the problem says?"""
    if problem.plant.jump is None:
        return True
    stays = [[piece["duration"] for piece in stay["flow"]] for stay in witness.get("stays", ())]
    thetas = [math.fsum(durations) for durations in stays] or witness.get("thetas", ())
    return len(thetas) < 2 or steps_within(thetas, problem.plant.jump.dwell_jitter)


def instability_claim(problem: Problem, certificate: Entries) -> tuple[Claim, ...]:
    """Claim that some course of the parameters keeps the plant from tending to zero.

    certificate: {"witness": ...}, checked here; no claim where it shows nothing.
    """
    claim = robust_claim(problem, certificate)
    if claim.verdict != "refuted":
        return ()
    witness = {key: own for key, own in claim.evidence["witness"].items() if key != "of_all_gains"}
    statement = f"it is not true that {claim.statement}"
    verdict = Verdict("proved", {"witness": witness})
    return (Claim.from_verdict(INSTABILITY, statement, "spectral radius, in balls", verdict),)
