"""Between the last dwell time that a common P proves and the first that is refuted.

Outside, a destabilising sequence of dwell times is followed inwards, to where its growth per jump
falls to one. Inside, windows of dwell times carry proofs outwards, each step starting from the
windows of the last. What is left between them is open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balls import to_float
from lmi.decide.dwell_problem import DwellProblem
from lmi.families import Edge
from lmi.find.window_search import Effort, WindowResult, find_windows
from lmi.find.windows import Windows
from lmi.find.worst_sequence import Word, polished, worst_word
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_word, steps_within
from lmi.solvers import Solvers
from lmi.time_budget import ended_part
from lmi.verdict import Verdict, undecided

_SEED = 20162  # the search for destabilising sequences repeats itself exactly
_WORDS = 6
# each proof leaves this share of the gap that the last one left
_SHARE = 0.25
# and so many attempts may fail, each followed by less bold ones, until the shares are this close
_FAILURES, _SETTLED = 2, 1.5
_EFFORT = Effort(windows=100, work=200_000)


@dataclass(frozen=True)
class Reached:
    """An end that windows prove, with its certificate, or None; and the budget that ended more.

    solvers: those of the certificate.
    """

    end: float | None
    certificate: Entries
    ended: Entries
    solvers: Solvers


@dataclass(frozen=True)
class Gap:
    """What neither one P nor one map decides of a problem."""

    problem: DwellProblem

    def refuted(self, good: float, bad: float, L: Matrix) -> tuple[float, Verdict] | None:
        """The end nearest to `good` for which some sequence destabilises; None if none does.

        L: coordinates in which maps are measured.
        """
        problem = self.problem
        flow, jump = to_float(problem.F), to_float(problem.H)
        rng, x, best = np.random.default_rng(_SEED), bad, None
        for _ in range(_WORDS if problem.budget.remaining() > 0 else 0):
            edge = Edge(flow, jump, *problem.ends(x))
            word = worst_word(edge, L, (), rng, jitter=problem.jitter, budget=problem.budget)
            if word.growth < 1:
                break
            refutation = self._followed(edge, word, good, x)
            if refutation is None:
                break
            best, x = refutation, self._inward(refutation[0], good)
        return best

    def _inward(self, x: float, good: float) -> float:
        """A little nearer to the proved end: another sequence must do better by this much."""
        return x + 1e-3 * (good - x)

    def _followed(
        self, edge: Edge, word: Word, good: float, bad: float
    ) -> tuple[float, Verdict] | None:
        """The word, its dwell times moved along with the range, down to a growth of one."""
        from scipy.optimize import brentq

        problem = self.problem

        def word_at(x: float) -> Word:
            low, high = problem.ends(x)
            thetas = [self._clipped(theta, edge, low, high) for theta in word.thetas]
            return polished(
                replace(edge, low=low, high=high), Word(tuple(thetas), 0.0), problem.jitter
            )

        def excess(x: float) -> float:
            return math.log(word_at(x).growth)

        size = max(abs(bad), abs(good))
        if excess(good) >= 0 or excess(bad) <= 0:
            x = bad
        else:
            x = float(brentq(excess, good, bad, xtol=0.02 * problem.accuracy * size, rtol=1e-12))
        away = 0.1 * problem.accuracy * size * (1 if bad > good else -1)
        for _ in range(5):  # a little further out, where the proof has room
            tried = x + away if abs(x + away - good) < abs(bad - good) else bad
            candidate = word_at(tried)
            if steps_within(candidate.thetas, problem.jitter):
                verdict = refute_word(problem.F, problem.H, candidate.thetas)
                if verdict.outcome == "refuted":
                    return tried, verdict
            away *= 4
        return None

    def _clipped(self, theta: float, edge: Edge, low: float, high: float) -> float:
        """Dwell times at an end of the range stay there."""
        if theta == edge.low:
            return low
        last = replace(edge, low=low, high=high).last
        return last if theta == edge.last else min(max(theta, low), last)

    def attempt(self, x: float) -> Verdict:
        """Windows for the range that ends at x; undecided where the flow would have to decay."""
        if math.isinf(x) and prove_hurwitz(self.problem.F).outcome != "proved":
            return undecided("the flow does not decay")
        return self._windows(x).verdict

    def _windows(self, x: float, start: tuple[Windows, Matrix] | None = None) -> WindowResult:
        problem = self.problem
        return find_windows(
            problem.F, problem.H, *problem.ends(x), jitter=problem.jitter, limits=problem.limits,
            effort=_EFFORT, start=start, budget=problem.budget,
        )  # fmt: skip

    def proved(self, good: float, bad: float) -> Reached:
        """The end nearest to `bad` that windows prove, and what ended the search beyond."""
        problem = self.problem
        best: tuple[float, Verdict] | None = None
        end: NewEntries = {}
        start: tuple[Windows, Matrix] | None = None
        reached, share, failed, failures = 1.0, 0.5, 0.0, 0  # shares of the gap
        while failures < _FAILURES and reached > _SETTLED * failed:
            x = bad + share * (good - bad)
            if start is not None:
                start = widened(start[0], *problem.ends(x)), start[1]
            result = self._windows(x, start)
            if result.verdict.outcome == "proved":
                best, reached = (x, result.verdict), share
                if result.windows is not None and result.L is not None:
                    start = result.windows, result.L
            else:
                end, failed, failures = ended_part(result.verdict.evidence), share, failures + 1
                if problem.budget.ended():
                    break
            if abs(x - bad) <= problem.accuracy * max(abs(x), abs(bad)) / 2:
                break
            share = math.sqrt(reached * failed) if failed else _SHARE * reached
        if best is None:
            return Reached(None, {}, end, ())
        return Reached(best[0], best[1].evidence, end, best[1].solvers)


def widened(windows: Windows, low: float, high: float) -> Windows:
    """The same cuts in a larger range."""
    lower = np.where(windows.lower == windows.low, low, windows.lower)
    upper = np.where(windows.upper == windows.high, high, windows.upper)
    return Windows(low, high, windows.first, lower, upper)
