"""Between the last dwell time that a common P proves and the first that is refuted.

Outside, a destabilising sequence of dwell times is followed inwards, to where its growth per jump
falls to one. Inside, windows of dwell times carry proofs outwards, each step starting from the
windows of the last. What is left between them is open.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import Exact, to_float
from lmi.families import Edge
from lmi.find.splitting import Limits
from lmi.find.window_search import Budget, find_windows
from lmi.find.windows import Windows
from lmi.find.worst_sequence import Word, polished, worst_word
from lmi.prove.hurwitz import prove_hurwitz
from lmi.refute.spectral import refute_word, steps_within
from lmi.time_budget import ended, ended_part, remaining
from lmi.verdict import Verdict, undecided

Matrix = NDArray[Any]

_SEED = 20162  # the search for destabilising sequences repeats itself exactly
_WORDS = 6
# each proof leaves this share of the gap that the last one left
_SHARE = 0.25
# and so many attempts may fail, each followed by less bold ones, until the shares are this close
_FAILURES, _SETTLED = 2, 1.5
_BUDGET = Budget(windows=100, seconds=2.0)


@dataclass(frozen=True)
class Reached:
    """An end that windows prove, with its certificate, or None; and the budget that ended more."""

    end: float | None
    certificate: Mapping[str, Any]
    ended: Mapping[str, Any]


@dataclass(frozen=True)
class Gap:
    """A pair, the end that is kept, and whether the searched end is the shortest dwell time."""

    F: Exact
    H: Exact
    fixed: float
    shortest: bool
    accuracy: float
    memory: int | Literal["auto"] = "auto"
    jitter: float = math.inf

    def _range(self, x: float) -> tuple[float, float]:
        return (x, self.fixed) if self.shortest else (self.fixed, x)

    def refuted(self, good: float, bad: float, L: Matrix) -> tuple[float, Verdict] | None:
        """The end nearest to `good` for which some sequence destabilises; None if none does.

        L: coordinates in which maps are measured.
        """
        flow, jump = to_float(self.F), to_float(self.H)
        rng, x, best = np.random.default_rng(_SEED), bad, None
        for _ in range(_WORDS if remaining() > 0 else 0):
            edge = Edge(flow, jump, *self._range(x))
            word = worst_word(edge, L, (), rng, jitter=self.jitter)
            if word.growth < 1:
                break
            found = self._followed(edge, word, good, x)
            if found is None:
                break
            best, x = found, self._inward(found[0], good)
        return best

    def _inward(self, x: float, good: float) -> float:
        """A little nearer to the proved end: another sequence must do better by this much."""
        return x + 1e-3 * (good - x)

    def _followed(
        self, edge: Edge, word: Word, good: float, bad: float
    ) -> tuple[float, Verdict] | None:
        """The word, its dwell times moved along with the range, down to a growth of one."""
        from scipy.optimize import brentq

        def at(x: float) -> Word:
            low, high = self._range(x)
            moved = [self._moved(theta, edge, low, high) for theta in word.thetas]
            return polished(replace(edge, low=low, high=high), Word(tuple(moved), 0.0), self.jitter)

        def excess(x: float) -> float:
            return math.log(at(x).growth)

        size = max(abs(bad), abs(good))
        if excess(good) >= 0 or excess(bad) <= 0:
            x = bad
        else:
            x = float(brentq(excess, good, bad, xtol=0.02 * self.accuracy * size, rtol=1e-12))
        away = 0.1 * self.accuracy * size * (1 if bad > good else -1)
        for _ in range(5):  # a little further out, where the proof has room
            tried = x + away if abs(x + away - good) < abs(bad - good) else bad
            found = at(tried)
            if steps_within(found.thetas, self.jitter):
                verdict = refute_word(self.F, self.H, found.thetas)
                if verdict.outcome == "refuted":
                    return tried, verdict
            away *= 4
        return None

    def _moved(self, theta: float, edge: Edge, low: float, high: float) -> float:
        """Dwell times at an end of the range stay there."""
        if theta == edge.low:
            return low
        last = replace(edge, low=low, high=high).last
        return last if theta == edge.last else min(max(theta, low), last)

    def attempt(self, x: float) -> Verdict:
        """Windows for the range that ends at x; undecided where the flow would have to decay."""
        if math.isinf(x) and prove_hurwitz(self.F).outcome != "proved":
            return undecided("the flow does not decay")
        limits = Limits() if self.memory == "auto" else Limits(self.memory, self.memory)
        return find_windows(self.F, self.H, *self._range(x), jitter=self.jitter, limits=limits,
                            budget=_BUDGET).verdict  # fmt: skip

    def proved(self, good: float, bad: float) -> Reached:
        """The end nearest to `bad` that windows prove, and what ended the search beyond."""
        limits = Limits() if self.memory == "auto" else Limits(self.memory, self.memory)
        best: tuple[float, Mapping[str, Any]] | None = None
        end: dict[str, Any] = {}
        start: tuple[Windows, Matrix] | None = None
        reached, share, failed, failures = 1.0, 0.5, 0.0, 0  # shares of the gap
        while failures < _FAILURES and reached > _SETTLED * failed:
            x = bad + share * (good - bad)
            if start is not None:
                start = stretched(start[0], *self._range(x)), start[1]
            found = find_windows(self.F, self.H, *self._range(x), jitter=self.jitter,
                                 limits=limits, budget=_BUDGET, start=start)  # fmt: skip
            if found.verdict.outcome == "proved":
                best, reached = (x, found.verdict.evidence), share
                if found.windows is not None and found.L is not None:
                    start = found.windows, found.L
            else:
                end, failed, failures = ended_part(found.verdict.evidence), share, failures + 1
                if ended():
                    break
            if abs(x - bad) <= self.accuracy * max(abs(x), abs(bad)) / 2:
                break
            share = math.sqrt(reached * failed) if failed else _SHARE * reached
        x_proved, certificate = best or (None, {})
        return Reached(x_proved, certificate, end)


def stretched(windows: Windows, low: float, high: float) -> Windows:
    """The same cuts in a larger range."""
    lower = np.where(windows.lower == windows.low, low, windows.lower)
    upper = np.where(windows.upper == windows.high, high, windows.upper)
    return Windows(low, high, windows.first, lower, upper)
