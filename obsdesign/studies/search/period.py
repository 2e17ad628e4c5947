"""Longest period and shortest window of condition (13), Theorem 1 of Mazenc and Ahmed.

`longest_period` replaces the period of the file: the end of (13) for its window and its L, or for
the best ones where the file leaves them open. `shortest_window` keeps the period and minimises the
number of samples. Both ends are proved in ball arithmetic; where L or the window was searched for,
the far end holds for this L and this window only and is undecided. `period_extensions` lists what
coordinates S and a tighter Lemma 2 gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.balls import precision
from lmi.arithmetic.norms import float_above, float_below
from lmi.time_budget import Remark, TimeBudget, last_end, sentences
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.analysis.finite_time.requirements import reason_against_correction
from obsdesign.document import Claim
from obsdesign.equations.finite_time.gains import MOST_SAMPLES
from obsdesign.equations.finite_time.rows import approx_observability_index
from obsdesign.errors import InputError
from obsdesign.kinds import PERIOD_SEARCHES
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.studies.search.period_extensions import (
    LONG_EFFORT,
    Extensions,
    longer_periods,
    needed_samples,
    shorter_windows,
)
from obsdesign.synthesis.finite_time.injection import best_injection, fewest_samples
from obsdesign.synthesis.finite_time.period_problem import Injection, PeriodProblem
from obsdesign.synthesis.finite_time.whole_windows import whole_windows
from obsdesign.verification.answers import with_end
from obsdesign.verification.finite_time.theorem_1 import (
    Norms,
    condition_claim,
    no_period_claim,
    shorter_windows_claim,
)
from obsdesign.verification.finite_time.window import observable
from obsdesign.workflow import Outcome

_BITS = 160
_TOO_MANY = (
    f"{{}} samples in a window are more than the {MOST_SAMPLES} that a design may hold: "
    "none has the period that is found"
)
# windows with fewer samples than the shortest one are all shown to fail, up to that many
_MOST_SHOWN = 2000


@dataclass(frozen=True)
class _Bracket:
    """Ends of a bracket in the searched quantity, with window, samples and L.

    whole_period: a period for which (13) is proved with T = samples * whole_period. remarks: of
    the search for L and window.
    """

    window: float
    samples: int
    L: Matrix
    claims: tuple[Claim, ...]
    reason: str
    proved: float | None = None
    not_proved: float | None = None
    whole_period: float | None = None
    remarks: tuple[Remark, ...] = ()

    @classmethod
    def empty(cls, window: float, L: Matrix, reason: str) -> _Bracket:
        """No period or window is known to satisfy (13)."""
        return cls(window, 0, L, (no_period_claim(reason),), reason)

    def to_result(self, is_searched: bool) -> NewEntries:
        """Entries of a search result; is_searched: are L or the window not those of the file?"""
        far_end = "undecided" if is_searched else "refuted"
        result: NewEntries = {
            "proved": self.proved,
            "not_proved": self.not_proved,
            "not_proved_verdict": None if self.not_proved is None else far_end,
            "window": self.window,
            "gains": {"L": self.L},
            "reason": self.reason,
        }
        if self.proved is None:
            return result
        admissible, window = self.window / self.samples, self.window
        if self.whole_period is not None:
            admissible, window = self.whole_period, self.samples * self.whole_period
        return result | {
            "samples": self.samples,
            "admissible": admissible,
            "admissible_window": window,
        }


def search_period(problem: Problem, what: str, budget: TimeBudget) -> Outcome:
    """Return the bracket for `what`.

    result: {"proved", "not_proved", "not_proved_verdict", "admissible", "samples", "window",
    "gains", "reason"}; admissible is the longest period that (13) allows with a whole number of
    samples in a window: in this window, or where the window is open in admissible_window =
    samples * admissible, if that is longer. "coordinates" and "tighter" are those of
    `period_extensions`, "remarks" sentences of searches that ended early. Refuted when (A, C)
    is not observable or (13) holds for nothing. InputError as for a design.
    """
    if what not in PERIOD_SEARCHES:
        raise InputError(f"--for {what} is not available for kind 'finite_time'.")
    problem.require_measured("periodic")
    period, options = problem.plant.output.sample_period, problem.options_as(FiniteTimeOptions)
    is_period = what == "longest_period"
    # the window of the file need not be a multiple of its period
    if is_period and (reason := reason_against_correction(options)):
        raise InputError(reason)
    printed = PeriodProblem.from_problem(problem, options.window if is_period else None)
    with precision(_BITS):
        first = observable(Sampled.from_plant(printed.A, printed.C, period, 1))
        if first.verdict != "proved":
            result = {"proved": None, "not_proved": None, "not_proved_verdict": None}
            return Outcome("refuted", "finite_time", (first,), result, None)
        bracket = (_longest_period if is_period else _shortest_window)(printed, period, budget)
        remarks = bracket.remarks
        if bracket.samples > MOST_SAMPLES:
            remarks += (Remark(_TOO_MANY.format(bracket.samples)),)
        extensions, more = _extensions(printed, bracket, None if is_period else period, budget)
        remarks += more
    is_searched = printed.L is None or (is_period and printed.window is None)
    if remarks:
        extensions |= {"remarks": sentences(remarks)}
    end = last_end(remarks)
    claims = (first, *bracket.claims)
    verdict = "proved" if all(claim.verdict == "proved" for claim in claims) else "undecided"
    claims = tuple(with_end(claim, end) for claim in claims)
    result = {**bracket.to_result(is_searched), **extensions, **end}
    return Outcome(verdict, "finite_time", claims, result, None)


def _extensions(
    printed: PeriodProblem, bracket: _Bracket, period: float | None, budget: TimeBudget
) -> Extensions:
    """Longer periods, or shorter windows at this one, than those of (13) as printed."""
    if period is not None:
        samples = None if bracket.proved is None else bracket.samples
        return shorter_windows(printed, samples, period, budget)
    if bracket.proved is None or not 0 < bracket.proved < math.inf:
        return longer_periods(printed, None, budget)
    plain = Injection(bracket.L, bracket.window, math.log(bracket.proved))
    return longer_periods(printed, plain, budget)


def _longest_period(problem: PeriodProblem, period: float, budget: TimeBudget) -> _Bracket:
    A, C, window, L = problem.A, problem.C, problem.window, problem.L
    if not np.any(A):  # (13) holds for any period: the window is the only limit
        return _period_bracket(A, C, C.T if L is None else L, window or 2 * period)
    if window is not None and L is not None:
        return _period_bracket(A, C, L, window)
    best = best_injection(problem, budget, effort=LONG_EFFORT)
    bracket = replace(_period_bracket(A, C, best.L, best.window), remarks=best.remarks)
    is_open = window is None and bracket.not_proved is not None
    return _in_whole_samples(A, C, bracket) if is_open else bracket


def _period_bracket(A: Matrix, C: Matrix, L: Matrix, window: float) -> _Bracket:
    """Ends of (13) in the period, for a fixed L and window."""
    norms = Norms.from_sampled(Sampled.from_plant(A, C, window, 1), L)
    if norms is None:
        return _Bracket.empty(window, L, f"M_T is not certainly invertible at T = {window!r}")
    longest = norms.longest_period()
    low, high = (
        (math.inf, math.inf) if longest is None else (float_below(longest), float_above(longest))
    )
    if not low > window * 2.0**-52:
        reason = f"at T = {window!r} (13) allows periods below {high:.3g} only: too many samples"
        return _Bracket.empty(window, L, reason)
    least = needed_samples(A, C, window)
    if low * least > window:
        reason = f"the window {window!r} has to hold {least} samples; (13) would allow more"
        period = window / least
        claims = (condition_claim(norms, period, "condition_13", "proved"),)
        return _Bracket(window, least, L, claims, reason, proved=period)
    k = math.floor(window / low) + (window / math.floor(window / low) > low)
    return _Bracket(
        window=window,
        samples=max(k, least),
        L=L,
        claims=(
            condition_claim(norms, low, "condition_13", "proved"),
            condition_claim(norms, high, "condition_13_ends", "refuted"),
        ),
        reason=f"at T = {window!r}, (13) fails beyond",
        proved=low,
        not_proved=high,
    )


def _in_whole_samples(A: Matrix, C: Matrix, bracket: _Bracket) -> _Bracket:
    """The bracket with a window nearby, where that allows a longer period T/k."""
    L, window = bracket.L, bracket.window
    best = Injection(L, window, math.log(bracket.proved or math.inf))
    least = needed_samples(A, C, window)
    for period, k in whole_windows(PeriodProblem(A, C, None, L), best, least):
        if period <= window / bracket.samples:
            break
        if (approx_observability_index(A, C, period) or len(A)) > k:
            continue
        norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), L)
        if norms is not None and norms.condition(period) == "proved":
            claim = condition_claim(norms, period, "condition_13_admissible", "proved")
            claims = (*bracket.claims, claim)
            return replace(bracket, samples=k, claims=claims, whole_period=period)
    return bracket


def _shortest_window(problem: PeriodProblem, period: float, budget: TimeBudget) -> _Bracket:
    """Ends of (13) in the number of samples at this period."""
    least = approx_observability_index(problem.A, problem.C, period) or len(problem.A)
    k, best = fewest_samples(problem, period, least, budget)
    return replace(_window_bracket(problem, period, (least, k), best.L), remarks=best.remarks)


def _window_bracket(
    problem: PeriodProblem, period: float, counts: tuple[int, int | None], L: Matrix
) -> _Bracket:
    """The bracket of a search; counts: the least that determine the state, those with (13)."""
    A, C, (least, k) = problem.A, problem.C, counts
    if k is None:
        reason = f"(13) holds for no window with period {period!r}"
        return _Bracket.empty(least * period, L, reason)
    window = k * period
    norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), L)
    if norms is None or norms.condition(period) != "proved":
        return _Bracket.empty(window, L, f"(13) is not certain at T = {window:.9g}")
    claims = (condition_claim(norms, period, "condition_13", "proved"),)
    below = (k - 1) * period
    if k == least:
        reason = f"{least} samples are needed to determine the state"
        return _Bracket(window, k, L, claims, reason, window, below if k > 1 else None)
    shorter = shorter_windows_claim(A, C, L, period, range(max(least, k - _MOST_SHOWN), k))
    reason = f"(13) is false for all windows of {least} to {k - 1} samples"
    return _Bracket(window, k, L, (*claims, shorter), reason, window, below)
