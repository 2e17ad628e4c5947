"""The claims of an impulsive observer, one function each: statement, source, verdict, evidence.

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from lmi.arithmetic.balls import number
from lmi.rank.decide import decide_full_rank, prove_again, seen_at
from lmi.rank.stack import Stack
from lmi.rank.witness import MARGIN, check_deficient
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations.impulsive import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.impulsive.rate import in_balls

PAPER = "Medina, Lawrence, State Estimation for Linear Impulsive Systems"


def bounded_spacing(high: float) -> Claim:
    """There is a longest spacing; refuted without one: uniformity needs a bound."""
    verdict = proved(longest=high)
    if math.isinf(high):
        reason = (
            "jump.dwell_time has no longest spacing: the bounds of the window, and with them "
            "uniform convergence, need one; give a finite jump.dwell_time[1]"
        )
        verdict = refuted({"entry": "jump.dwell_time", "longest": "inf", "reason": reason})
    return Claim(
        "bounded_spacing",
        "the time between impulses has an upper bound",
        f"{PAPER}, Assumption 2.1",
        verdict.outcome,
        verdict.evidence,
    )


def nominal_plant(numbers: Mapping[str, Any], verdict: Verdict) -> Claim:
    """The plant is the one that the gain is worked out for, but for rounding that is absorbed."""
    parts = []
    if numbers["strategy"] == "subspace":
        parts.append(
            "in the coordinates of basis, A and G are block upper triangular, with core_A and "
            "core_G in the middle, and C sees core_C there and nothing of the first block"
        )
    if "image" in numbers:
        name = "core_G" if "core_G" in numbers else "G"
        parts.append(f"{name} equals image @ coimage: the error after an impulse is in the image")
    return Claim(
        "invariant" if numbers["strategy"] == "subspace" else "image",
        "; ".join(parts) + "; up to rounding that the proved convergence absorbs",
        f"{PAPER}, section IV, carried over to any plant",
        verdict.outcome,
        verdict.evidence,
    )


def missed_target(evidence: Mapping[str, Any]) -> Claim:
    """A noise target that no window and alpha tried would meet, by estimate (`missed`)."""
    return Claim(
        "noise_target",
        "the estimated errors stay below noise_target",
        "covariance recursion over random spacings, an estimate",
        "undecided",
        evidence,
    )


def rate_claim(told: Mapping[str, float], estimated: Any) -> Claim:
    """The proved numbers of the convergence; with an estimate beside them that proves nothing."""
    return Claim(
        "rate",
        "the error just before an impulse is, N impulses later, at most constant * per_impulse^N "
        "of what it was, and it decays like e^(-in_time t), for all spacings in the range",
        f"{PAPER}, Theorem 3.1 and Lemma 3.2",
        "proved",
        told if estimated is None else {**told, "estimated": estimated},
    )


def decay_claim(told: Mapping[str, float] | None, rate: float, high: float) -> Claim:
    """The decay rate that was asked for follows from the proved one."""
    verdict = undecided("convergence itself is not proved")
    if told is not None:
        with in_balls():
            reached = number(told["per_impulse"]) <= (-number(rate) * number(high)).exp()
        verdict = (
            proved(per_impulse=told["per_impulse"])
            if reached
            else undecided(
                f"the proved rate is {told['in_time']:.6g} per unit of time; alpha must be "
                "at least e^(decay_rate * longest spacing)"
            )
        )
    return Claim(
        "decay_rate",
        f"the error decays like e^(-{rate!r} t)",
        f"{PAPER}, Theorem 3.1",
        verdict.outcome,
        verdict.evidence,
    )


def strongly_observable(
    problem: Problem, core: equations.Core, window: int, certificate: Mapping[str, Any]
) -> Claim:
    """Full column rank of the window matrix for all spacings, with a margin."""
    low, high = problem.require_dwell_time()
    # the first measurements of a window may be enough; their spacings are spacings like any others
    blocks = certificate.get("blocks")
    blocks = blocks if type(blocks) is int and 1 <= blocks <= window else window
    verdict = _witnessed(Stack(*core.stack(blocks)), low, high, certificate)
    if verdict is None:
        blocks = min(blocks, equations.most_blocks(core, problem.plant.p))
        verdict = full_rank(Stack(*core.stack(blocks)), low, high, certificate)
    if blocks < window and verdict.outcome == "refuted":
        verdict = undecided(f"{blocks} impulses do not suffice", **verdict.evidence)
    verdict = _admissible(verdict, problem)
    verdict = Verdict(verdict.outcome, {**verdict.evidence, "blocks": blocks})
    what = "states" if core.U is None else "states after an impulse"
    return Claim(
        "strongly_observable",
        f"any {window} impulses in a row tell all {what} apart, for every sequence of spacings in "
        f"{Dwell(low, high)}: the window matrix has full column rank, its smallest singular "
        f"value above {MARGIN:g} in units of its rows and of usual spacings",
        f"{PAPER}, Definition 2.3, Lemma 2.6",
        verdict.outcome,
        verdict.evidence,
    )


def full_rank(stack: Stack, low: float, high: float, certificate: Mapping[str, Any]) -> Verdict:
    """The proof again from what a finder left: a margin, or a witness; from scratch without."""
    witnessed = _witnessed(stack, low, high, certificate)
    if witnessed is not None:
        return witnessed
    asked = certificate.get("asked")
    if certificate.get("reason") and "thetas" in certificate and "sigma_min" not in certificate:
        return Verdict("undecided", certificate)  # what a finder gave up on is not tried again
    if not isinstance(asked, float) or not 0 <= asked < math.inf:
        return decide_full_rank(stack, low, high)
    verdict = prove_again(stack, low, high, asked)
    seen = {"asked": asked, **seen_at(stack, certificate.get("approx_worst"), low, high)}
    return Verdict(verdict.outcome, {**seen, **verdict.evidence})


def _witnessed(
    stack: Stack, low: float, high: float, certificate: Mapping[str, Any]
) -> Verdict | None:
    """The refutation by the witness of a certificate, or None where it has none that holds."""
    witness = certificate.get("witness")
    if not isinstance(witness, Mapping):
        return None
    verdict = check_deficient(stack, low, high, witness)
    return verdict if verdict.outcome == "refuted" else None


def _admissible(verdict: Verdict, problem: Problem) -> Verdict:
    """A witness must keep to the jitter that is allowed from one spacing to the next."""
    jump = problem.plant.jump
    thetas = verdict.evidence.get("witness", {}).get("thetas", ())
    if jump is None or verdict.outcome != "refuted":
        return verdict
    if all(abs(b - a) <= jump.dwell_jitter for a, b in itertools.pairwise(thetas)):
        return verdict
    return undecided("the only spacings found that defeat it change by more than dwell_jitter",
                     **verdict.evidence)  # fmt: skip
