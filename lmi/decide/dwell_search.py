"""Shortest and longest dwell time for a given pair: a bracket, proved on one side.

The searched end x of the range is monotone: a smaller range is never harder. Where the spectral
radius of one map crosses 1, no x beyond it can be proved, and usually every x before it can: then
one proof and one refutation settle the bracket. Otherwise the margin of the semidefinite program,
which changes sign at the limit, is followed by a bracketing secant method.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries
from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact, to_float
from lmi.decide.dwell_gap import Gap
from lmi.decide.dwell_problem import Direction, DwellProblem
from lmi.decide.dwell_scan import scan
from lmi.decide.stability import decide, find_and_prove
from lmi.families import horizon
from lmi.find.cutting_plane import Proposal, propose
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_word
from lmi.solvers import Solvers
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict
from lmi.window_memory import AUTO, Memory

ACCURACY = 1e-6
_STEPS = 60
_COARSE = 1e-4


@dataclass(frozen=True)
class Bracket:
    """Limit of an end of the dwell-time range, between `proved` and `not_proved`.

    proved: the end for which stability is proved (evidence: `certificate`), None if none was found.
    not_proved: the nearest end that was not, with its verdict, refuted or undecided (evidence:
    `obstacle`); None where everything is proved. islands: further [a, b] in which every constant
    dwell time contracts, by floats, so that the feasible set may not be one interval. common: the
    end that a common P proves, where windows of dwell times prove more or were tried. ended: the
    budget that ended a search between proved and not proved, as `TimeBudget.ended` has it.
    solvers: those of the certificate.
    """

    proved: float | None
    not_proved: float | None
    verdict: str | None
    certificate: Entries = field(default_factory=dict)
    obstacle: Entries = field(default_factory=dict)
    islands: tuple[tuple[float, float], ...] = ()
    common: float | None = None
    ended: Entries = field(default_factory=dict)
    solvers: Solvers = ()

    @property
    def relative_gap(self) -> float | None:
        """Relative width of what is neither proved nor refuted; None where that has no meaning."""
        if self.proved is None or not self.not_proved or math.isinf(self.not_proved):
            return None
        return abs(self.proved / self.not_proved - 1)


def dwell_bracket(
    F: ArrayLike,
    H: ArrayLike,
    direction: Direction,
    kept: float,
    *,
    accuracy: float = ACCURACY,
    memory: Memory = AUTO,
    jitter: float = math.inf,
    budget: TimeBudget = UNLIMITED,
) -> Bracket:
    """The smallest x for which [x, kept] is proved, or the largest for which [kept, x] is.

    Proved is stability of x -> e^{F theta} H x for all sequences of theta in the range, as by
    `lmi.decide.stability.decide`. direction: "shortest" with the longest dwell time kept, which may
    be infinite; "longest" with the shortest one kept; x may be infinite then. F, H: (n, n) floats
    or exact rationals. accuracy: relative width of the bracket. memory, jitter: as for `decide`.
    ValueError for numbers that are not finite.
    """
    flow, jump = exact(F), exact(H)
    scaling = Scaling.from_pair(flow, jump, kept if direction == "shortest" else math.inf)
    problem = DwellProblem(
        scaling.map(flow), scaling.map(jump), direction, kept, accuracy, memory, jitter, budget
    )
    bracket = _Search(problem).run()
    certificate, obstacle = (
        scaling.restored(evidence, jump) for evidence in (bracket.certificate, bracket.obstacle)
    )
    return replace(bracket, certificate=certificate, obstacle=obstacle)


@dataclass(frozen=True)
class _Search:
    """The search for a bracket of a problem whose pair is balanced."""

    problem: DwellProblem

    def run(self) -> Bracket:
        """Everything proved; or nothing; or the bracket around the limit."""
        problem = self.problem
        verdict = self._nothing_to_search()
        if verdict is not None:
            end = problem.budget.ended()
            return Bracket(
                None, problem.kept, verdict.outcome, obstacle=verdict.evidence, ended=end
            )
        looked = scan(problem)
        crossing, last = looked.crossing, looked.last
        # windows go on from where a common P ends: no need to know that end exactly
        accuracy = problem.accuracy if problem.memory == 0 else max(_COARSE, problem.accuracy)
        common = _Search(replace(problem, accuracy=accuracy))
        if crossing is None:
            whole = self._prove(problem.extreme)
            if whole.outcome == "proved":
                return Bracket(problem.extreme, None, None, whole.evidence, solvers=whole.solvers)
            bracket = common._up_to(last, whole)
        else:
            bracket = self._at_crossing(crossing) or common._follow(crossing)
        if bracket.verdict == "undecided" and problem.memory != 0:
            bracket = self._beyond_common(bracket, crossing, last)
        return replace(
            bracket, islands=looked.islands, ended=problem.budget.ended() or bracket.ended
        )

    def _beyond_common(self, bracket: Bracket, crossing: float | None, last: float) -> Bracket:
        """Windows of dwell times on the proved side, destabilising sequences on the other."""
        problem, common = self.problem, bracket.proved
        good = problem.kept if common is None else common
        if math.isinf(good):
            return bracket
        gap = Gap(problem)
        P = bracket.certificate.get("P")
        L = np.eye(len(problem.F)) if P is None else np.linalg.cholesky(np.array(P))
        far = last if crossing is None else problem.inward(crossing, -0.4 * problem.accuracy)
        outside = gap.refuted(good, far, L)
        if outside is None:
            extreme = problem.extreme
            for end in dict.fromkeys((extreme, far) if crossing is None else ()):
                whole = gap.attempt(end)
                if whole.outcome == "proved":
                    not_proved = None if end == extreme else extreme
                    word = None if end == extreme else "undecided"
                    return Bracket(
                        end, not_proved, word, whole.evidence, common=common, solvers=whole.solvers
                    )
        limit = far if outside is None else outside[0]
        further = gap.proved(good, limit)
        reached, certificate, solvers = common, bracket.certificate, bracket.solvers
        if further.end is not None:
            reached, certificate, solvers = further.end, further.certificate, further.solvers
        word, obstacle = "undecided", bracket.obstacle
        if outside is not None:
            word, obstacle = "refuted", outside[1].evidence
        return Bracket(
            reached, limit, word, certificate, obstacle, (), common, further.ended, solvers
        )

    def _nothing_to_search(self) -> Verdict | None:
        """The verdict on the smallest range there is, if that is not proved."""
        problem = self.problem
        if problem.is_shortest and math.isinf(problem.kept):
            verdict = prove_hurwitz(problem.F)
        else:
            verdict = self._decide(problem.kept)
        return None if verdict.outcome == "proved" else verdict

    def _decide(self, x: float) -> Verdict:
        """Decide the range that ends at x, by a common P alone."""
        problem = self.problem
        return decide(problem.F, problem.H, *problem.ends(x), memory=0, budget=problem.budget)

    def _prove(self, x: float) -> Verdict:
        problem = self.problem
        ends = problem.ends(x)
        if math.isinf(ends[1]) and prove_hurwitz(problem.F).outcome != "proved":
            return self._decide(x)
        return find_and_prove(problem.F, problem.H, *ends, budget=problem.budget)[0]

    def _propose(self, x: float) -> Proposal:
        problem = self.problem
        flow, jump = to_float(problem.F), to_float(problem.H)
        return propose(flow, jump, *problem.ends(x), budget=problem.budget)

    def _up_to(self, last: float, whole: Verdict) -> Bracket:
        """No single map is expanding: everything that was looked at, or the limit before it."""
        if not self.problem.is_shortest:
            good = self._prove(last)
            if good.outcome == "proved":
                return Bracket(
                    last, math.inf, whole.outcome, good.evidence, whole.evidence,
                    solvers=good.solvers,
                )  # fmt: skip
        return self._follow(last)

    def _at_crossing(self, crossing: float) -> Bracket | None:
        """The bracket if the radius of one map is what limits the range."""
        problem = self.problem
        inside = problem.inward(crossing, 0.4 * problem.accuracy)
        outside = problem.inward(crossing, -0.4 * problem.accuracy)
        good = self._prove(inside)
        if good.outcome != "proved":
            return None
        bad = refute_word(problem.F, problem.H, (outside,))
        if bad.outcome != "refuted":
            bad = self._decide(outside)
        return Bracket(
            inside, outside, bad.outcome, good.evidence, bad.evidence, solvers=good.solvers
        )

    def _follow(self, bad: float) -> Bracket:
        """From an end that cannot be proved towards the kept one, by the sign of the margin."""
        good, proposal = self._first_good(bad)
        if good is None or proposal is None:
            verdict = self._decide(bad)
            return Bracket(None, bad, verdict.outcome, obstacle=verdict.evidence)
        value_bad = self._propose(bad).optimum
        bad = self._narrow(good, bad, value_bad, proposal)
        problem = self.problem
        for step in range(8):  # a proof needs a little more margin than floats see
            x = problem.inward(bad, 0.9 * problem.accuracy * 4**step)
            attempt = self._prove(x)
            if attempt.outcome == "proved":
                verdict = self._decide(bad)
                if verdict.outcome == "proved":  # the limit itself is 0 or infinity, and excluded
                    x, attempt, bad = bad, verdict, problem.extreme
                    verdict = self._decide(bad)
                    if verdict.outcome == "proved":
                        return Bracket(bad, None, None, verdict.evidence, solvers=verdict.solvers)
                return Bracket(
                    x, bad, verdict.outcome, attempt.evidence, verdict.evidence,
                    solvers=attempt.solvers,
                )  # fmt: skip
        return Bracket(None, bad, "undecided", obstacle=attempt.evidence)

    def _first_good(self, bad: float) -> tuple[float | None, Proposal | None]:
        """Steps away from `bad`, each four times the last, until a P is found."""
        problem = self.problem
        is_endless = math.isinf(problem.kept)
        scale = horizon(to_float(problem.F)) if is_endless else abs(problem.kept - bad)
        step = 1e-3 * max(min(scale, bad if bad > 0 else scale), 1e-9)
        while True:
            x = problem.stepped(bad, step)
            proposal = self._propose(x)
            if proposal.P is not None:
                return x, proposal
            if x == problem.kept or step > 1e4 * scale:
                return None, None
            step *= 4

    def _narrow(self, good: float, bad: float, value_bad: float, proposal: Proposal) -> float:
        """Illinois steps on the margin, until good and bad are a fifth of the accuracy apart."""
        value_good, before = proposal.optimum, 0
        for _ in range(_STEPS):
            width = abs(good - bad)
            if width <= 0.2 * self.problem.accuracy * max(abs(good), abs(bad)):
                break
            share = value_bad / (value_bad - value_good) if value_bad < 0 < value_good else 0.5
            least = 0.08 * self.problem.accuracy * max(abs(good), abs(bad)) / width
            share = min(max(share, least, 0.02 * least), 1 - least)
            x = bad + share * (good - bad)
            tried = self._propose(x)
            if tried.P is not None:
                good, value_good = x, tried.optimum
                value_bad *= 0.5 if before == 1 else 1.0
                before = 1
            else:
                bad, value_bad = x, tried.optimum
                value_good *= 0.5 if before == -1 else 1.0
                before = -1
        return bad
