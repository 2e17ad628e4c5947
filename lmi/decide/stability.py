"""Decide stability of x -> e^{F theta} H x for every sequence of theta in a range.

The parts are separate programs; this file only lets them take turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import NewEntries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.families import Edge
from lmi.find.cutting_plane import Proposal, propose
from lmi.find.dissipative import is_stiff, propose_dissipative
from lmi.find.splitting import Limits
from lmi.find.window_search import find_windows
from lmi.find.worst_sequence import worst_word
from lmi.prove.common_matrix import prove_common
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.infeasible import prove_no_common
from lmi.refute.spectral import decide_constant, refute_spectral, refute_word, steps_within
from lmi.time_budget import UNLIMITED, TimeBudget, ended_part
from lmi.verdict import Verdict, undecided
from lmi.window_memory import AUTO, Memory

_TURNS = 8
_BOXES = 6000  # a proof that needs more is not worth the wait
# so many dwell times of failed windows join the search for a destabilising sequence
_HINTS = 12
_SEED = 20161  # the search for destabilising sequences repeats itself exactly


def decide(
    F: ArrayLike,
    H: ArrayLike,
    low: float,
    high: float,
    *,
    memory: Memory = AUTO,
    jitter: float = math.inf,
    budget: TimeBudget = UNLIMITED,
) -> Verdict:
    """Decide whether x -> e^{F theta} H x is stable for all sequences of theta in [low, high].

    Proved by one P (Briat, Automatica 49 (2013), Theorem 3) or by windows of dwell times
    (docs/windows.md), refuted by a mode or by dwell times, or undecided.

    F, H: (n, n) floats or exact rationals; 0 <= low <= high <= infinity. With high infinite, F must
    be Hurwitz (otherwise refuted with the mode). jitter: only sequences whose dwell times change by
    at most so much from one to the next. memory: 0 for a common P only, a number for windows that
    look at most so many dwell times back and ahead, "auto" for as many as it takes. Evidence: "P",
    or "windows" and "edges" (`lmi.prove.windows_proof`), or "witness"; one dwell time (low = high)
    may be proved without any. Undecided evidence holds the largest growth seen, "no_common_P" when
    a checked certificate excludes a common P, which is not instability, and where a budget ended a
    search what `TimeBudget.ended` has of it. ValueError for other ranges, jitter or memory.
    """
    if not 0 <= low <= high or math.isinf(low):
        raise ValueError(f"0 <= low <= high, low finite, is required; got [{low}, {high}]")
    if not (jitter >= 0 and (memory == AUTO or memory >= 0)):
        raise ValueError(f"jitter and memory must be >= 0; got {jitter} and {memory}")
    F_exact, H_exact = exact(F), exact(H)
    if math.isinf(high):
        flow = prove_hurwitz(F_exact)
        if flow.outcome != "proved":
            return flow
    scaling = Scaling.from_pair(F_exact, H_exact, high)
    family = _Family(scaling.map(F_exact), scaling.map(H_exact), low, high, jitter, budget)
    verdict = family.decided(memory)
    return replace(verdict, evidence=scaling.restored(verdict.evidence, H_exact))


@dataclass(frozen=True)
class _Family:
    """A balanced pair on a range of dwell times, whose flow decays where `high` is infinite."""

    F: Exact
    H: Exact
    low: float
    high: float
    jitter: float
    budget: TimeBudget

    def decided(self, memory: Memory) -> Verdict:
        """`decide` for this family."""
        pair, ends = (self.F, self.H), (self.low, self.high)
        attempt, proposal = find_and_prove(*pair, *ends, budget=self.budget)
        if attempt.outcome == "proved":
            return attempt
        counter = refute_spectral(*pair, *ends, proposal.thetas)
        if counter.outcome == "refuted":
            return counter
        if self.low == self.high:
            return decide_constant(*pair, self.low)
        attempt = self._with_worst_sequence(proposal, attempt)
        if attempt.outcome == "refuted":
            return attempt
        if memory == 0:
            return replace(attempt, evidence={**attempt.evidence, **self.budget.ended()})
        return self._by_windows(Limits.from_memory(memory), proposal, attempt)

    def _by_windows(self, limits: Limits, proposal: Proposal, attempt: Verdict) -> Verdict:
        """Windows; where they fail, the dwell times that stood in their way may be a witness."""
        result = find_windows(
            self.F, self.H, self.low, self.high, jitter=self.jitter, limits=limits,
            budget=self.budget,
        )  # fmt: skip
        if result.verdict.outcome == "proved":
            return result.verdict
        hints = tuple(dict.fromkeys([*result.thetas[:_HINTS], *proposal.thetas]))
        again = self._with_worst_sequence(replace(proposal, thetas=hints), attempt)
        if again.outcome == "refuted":
            return again
        evidence = {key: value for key, value in again.evidence.items() if key != "reason"}
        evidence |= self.budget.ended() or ended_part(result.verdict.evidence)
        reason = f"{attempt.reason}; {result.verdict.reason}"
        return replace(again, evidence={"reason": reason, **evidence})

    def _with_worst_sequence(self, proposal: Proposal, attempt: Verdict) -> Verdict:
        """Refuted by a sequence of dwell times, else the attempt with the worst one found."""
        edge = Edge(to_float(self.F), to_float(self.H), self.low, self.high)
        L = np.eye(len(edge.F)) if proposal.L is None else proposal.L
        try:
            with np.errstate(all="ignore"):
                rng = np.random.default_rng(_SEED)
                word = worst_word(
                    edge, L, proposal.thetas, rng, jitter=self.jitter, budget=self.budget
                )
        except (np.linalg.LinAlgError, ValueError):  # overflow: nothing to be learned from floats
            return attempt
        if word.growth >= 1 and steps_within(word.thetas, self.jitter):
            counter = refute_word(self.F, self.H, word.thetas)
            if counter.outcome == "refuted":
                return counter
        approx: dict[str, Sequence[float] | float]
        approx = {"growth_per_jump": word.growth, "worst_sequence": list(word.thetas)}
        return replace(attempt, evidence={**attempt.evidence, **approx})


def find_and_prove(
    F: Exact, H: Exact, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> tuple[Verdict, Proposal]:
    """Propose P, prove it, give the theta where a proof failed back to the search; repeat."""
    F_float, H_float = to_float(F), to_float(H)
    seeds: list[float] = []
    attempt = undecided("no matrix P was tried")
    evidence: NewEntries
    if is_stiff(F_float, Edge(F_float, H_float, low, high).last - low):
        P = propose_dissipative(F_float, H_float, low)
        quick = attempt if P is None else prove_common(F, H, P, low, high, steps=1)
        if P is not None and quick.outcome == "proved":
            proposal = Proposal(
                P[None], (low,), math.nan, low, coordinates=np.linalg.cholesky(P)[None],
                solvers=("Clarabel",),
            )  # fmt: skip
            evidence = {"P": P.tolist(), **quick.evidence}
            return Verdict("proved", evidence, proposal.solvers), proposal
    for _ in range(_TURNS):
        proposal = propose(F_float, H_float, low, high, seeds, budget=budget)
        if proposal.P is None:
            return _no_common_P(F, H, proposal), proposal
        attempt = prove_common(F, H, proposal.P, low, high, steps=_BOXES)
        if attempt.outcome == "proved":
            evidence = {
                "P": proposal.P.tolist(),
                "thetas_used": len(proposal.thetas),
            }
            if math.isfinite(proposal.margin):
                evidence |= {"approx_margin": proposal.margin}
            evidence |= attempt.evidence
            return Verdict("proved", evidence, proposal.solvers), proposal
        theta = attempt.evidence.get("theta")
        if theta is None or theta in seeds or attempt.evidence.get("boxes", 0) >= _BOXES:
            break
        seeds = [*seeds, float(theta)]
    return attempt, proposal


def _no_common_P(F: Exact, H: Exact, proposal: Proposal) -> Verdict:
    """Undecided, since no P was found; with a checked certificate when there is none."""
    where: NewEntries = {"theta": proposal.worst_theta, "thetas": list(proposal.thetas)}
    if proposal.multipliers is not None:
        nothing = prove_no_common(F, H, proposal.thetas, proposal.multipliers)
        if nothing.outcome == "proved":
            reason = (
                f"no common P exists for these {len(proposal.thetas)} dwell times (checked dual "
                "certificate), which is not instability"
            )
            evidence = {"reason": reason, **where, "no_common_P": dict(nothing.evidence)}
            return Verdict("undecided", evidence, proposal.solvers)
    return undecided("no common P was found, which is not instability", **where)
