"""Shortest and longest dwell time for a given pair: a bracket, proved on one side.

The searched end x of the range is monotone: a smaller range is never harder. Where the spectral
radius of one map crosses 1, no x beyond it can be proved, and usually every x before it can: then
one proof and one refutation settle the bracket. Otherwise the margin of the semidefinite program,
which changes sign at the limit, is followed by a bracketing secant method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import Exact, exact, to_float
from lmi.decide.dwell_gap import Gap
from lmi.decide.dwell_scan import scan
from lmi.decide.stability import Memory, decide, find_and_prove
from lmi.families import horizon
from lmi.find.cutting_plane import Proposal, propose
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_word
from lmi.time_budget import ended
from lmi.verdict import Verdict

Matrix = NDArray[Any]

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
    budget that ended a search between proved and not proved, as `lmi.time_budget.ended` has it.
    """

    proved: float | None
    not_proved: float | None
    verdict: str | None
    certificate: Mapping[str, Any] = field(default_factory=dict)
    obstacle: Mapping[str, Any] = field(default_factory=dict)
    islands: tuple[tuple[float, float], ...] = ()
    common: float | None = None
    ended: Mapping[str, Any] = field(default_factory=dict)


def shortest_dwell(
    F: ArrayLike,
    H: ArrayLike,
    high: float,
    *,
    accuracy: float = ACCURACY,
    memory: Memory = "auto",
    jitter: float = math.inf,
) -> Bracket:
    """Smallest x for which [x, high] is proved; high may be infinite.

    F, H: (n, n) floats or exact rationals. accuracy: relative width of the bracket. memory, jitter:
    as in `lmi.decide.stability`.
    """
    return _Search(exact(F), exact(H), high, accuracy, True, memory, jitter).balanced()


def longest_dwell(
    F: ArrayLike,
    H: ArrayLike,
    low: float,
    *,
    accuracy: float = ACCURACY,
    memory: Memory = "auto",
    jitter: float = math.inf,
) -> Bracket:
    """Largest x for which [low, x] is proved, possibly infinity; arguments as `shortest_dwell`."""
    return _Search(exact(F), exact(H), low, accuracy, False, memory, jitter).balanced()


