"""Claims about the time between impulses: both ends of Assumption 2.1.

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.arithmetic.spectrum import spectral_radius
from lmi.rank.hidden_mode import check_hiding
from lmi.rank.witness import MARGIN
from lmi.refute.spectral import decide_constant
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import hidden_part
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness

_SOURCE = "Medina, Lawrence, State Estimation for Linear Impulsive Systems, Assumption 2.1"


def bounded_spacing(high: float) -> Claim:
    """Claim that there is a longest spacing; refuted without one: uniformity needs a bound."""
    verdict = proved(longest=high)
    if math.isinf(high):
        reason = (
            "jump.dwell_time has no longest spacing: the bounds of the window, and with them "
            "uniform convergence, need one; give a finite jump.dwell_time[1]"
        )
        verdict = refuted({"entry": "jump.dwell_time", "longest": "inf", "reason": reason})
    return Claim.from_verdict(
        "bounded_spacing", "the time between impulses has an upper bound", _SOURCE, verdict
    )


def shortest_spacing(problem: Problem) -> Claim:
    """Claim that the shortest spacing is positive, or may be 0.

    A range that begins at 0 is compact as well: Theorem 3.1 needs no more of it than rank at
    spacing 0. No gain serves where C misses a mode of G that grows; one of modulus 1 is undecided,
    since no time passes between impulses at once.
    """
    low = problem.require_dwell_time()[0]
    if low > 0:
        statement, verdict = "the time between impulses has a positive lower bound", proved()
    else:
        statement = (
            "impulses may follow each other at once, and (G, C) is detectable: C misses no mode of "
            f"G of modulus 1 or more (residuals below {MARGIN:g} of their terms)"
        )
        verdict = _at_once(problem)
    verdict = Verdict(verdict.outcome, {**verdict.evidence, "shortest": low})
    return mark_witness(Claim.from_verdict("shortest_spacing", statement, _SOURCE, verdict))


def _at_once(problem: Problem) -> Verdict:
    """Decide whether C detects every mode of G: refuted up to MARGIN, proved exactly."""
    plant = problem.plant
    assert plant.jump is not None
    C = exact(seen_before_jump(plant.jump.G, plant.output.C, plant.output.jump_measurement))
    A, G = exact(plant.flow.A), exact(plant.jump.G)
    verdict = check_hiding(A, G, C, 0.0)
    if verdict.outcome == "refuted":
        mode = verdict.witness["mode"]
        modulus = math.hypot(mode["real"], mode["imag"])
    else:
        hidden = hidden_part([G], C)
        if hidden is None:
            return proved()
        (jump,) = hidden.maps
        verdict = decide_constant(np.zeros(jump.shape), jump, 0.0)
        modulus = spectral_radius(to_float(jump))
    if verdict.outcome != "refuted":
        return verdict
    reason = (
        f"jump.dwell_time has no positive lower bound: {verdict.reason}; give a positive "
        "jump.dwell_time[0]"
    )
    if modulus <= 1 + MARGIN:
        return undecided(reason)
    return refuted({**verdict.witness, "entry": "jump.dwell_time", "reason": reason})
