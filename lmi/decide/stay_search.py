"""Shortest and longest stays in modes: a bracket of one end of their ranges.

A smaller range is never harder. One side is narrowed by certificates with one P for each mode, the
other one by cycles of stays, and what is left between them by cells of the stay before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lmi.decide.dwell_problem import Direction
from lmi.decide.dwell_search import ACCURACY, Bracket
from lmi.decide.mode_stability import decide_modes, refuted_by_word
from lmi.find.mode_search import ModeSearch, find_modes
from lmi.find.worst_stays import followed
from lmi.modes import Modes, StayWord
from lmi.refute.stays import refute_stays
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict

_DOUBLINGS, _STEPS, _CELL_STEPS = 40, 60, 6
# with cells a bracket is narrowed to this part of the gap that one P for each mode leaves
_WORTH_CELLS = 1e-5


def stay_bracket(
    modes: Modes,
    direction: Direction,
    searched: Sequence[int],
    *,
    accuracy: float = ACCURACY,
    budget: TimeBudget = UNLIMITED,
) -> Bracket:
    """The smallest x that stays of the searched modes may have, or the largest.

    direction: "shortest" with the longest stays kept, or "longest" with the shortest kept.
    accuracy: relative width of the bracket.
    """
    return _Search(modes, direction, tuple(searched), accuracy, budget).run()


@dataclass(frozen=True)
class _Search:
    modes: Modes
    direction: Direction
    searched: tuple[int, ...]
    accuracy: float
    budget: TimeBudget

    @property
    def is_shortest(self) -> bool:
        return self.direction == "shortest"

    @property
    def kept(self) -> float:
        """The end of the smallest ranges: of their other ends that which comes first."""
        ends = [self.modes.stays[i] for i in self.searched]
        return min(high for _, high in ends) if self.is_shortest else max(low for low, _ in ends)

    @property
    def stated(self) -> float:
        """The end as the modes state it: the weakest of all."""
        ends = [self.modes.stays[i] for i in self.searched]
        return min(max(low for low, _ in ends), self.kept) if self.is_shortest else max(
            min(high for _, high in ends), self.kept
        )  # fmt: skip

    def modes_with(self, x: float) -> Modes:
        """The modes with the searched end at x."""
        stays = list(self.modes.stays)
        for i in self.searched:
            low, high = stays[i]
            stays[i] = (x, high) if self.is_shortest else (low, x)
        return self.modes.with_stays(stays)

    def run(self) -> Bracket:
        """Everything proved, or nothing, or the bracket around the limit."""
        extreme = 0.0 if self.is_shortest else math.inf
        whole = self._plain(extreme)
        if whole.verdict.outcome == "proved":
            return Bracket(
                extreme, None, None, whole.verdict.evidence, solvers=whole.verdict.solvers
            )
        good, bad = self._ends(extreme)
        if good is None:
            verdict = decide_modes(self.modes_with(self.kept), budget=self.budget)
            if verdict.outcome != "proved":
                return Bracket(None, self.kept, verdict.outcome, obstacle=verdict.evidence,
                               ended=self.budget.ended())  # fmt: skip
            good = self.kept, verdict
        good, bad = self._narrowed(*good, bad, _STEPS, with_cells=False)
        far, word = self._refuted(good[0], bad)
        if word is not None and abs(far - good[0]) > max(self.accuracy, _WORTH_CELLS) * far:
            good, _ = self._narrowed(*good, far, _CELL_STEPS, with_cells=True)
        obstacle = decide_modes(self.modes_with(bad), budget=self.budget) if word is None else word
        outcome = obstacle.outcome if obstacle.outcome == "refuted" else "undecided"
        return Bracket(
            good[0], far, outcome, good[1].evidence, obstacle.evidence, ended=self.budget.ended(),
            solvers=good[1].solvers,
        )  # fmt: skip

    def _plain(self, x: float) -> ModeSearch:
        """One P for each mode."""
        return find_modes(self.modes_with(x), most_cells=len(self.modes), budget=self.budget)

    def _ends(self, extreme: float) -> tuple[tuple[float, Verdict] | None, float]:
        """(an end that is proved, one beyond it that is not), by doubling or halving."""
        x, good, bad = self.stated, None, extreme
        if math.isinf(x):
            x = max(2 * self.kept, max(math.isfinite(h) * h for h in self.modes.horizons))
        if x == 0:
            x = min(min(h for h in self.modes.horizons if h > 0), self.kept)
        for _ in range(_DOUBLINGS):
            attempt = self._plain(x).verdict
            if attempt.outcome == "proved":
                good = x, attempt
                further = x / 2 if self.is_shortest else 2 * x
            else:
                bad = x
                if x == self.kept:
                    return None, bad
                further = min(2 * x, self.kept) if self.is_shortest else max(
                    x / 2, self.kept
                )  # fmt: skip
            if good is not None and bad != extreme:
                return good, bad
            if self.budget.remaining() < 0:
                break
            x = further
        return good, bad

    def _narrowed(
        self, good: float, proof: Verdict, bad: float, steps: int, *, with_cells: bool
    ) -> tuple[tuple[float, Verdict], float]:
        """Bisect between an end that is proved and one that is not."""
        for _ in range(steps):
            if abs(bad - good) <= 0.2 * self.accuracy * max(good, bad) or (
                self.budget.remaining() < 0
            ):
                break
            x = good * 2 if math.isinf(bad) else (good + bad) / 2
            many = (
                find_modes(self.modes_with(x), budget=self.budget) if with_cells else self._plain(x)
            )
            if many.verdict.outcome == "proved":
                good, proof = x, many.verdict
            else:
                bad = x
        return (good, proof), bad

    def _refuted(self, good: float, bad: float) -> tuple[float, Verdict | None]:
        """The nearest end beyond `good` that a cycle of stays refutes; (bad, None) if none does."""
        x, step = bad, abs(bad - good)
        for _ in range(_DOUBLINGS):
            verdict = refuted_by_word(self.modes_with(x), (), budget=self.budget)
            if verdict.outcome == "refuted":
                return self._nearest(good, x, verdict)
            further = max(x - step, x / 2) if self.is_shortest else x + step
            if math.isinf(further) or not 1e-9 < further < 1e9 or step > 4 * max(x, 1e-12):
                break
            x, step = further, 4 * step
            if self.budget.remaining() < 0:
                break
        return bad, None

    def _nearest(self, good: float, bad: float, verdict: Verdict) -> tuple[float, Verdict]:
        """Bisect between `good` and a refuted end, by following its cycle."""
        names = {name: i for i, name in enumerate(self.modes.names)}
        if "stays" not in verdict.witness:
            return bad, verdict
        word: StayWord = tuple((names[name], theta) for name, theta in verdict.witness["stays"])
        for _ in range(_STEPS):
            if abs(bad - good) <= 0.2 * self.accuracy * max(good, bad):
                break
            x = (good + bad) / 2
            tried = followed(self.modes_with(x), word)
            attempt = refute_stays(self.modes_with(x), tried.word)
            if attempt.outcome == "refuted":
                bad, verdict, word = x, attempt, tried.word
            else:
                good = x
        return bad, verdict