@dataclass(frozen=True)
class _Search:
    F: Exact
    H: Exact
    fixed: float
    accuracy: float
    shortest: bool
    memory: Memory = "auto"
    jitter: float = math.inf

    def balanced(self) -> Bracket:
        """The bracket, found in coordinates that balance the pair."""
        longest = self.fixed if self.shortest else math.inf
        scaling = Scaling.of(self.F, self.H, longest)
        found = replace(self, F=scaling.map(self.F), H=scaling.map(self.H)).run()
        certificate, obstacle = (
            scaling.restored(evidence, self.H) for evidence in (found.certificate, found.obstacle)
        )
        return replace(found, certificate=certificate, obstacle=obstacle)

    def run(self) -> Bracket:
        """Everything proved; or nothing; or the bracket around the limit."""
        extreme = 0.0 if self.shortest else math.inf
        hopeless = self._hopeless()
        if hopeless is not None:
            evidence = hopeless.evidence
            return Bracket(None, self.fixed, hopeless.outcome, obstacle=evidence, ended=ended())
        looked = scan(self.F, self.H, self.fixed, self.shortest)
        crossing, last = looked.crossing, looked.last
        # windows go on from where a common P ends: no need to know that end exactly
        common = self if self.memory == 0 else replace(self, accuracy=max(_COARSE, self.accuracy))
        if crossing is None:
            whole = self._prove(extreme)
            if whole.outcome == "proved":
                return Bracket(extreme, None, None, whole.evidence)
            bracket = common._up_to(last, whole)
        else:
            bracket = self._at(crossing) or common._follow(crossing)
        if bracket.verdict == "undecided" and self.memory != 0:
            bracket = self._beyond_common(bracket, crossing, last, extreme)
        return replace(bracket, islands=looked.islands, ended=ended() or bracket.ended)

    def _beyond_common(
        self, bracket: Bracket, crossing: float | None, last: float, extreme: float
    ) -> Bracket:
        """Windows of dwell times on the proved side, destabilising sequences on the other."""
        common = bracket.proved
        good = self.fixed if common is None else common
        if math.isinf(good):
            return bracket
        gap = Gap(self.F, self.H, self.fixed, self.shortest, self.accuracy, self.memory,
                  self.jitter)  # fmt: skip
        P = bracket.certificate.get("P")
        L = np.eye(len(self.F)) if P is None else np.linalg.cholesky(np.array(P))
        far = last if crossing is None else self._inward(crossing, -0.4 * self.accuracy)
        outside = gap.refuted(good, far, L)
        if outside is None:
            for end in dict.fromkeys((extreme, far) if crossing is None else ()):
                whole = gap.attempt(end)
                if whole.outcome == "proved":
                    rest = None if end == extreme else extreme
                    word = None if end == extreme else "undecided"
                    return Bracket(end, rest, word, whole.evidence, common=common)
        limit = far if outside is None else outside[0]
        further = gap.proved(good, limit)
        certificate = bracket.certificate if further.end is None else further.certificate
        reached = common if further.end is None else further.end
        word, obstacle = "undecided", bracket.obstacle
        if outside is not None:
            word, obstacle = "refuted", outside[1].evidence
        return Bracket(reached, limit, word, certificate, obstacle, (), common, further.ended)

    def _hopeless(self) -> Verdict | None:
        """The verdict on the smallest range there is, if that is not proved."""
        if self.shortest and math.isinf(self.fixed):
            flow = prove_hurwitz(self.F)
            return None if flow.outcome == "proved" else flow
        one = decide(self.F, self.H, self.fixed, self.fixed, memory=0)
        return None if one.outcome == "proved" else one

    def _range(self, x: float) -> tuple[float, float]:
        return (x, self.fixed) if self.shortest else (self.fixed, x)

    def _floats(self) -> tuple[Matrix, Matrix]:
        return to_float(self.F), to_float(self.H)

    def _inward(self, x: float, relative: float) -> float:
        """x moved towards the fixed end, so far and not past it."""
        if self.shortest:
            return min(x * (1 + relative), self.fixed)
        return max(x * (1 - relative), self.fixed)

    def _prove(self, x: float) -> Verdict:
        low, high = self._range(x)
        if math.isinf(high) and prove_hurwitz(self.F).outcome != "proved":
            return decide(self.F, self.H, low, high, memory=0)
        return find_and_prove(self.F, self.H, low, high)[0]

    def _propose(self, x: float) -> Proposal:
        return propose(*self._floats(), *self._range(x))

    def _up_to(self, last: float, whole: Verdict) -> Bracket:
        """No single map is expanding: everything that was looked at, or the limit before it."""
        if not self.shortest:
            good = self._prove(last)
            if good.outcome == "proved":
                return Bracket(last, math.inf, whole.outcome, good.evidence, whole.evidence)
        return self._follow(last)

    def _at(self, crossing: float) -> Bracket | None:
        """The bracket if the radius of one map is what limits the range."""
        inside = self._inward(crossing, 0.4 * self.accuracy)
        outside = self._inward(crossing, -0.4 * self.accuracy)
        good = self._prove(inside)
        if good.outcome != "proved":
            return None
        bad = refute_word(self.F, self.H, (outside,))
        if bad.outcome != "refuted":
            bad = decide(self.F, self.H, *self._range(outside), memory=0)
        return Bracket(inside, outside, bad.outcome, good.evidence, bad.evidence)

    def _follow(self, bad: float) -> Bracket:
        """From an end that cannot be proved towards the fixed one, by the sign of the margin."""
        good, proposal = self._first_good(bad)
        if good is None or proposal is None:
            verdict = decide(self.F, self.H, *self._range(bad), memory=0)
            return Bracket(None, bad, verdict.outcome, obstacle=verdict.evidence)
        value_bad = self._propose(bad).optimum
        bad = self._narrow(good, bad, value_bad, proposal)
        for step in range(8):  # a proof needs a little more margin than floats see
            x = self._inward(bad, 0.9 * self.accuracy * 4**step)
            attempt = self._prove(x)
            if attempt.outcome == "proved":
                verdict = decide(self.F, self.H, *self._range(bad), memory=0)
                if verdict.outcome == "proved":  # the limit itself is 0 or infinity, and excluded
                    x, attempt = bad, verdict
                    bad = 0.0 if self.shortest else math.inf
                    verdict = decide(self.F, self.H, *self._range(bad), memory=0)
                    if verdict.outcome == "proved":
                        return Bracket(bad, None, None, verdict.evidence)
                return Bracket(x, bad, verdict.outcome, attempt.evidence, verdict.evidence)
        return Bracket(None, bad, "undecided", obstacle=attempt.evidence)

    def _first_good(self, bad: float) -> tuple[float | None, Proposal | None]:
        """Steps away from `bad`, each twice the last, until a P is found."""
        F, _ = self._floats()
        scale = horizon(F) if math.isinf(self.fixed) else abs(self.fixed - bad)
        step = 1e-3 * max(min(scale, bad if bad > 0 else scale), 1e-9)
        x = bad
        while True:
            x = bad + step if self.shortest else bad - step
            past = x >= self.fixed if self.shortest else x <= self.fixed
            x = self.fixed if past else x
            proposal = self._propose(x)
            if proposal.P is not None:
                return x, proposal
            if past or step > 1e4 * scale:
                return None, None
            step *= 4

    def _narrow(self, good: float, bad: float, value_bad: float, proposal: Proposal) -> float:
        """Illinois steps on the margin, until good and bad are a fifth of the accuracy apart."""
        value_good, before = proposal.optimum, 0
        for _ in range(_STEPS):
            width = abs(good - bad)
            if width <= 0.2 * self.accuracy * max(abs(good), abs(bad)):
                break
            share = value_bad / (value_bad - value_good) if value_bad < 0 < value_good else 0.5
            least = 0.08 * self.accuracy * max(abs(good), abs(bad)) / width
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
