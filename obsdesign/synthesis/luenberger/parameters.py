"""Candidates for plants with parameters: nominal gains, and what is proved of the plant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import EntriesByClaim
from lmi.decide.uncertain_stability import decide_uncertain
from lmi.prove.parameter_cells import certificate_of
from lmi.solvers import Solvers, merged
from lmi.time_budget import Remark, TimeBudget, ended_part, remark_end
from obsdesign.analysis.nominal import (
    concerns_plant_alone,
    counted_inputs,
    stability_dwell,
    stability_family,
)
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.candidate import Candidate, Certificates
from obsdesign.synthesis.luenberger.error_bound import bound_certificates
from obsdesign.synthesis.state_box import KnownBox

# candidates whose bounds are compared: the others are tried where none of these is proved
_COMPARED = 5
# part of the time left that proofs for one of them take: `verify` takes as long, and others follow
_SHARE = 0.5
_NO_LIMIT = (
    "L is not chosen for the least bound of the error, since nothing limits it: state "
    "output.noise_bound or observer.gain_norm"
)


@dataclass(frozen=True)
class _StabilityEvidence:
    """On stability of the plant by itself: certificates, solvers that they took, and remarks."""

    certificates: EntriesByClaim
    solvers: Solvers
    remarks: tuple[Remark, ...]


def uncertain_candidates(
    problem: Problem,
    candidates: Iterator[Candidate],
    box: KnownBox | None,
    budget: TimeBudget,
    *,
    is_L_limited: bool,
) -> Iterator[Candidate]:
    """The candidates of the nominal problem, with certificates about the uncertain plant.

    In a box the first few are compared by their proved bounds, in units of the box, but where
    nothing limits L: the fastest would always win.
    """
    plant = _stability(problem, budget)
    is_compared = box is not None and is_L_limited
    open_choice = () if box is None or is_L_limited else (Remark(_NO_LIMIT),)
    for place, candidate in enumerate(candidates):
        in_time = budget.part(_SHARE)
        gains, bounds = candidate.gains, _bounds(problem, candidate, box, in_time)
        ended = remark_end("norms for the bound of the error", in_time.ended() if box else {})
        if isinstance(gains, LuenbergerGains) and bounds.evidence:
            gains = replace(gains, **counted_inputs(problem.plant))
        cost = _cost(bounds.evidence, box) if box is not None and is_compared else None
        yield replace(
            candidate,
            gains=gains,
            cost=cost,
            goes_on=is_compared and candidate.searched and place < _COMPARED - 1,
            solvers=merged(merged(candidate.solvers, plant.solvers), bounds.solvers),
            certificates={**candidate.certificates, **plant.certificates, **bounds.evidence},
            remarks=(*candidate.remarks, *plant.remarks, *open_choice, *ended),
        )


def _stability(problem: Problem, budget: TimeBudget) -> _StabilityEvidence:
    """Stability of the plant by itself: required where both gains are zero, else useful."""
    family, ends = stability_family(problem.plant), stability_dwell(problem)
    verdict = decide_uncertain(family, *ends, budget=budget)
    if verdict.outcome == "proved":
        certificate = certificate_of(verdict.evidence)
        return _StabilityEvidence({"robust_stability": certificate}, verdict.solvers, ())
    if concerns_plant_alone(problem):
        return _StabilityEvidence({"robust_stability": verdict.evidence}, verdict.solvers, ())
    if verdict.outcome == "refuted":
        return _StabilityEvidence({"robust_instability": verdict.evidence}, (), ())
    end = ended_part(verdict.evidence)
    if end:
        return _StabilityEvidence({}, (), remark_end("stability of the plant by itself", end))
    reason = verdict.evidence.get("reason", "no certificate was found")
    text = f"whether the plant by itself is stable for all its parameters is open: {reason}"
    return _StabilityEvidence({}, (), (Remark(text),))


def _cost(certificates: EntriesByClaim, box: KnownBox) -> float:
    """Sum of the bounds of the error in units of the box; infinite without any."""
    if "error_bound" not in certificates:
        return math.inf
    return float((np.array(certificates["error_bound"]["always"]) / box.units).sum())


def _bounds(
    problem: Problem, candidate: Candidate, box: KnownBox | None, budget: TimeBudget
) -> Certificates:
    """Certificates on the error of a candidate; none where no bound is claimed."""
    if box is None or not isinstance(candidate.gains, LuenbergerGains):
        return Certificates()
    return bound_certificates(problem, candidate.gains, candidate.certificates, box, budget)
