"""Claims of an impulsive observer, one function each: statement, source, verdict, evidence.

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from lmi.arithmetic.balls import number
from lmi.rank.decide import approx_evidence, decide_full_rank, prove_again
from lmi.rank.stack import Stack
from lmi.rank.witness import MARGIN, check_deficient
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, proved, undecided
from obsdesign.analysis.hidden_modes import nullspace
from obsdesign.document import Claim
from obsdesign.equations.impulsive.formulas import Core, most_blocks
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.problem.problem import Problem
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.impulsive.lyapunov import LyapunovFunction
from obsdesign.verification.impulsive.rate import Rate, in_balls
from obsdesign.verification.proposal import Proposal

PAPER = "Medina, Lawrence, State Estimation for Linear Impulsive Systems"


def nominal_plant(gains: ImpulsiveGains, verdict: Verdict) -> Claim:
    """Claim that the plant is the nominal one of the gain, but for rounding that is absorbed."""
    parts = []
    if gains.strategy == "subspace":
        parts.append(
            "in the coordinates of basis, A and G are block upper triangular, with core_A and "
            "core_G in the middle, and C sees core_C there and nothing of the first block"
        )
    if gains.image is not None:
        name = "G" if gains.core_G is None else "core_G"
        parts.append(f"{name} equals image @ coimage: the error after an impulse is in the image")
    return Claim.from_verdict(
        "invariant" if gains.strategy == "subspace" else "image",
        "; ".join(parts) + "; up to rounding that the proved convergence absorbs",
        f"{PAPER}, section IV, carried over to any plant",
        verdict,
    )


def noise_target(evidence: Entries) -> Claim:
    """Claim of a noise target that no window and alpha met, by estimate."""
    return Claim(
        "noise_target",
        "the estimated errors stay below noise_target",
        "covariance recursion over random spacings, an estimate",
        "undecided",
        evidence,
    )


def rate_claim(
    rate: Rate, estimated: Mapping[str, object] | None, lyapunov: LyapunovFunction | None
) -> Claim:
    """Claim of the proved rate of convergence; an estimate beside it proves nothing."""
    evidence: NewEntries = rate.to_evidence()
    evidence |= {} if estimated is None else {"estimated": estimated}
    evidence |= {} if lyapunov is None else {lyapunov.ENTRY: lyapunov.to_evidence()}
    return Claim(
        "rate",
        "the error just before an impulse is, N impulses later, at most constant * per_impulse^N "
        "of what it was, and it decays like e^(-in_time t), for all spacings in the range",
        f"{PAPER}, Theorem 3.1 and Lemma 3.2",
        "proved",
        evidence,
    )


def decay_claim(proved_rate: Rate | None, rate: float, high: float) -> Claim:
    """Claim that the decay rate of the problem follows from the proved one."""
    verdict = undecided("convergence itself is not proved")
    if proved_rate is not None:
        with in_balls():
            is_reached = number(proved_rate.per_impulse) <= (-number(rate) * number(high)).exp()
        verdict = (
            proved(per_impulse=proved_rate.per_impulse)
            if is_reached
            else undecided(
                f"the proved rate is {proved_rate.in_time:.6g} per unit of time; alpha must be "
                "at least e^(decay_rate * longest spacing)"
            )
        )
    return Claim.from_verdict(
        "decay_rate",
        f"the error decays like e^(-{rate!r} t)",
        f"{PAPER}, Theorem 3.1",
        verdict,
    )


@dataclass(frozen=True)
class WindowCertificate(Proposal):
    """Full rank of the matrix of a window.

    blocks: impulses that are enough; required: the margin, entry "asked"; approx_worst: spacings
    where it is least; witness: spacings without full rank; reason, thetas: of a search that failed;
    sigma_min: proved.
    """

    blocks: Value = None
    required: Value = None
    approx_worst: Value = None
    witness: Value = None
    reason: Value = None
    thetas: Value = None
    sigma_min: Value = None

    @classmethod
    def from_document(cls, entries: Entries) -> Self:
        """From a certificate, or from the evidence of the claim."""
        return replace(super().from_document(entries), required=entries.get("asked"))

    @property
    def has_failed(self) -> bool:
        """Is it the end of a search that could not decide?"""
        return bool(self.reason) and self.thetas is not None and self.sigma_min is None


def strongly_observable(
    problem: Problem,
    core: Core,
    window: int,
    certificate: Entries,
    budget: TimeBudget = UNLIMITED,
) -> Claim:
    """Claim full column rank of the window matrix for all spacings, with a margin."""
    low, high = problem.require_dwell_time()
    # the first measurements of a window may be enough; their spacings are spacings like any others
    proposal = WindowCertificate.from_document(certificate)
    fits = type(proposal.blocks) is int and 1 <= proposal.blocks <= window
    blocks = proposal.blocks if fits else window
    verdict = _witnessed(Stack(*core.stack(blocks)), low, high, proposal)
    if verdict is None:
        blocks = min(blocks, most_blocks(core, problem.plant.p))
        verdict = full_rank(Stack(*core.stack(blocks)), low, high, certificate, budget)
    if blocks < window and verdict.outcome == "refuted":
        verdict = undecided(f"{blocks} impulses do not suffice", **verdict.evidence)
    verdict = _admissible(_in_image(verdict, core), problem)
    verdict = Verdict(verdict.outcome, {**verdict.evidence, "blocks": blocks})
    what = "states" if core.U is None else "states after an impulse"
    return Claim.from_verdict(
        "strongly_observable",
        f"any {window} impulses in a row tell all {what} apart, for every sequence of spacings in "
        f"{Dwell(low, high)}: the window matrix has full column rank, its smallest singular "
        f"value above {MARGIN:g} in units of its rows and of usual spacings",
        f"{PAPER}, Definition 2.3, Lemma 2.6",
        verdict,
    )


def full_rank(
    stack: Stack,
    low: float,
    high: float,
    certificate: Entries,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """Prove full rank from a certificate, a margin or a witness; from scratch without one."""
    proposal = WindowCertificate.from_document(certificate)
    witnessed = _witnessed(stack, low, high, proposal)
    if witnessed is not None:
        return witnessed
    margin = proposal.required
    if proposal.has_failed:
        return Verdict("undecided", certificate)  # a search that failed is not repeated
    if not isinstance(margin, float) or not 0 <= margin < math.inf:
        return decide_full_rank(stack, low, high, budget=budget)
    verdict = prove_again(stack, low, high, margin, budget=budget)
    shown = {"asked": margin, **approx_evidence(stack, proposal.approx_worst, low, high)}
    return Verdict(verdict.outcome, {**shown, **verdict.evidence})


def _witnessed(
    stack: Stack, low: float, high: float, proposal: WindowCertificate
) -> Verdict | None:
    """The refutation by the witness of a certificate, or None where it has none that holds."""
    if not isinstance(proposal.witness, Mapping):
        return None
    verdict = check_deficient(stack, low, high, proposal.witness)
    return verdict if verdict.outcome == "refuted" else None


def _in_image(verdict: Verdict, core: Core) -> Verdict:
    """The verdict, undecided if the columns of `image` may be no states after an impulse.

    They are where J = U S reaches all of them: where S has full row rank.
    """
    if verdict.outcome != "refuted" or core.S is None or not nullspace(core.S.T)[1]:
        return verdict
    others = {key: value for key, value in verdict.evidence.items() if key != "witness"}
    return undecided(
        f"the image of the jump has fewer dimensions than the window has columns, {core.size}: "
        "what the window leaves open may be no state after an impulse; strategy 'quadratic' has "
        "no window",
        **others,
    )


def _admissible(verdict: Verdict, problem: Problem) -> Verdict:
    """The verdict, undecided if its witness changes spacings by more than the jitter allows."""
    jump = problem.plant.jump
    thetas = verdict.witness.get("thetas", ())
    if jump is None or verdict.outcome != "refuted":
        return verdict
    if all(abs(b - a) <= jump.dwell_jitter for a, b in itertools.pairwise(thetas)):
        return verdict
    return undecided("the only spacings found that defeat it change by more than dwell_jitter",
                     **verdict.evidence)  # fmt: skip
