"""Brackets for families with parameters: dwell times, and how wide all ranges may be.

A smaller range is never harder, so that what is proved and what is refuted are both one interval.
One end is narrowed by certificates, first of few segments and then of many; the other one by words
of parameters, which are followed inwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from lmi.arithmetic.arrays import Entries
from lmi.decide.dwell_search import Bracket
from lmi.decide.uncertain_stability import (
    find_uncertain,
    refuted_by_constants,
    refuted_uncertain,
)
from lmi.find.bang_bang import followed
from lmi.find.clock_matrix import SEGMENTS, find_clock_matrix
from lmi.find.worst_parameters import worst_dwell_time
from lmi.parameters import AffineFamily
from lmi.refute.parameter_words import read_stays, refute_constant_parameters, refute_parameters
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, undecided

Searched = Literal["shortest", "longest", "factor"]

ACCURACY = 1e-4
# few segments narrow the bracket to this, many go on from there
_COARSE = 1e-2
_DOUBLINGS = 40
# a word is looked for so many such steps beyond the first number that is not proved
_STEPS_BEYOND, _STEP_BEYOND = 12, 1.3
# another word has to refute a number so much nearer to what is proved; words that are followed
_SHARE, _WORDS = 0.1, 6


@dataclass(frozen=True)
class UncertainProblem:
    """A family and dwell times [low, high], and which number of it is searched for.

    searched: "shortest" or "longest" dwell time, the other end being kept; or the "factor" by which
    all ranges of parameters may grow around their middle. accuracy: relative width of the bracket.
    """

    family: AffineFamily
    low: float
    high: float
    searched: Searched
    accuracy: float = ACCURACY
    budget: TimeBudget = UNLIMITED

    @property
    def is_inward(self) -> bool:
        """Are smaller numbers the harder ones?"""
        return self.searched == "shortest"

    @property
    def kept(self) -> float:
        """The easiest number."""
        return {"shortest": self.high, "longest": self.low, "factor": 0.0}[self.searched]

    @property
    def extreme(self) -> float:
        """The hardest number."""
        return 0.0 if self.is_inward else math.inf

    @property
    def stated(self) -> float:
        """The number that the search begins with."""
        own = {"shortest": self.low, "longest": self.high, "factor": 1.0}[self.searched]
        if 0 < own < math.inf:
            return own
        size = float(abs(self.family.floats()[0][0]).max(initial=0.0))
        unit = 1 / size if size > 0 else 1.0
        return min(unit, self.high) if self.is_inward else self.low + unit

    def at(self, x: float) -> tuple[AffineFamily, float, float]:
        """The family and the range of dwell times for this number."""
        if self.searched == "factor":
            return self.family.scaled(x), self.low, self.high
        return self.family, *((x, self.high) if self.is_inward else (self.low, x))

    def further(self, x: float, factor: float = 2.0) -> float:
        """A harder number."""
        return x / factor if self.is_inward else x * factor

    def nearer(self, x: float) -> float:
        """An easier one."""
        return min(2 * x, self.kept) if self.is_inward else max(x / 2, self.kept)

    def is_narrow(self, good: float, bad: float, accuracy: float) -> bool:
        """Is this the width that was asked for, or is time over?"""
        is_close = abs(bad - good) <= accuracy * max(abs(good), abs(bad))
        return is_close or self.budget.remaining() < 0


def uncertain_bracket(problem: UncertainProblem) -> Bracket:
    """The searched number up to which stability is proved, and the nearest that is not.

    Evidence as of `lmi.decide.uncertain_stability.decide_uncertain`. Not proved: refuted by a word
    of parameters, or undecided where none was met.
    """
    return _Search(problem).run()


@dataclass(frozen=True)
class _Search:
    problem: UncertainProblem

    def run(self) -> Bracket:
        """Everything, or nothing, or the bracket around the limit."""
        problem = self.problem
        if problem.searched != "factor":
            whole = self._proof(problem.extreme)
            if whole.outcome == "proved":
                return Bracket(problem.extreme, None, None, whole.evidence, solvers=whole.solvers)
        good, bad = self._first()
        if good is None:
            return self._nothing()
        if not self.has_cells:
            good, bad = self._narrowed(good, bad, SEGMENTS[:1])
        far, counter = self._refuted(good[0], bad)
        limit = far if counter.outcome == "refuted" else problem.extreme
        if self.has_cells:
            good, bad = self._narrowed(good, far, SEGMENTS[:1])
        else:
            good, bad = self._improved(good, bad, limit)
        if counter.outcome != "refuted":
            far = bad
        return Bracket(
            good[0], far, counter.outcome, good[1].evidence, counter.evidence,
            ended=problem.budget.ended(), solvers=good[1].solvers,
        )  # fmt: skip

    @property
    def has_cells(self) -> bool:
        """Are certificates made of cells, as those of constant parameters are?"""
        return any(self.problem.family.is_constant)

    def _proof(self, x: float, segments: tuple[int, ...] = SEGMENTS[:1]) -> Verdict:
        """A certificate for this number, with so many segments; with cells for constant p."""
        problem = self.problem
        family, low, high = problem.at(x)
        if self.has_cells:
            return find_uncertain(family, low, high, budget=problem.budget)
        return find_clock_matrix(family, low, high, segments=segments, budget=problem.budget)

    def _first(self) -> tuple[tuple[float, Verdict] | None, float]:
        """(a number that is proved, a harder one that is not), by doubling or halving."""
        problem = self.problem
        x, good, bad = problem.stated, None, problem.extreme
        for _ in range(_DOUBLINGS):
            proof = self._proof(x, SEGMENTS[:1])
            if proof.outcome == "proved":
                good = x, proof
            else:
                bad = x
            if (good is not None and bad != problem.extreme) or problem.budget.remaining() < 0:
                break
            following = problem.nearer(x) if good is None else problem.further(x)
            if following == x:
                break
            x = following
        return good, bad

    def _nothing(self) -> Bracket:
        """The verdict on the easiest number: all that is known where nothing was proved."""
        problem = self.problem
        proof = self._proof(problem.kept, SEGMENTS)
        if proof.outcome == "proved":
            bad, counter = self._refuted(problem.kept, problem.nearer(problem.stated))
            return Bracket(
                problem.kept, bad, counter.outcome, proof.evidence, counter.evidence,
                ended=problem.budget.ended(), solvers=proof.solvers,
            )  # fmt: skip
        counter = refuted_uncertain(*problem.at(problem.kept), budget=problem.budget)
        return Bracket(None, problem.kept, counter.outcome, obstacle=counter.evidence,
                       ended=problem.budget.ended())  # fmt: skip

    def _narrowed(
        self, good: tuple[float, Verdict], bad: float, segments: tuple[int, ...]
    ) -> tuple[tuple[float, Verdict], float]:
        """Bisect between a number that is proved and one that is not."""
        problem = self.problem
        is_last = segments[-1] == SEGMENTS[-1] or self.has_cells
        accuracy = problem.accuracy if is_last else max(_COARSE, problem.accuracy)
        while math.isfinite(bad) and not problem.is_narrow(good[0], bad, accuracy):
            x = (good[0] + bad) / 2
            proof = self._proof(x, segments)
            if proof.outcome == "proved":
                good = x, proof
            else:
                bad = x
        return good, bad

    def _improved(
        self, good: tuple[float, Verdict], bad: float, limit: float
    ) -> tuple[tuple[float, Verdict], float]:
        """Many segments may prove what few do not: from `bad` on, as far as that goes."""
        problem, step = self.problem, 1 + _COARSE
        while problem.budget.remaining() > 0 and bad != limit:
            proof = self._proof(bad, SEGMENTS[-1:])
            if proof.outcome != "proved":
                break
            further = problem.further(bad, step)
            is_beyond = further <= limit if problem.is_inward else further >= limit
            good, bad, step = (bad, proof), limit if is_beyond else further, step**2
        return self._narrowed(good, bad, SEGMENTS[-1:])

    def _refuted(self, good: float, bad: float) -> tuple[float, Verdict]:
        """(the nearest number to `good` that a word refutes, its witness), or `bad`, undecided."""
        problem, x = self.problem, bad
        counter = nearest = self._counter(x)
        for _ in range(_STEPS_BEYOND):
            is_over = x == problem.extreme or problem.budget.remaining() < 0
            if counter.outcome == "refuted" or is_over:
                break
            x = problem.further(x, _STEP_BEYOND)
            counter = self._counter(x)
        if counter.outcome != "refuted":
            return bad, nearest
        for _ in range(_WORDS):
            x, counter = self._followed(good, x, counter)
            nearer = x + _SHARE * (good - x)
            attempt = self._counter(nearer)
            if attempt.outcome != "refuted" or problem.is_narrow(good, x, problem.accuracy):
                break
            x, counter = nearer, attempt
        return x, counter

    def _followed(self, good: float, bad: float, counter: Verdict) -> tuple[float, Verdict]:
        """Bisect towards `good`, as far as the same word, with other durations, refutes."""
        problem, easy = self.problem, good
        while not problem.is_narrow(easy, bad, problem.accuracy / 4):
            middle = (easy + bad) / 2
            attempt = self._nearby(counter.witness, *problem.at(middle))
            if attempt.outcome == "refuted":
                bad, counter = middle, attempt
            else:
                easy = middle
        return bad, counter

    def _nearby(self, witness: Entries, family: AffineFamily, low: float, high: float) -> Verdict:
        """The parameters of a witness with other dwell times, for a family that is nearly its own.

        Constant ones with the worst dwell time alone; a sequence of them is looked for anew.
        """
        if "stays" in witness:
            word = followed(family, low, high, read_stays(witness["stays"])).word
            return refute_parameters(family, low, high, word)
        if "theta" not in witness:
            return refuted_by_constants(family, low, high, budget=self.problem.budget)
        worst = worst_dwell_time(family, tuple(witness["p"]), low, high)
        thetas = () if worst.theta is None else (worst.theta,)
        return refute_constant_parameters(family, worst.p, low, high, thetas)

    def _counter(self, x: float) -> Verdict:
        """Refuted by any word, at this number."""
        if self.problem.searched == "factor" and math.isinf(x):
            return undecided("every factor that was tried is proved")
        return refuted_uncertain(*self.problem.at(x), budget=self.problem.budget)
