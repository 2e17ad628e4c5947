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
from typing import Any

import numpy as np

from lmi.arithmetic.balls import precision
from lmi.arithmetic.norms import float_above, float_below
from lmi.time_budget import Remark, TimeBudget, last_end, sentences
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.document import Claim
from obsdesign.equations.finite_time.options import MOST_SAMPLES, reason_against_problem
from obsdesign.equations.gains import Array
from obsdesign.errors import InputError
from obsdesign.problem.kinds import PERIOD_SEARCHES
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
from obsdesign.verification.finite_time.theorem_1 import Norms
from obsdesign.verification.finite_time.window import observable, sampled_index
from obsdesign.workflow import Outcome

_BITS = 160
_TOO_MANY = (
    f"{{}} samples in a window are more than the {MOST_SAMPLES} that a design may hold: "
    "none has the period that is found"
)
# windows with fewer samples than the shortest one are all shown to fail, up to that many
_MOST_SHOWN = 2000
_SOURCE = "Mazenc, Ahmed, MICNON 2018, Theorem 1, (13)"


@dataclass(frozen=True)
class _Bracket:
    """Ends of a bracket in the searched quantity, with window, samples and L.

    whole_period: a period for which (13) is proved with T = samples * whole_period. remarks: of
    the search for L and window.
    """

    window: float
    samples: int
    L: Array
    claims: tuple[Claim, ...]
    reason: str
    proved: float | None = None
    not_proved: float | None = None
    whole_period: float | None = None
    remarks: tuple[Remark, ...] = ()

    @classmethod
    def empty(cls, window: float, L: Array, reason: str) -> _Bracket:
        """No period or window is known to satisfy (13)."""
        statement = "(13) holds for some period"
        claim = Claim("condition_13", statement, _SOURCE, "undecided", {"reason": reason})
        return cls(window, 0, L, (claim,), reason)

    def to_result(self, is_searched: bool) -> dict[str, Any]:
        """Entries of a search result; is_searched: are L or the window not those of the file?"""
        result: dict[str, Any] = {"proved": None, "not_proved": None, "not_proved_verdict": None}
        result |= {"window": self.window, "gains": {"L": self.L}, "reason": self.reason}
        if self.proved is None:
            return result
        result |= {"proved": self.proved, "not_proved": self.not_proved, "samples": self.samples}
        if self.whole_period is None:
            result |= {"admissible": self.window / self.samples, "admissible_window": self.window}
        else:
            window = self.samples * self.whole_period
            result |= {"admissible": self.whole_period, "admissible_window": window}
        if self.not_proved is not None:
            result["not_proved_verdict"] = "undecided" if is_searched else "refuted"
        return result


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
    period = float(problem.plant.output.period or 1.0)
    options = {} if what == "shortest_window" else _options_without_window(problem)
    if reason := reason_against_problem(problem.plant, options):
        raise InputError(reason)
    with precision(_BITS):
        plant = problem.plant
        first = observable(Sampled.from_plant(plant.flow.A, plant.output.C, period, 1))
        if first.verdict != "proved":
            result = {"proved": None, "not_proved": None, "not_proved_verdict": None}
            return Outcome("refuted", "finite_time", (first,), result, None)
        is_period = what == "longest_period"
        bracket = (_longest_period if is_period else _shortest_window)(problem, period, budget)
        remarks = bracket.remarks
        if bracket.samples > MOST_SAMPLES:
            remarks += (Remark(_TOO_MANY.format(bracket.samples)),)
        extensions, more = _extensions(problem, bracket, None if is_period else period, budget)
        remarks += more
    is_searched = "L" not in problem.gains or (is_period and "window" not in problem.options)
    if remarks:
        extensions["remarks"] = sentences(remarks)
    end = last_end(remarks)
    claims = (first, *bracket.claims)
    verdict = "proved" if all(claim.verdict == "proved" for claim in claims) else "undecided"
    claims = tuple(with_end(claim, end) for claim in claims)
    result = {**bracket.to_result(is_searched), **extensions, **end}
    return Outcome(verdict, "finite_time", claims, result, None)


def _extensions(
    problem: Problem, bracket: _Bracket, period: float | None, budget: TimeBudget
) -> Extensions:
    """Longer periods, or shorter windows at this one, than those of (13) as printed."""
    if period is not None:
        samples = None if bracket.proved is None else bracket.samples
        return shorter_windows(problem, samples, period, budget)
    if bracket.proved is None or not 0 < bracket.proved < math.inf:
        return longer_periods(problem, None, budget)
    plain = Injection(bracket.L, bracket.window, math.log(bracket.proved))
    return longer_periods(problem, plain, budget)


def _options_without_window(problem: Problem) -> dict[str, Any]:
    """Options but for the window, which need not be a multiple of the period of the file."""
    return {name: value for name, value in problem.options.items() if name != "window"}


def _longest_period(problem: Problem, period: float, budget: TimeBudget) -> _Bracket:
    A, C = problem.plant.flow.A, problem.plant.output.C
    given, L = problem.options.get("window"), problem.gains.get("L")
    remarks: tuple[Remark, ...] = ()
    if not np.any(A):  # (13) holds for any period: the window is the only limit
        window, L = given or 2 * period, C.T if L is None else L
    elif given is None or L is None:
        best = best_injection(PeriodProblem(A, C, given, L), budget, effort=LONG_EFFORT)
        window, L, remarks = best.window, best.L, best.remarks
    else:
        window = given
    bracket = replace(_period_bracket(A, C, L, window), remarks=remarks)
    is_open = given is None and bool(np.any(A)) and bracket.not_proved is not None
    return _in_whole_samples(A, C, bracket) if is_open else bracket


def _period_bracket(A: Array, C: Array, L: Array, window: float) -> _Bracket:
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
        claims = (_condition_claim(norms, period, True),)
        return _Bracket(window, least, L, claims, reason, proved=period)
    k = math.floor(window / low) + (window / math.floor(window / low) > low)
    return _Bracket(
        window=window,
        samples=max(k, least),
        L=L,
        claims=(_condition_claim(norms, low, True), _condition_claim(norms, high, False)),
        reason=f"at T = {window!r}, (13) fails beyond",
        proved=low,
        not_proved=high,
    )


def _in_whole_samples(A: Array, C: Array, bracket: _Bracket) -> _Bracket:
    """The bracket with a window nearby, where that allows a longer period T/k."""
    L, window = bracket.L, bracket.window
    best = Injection(L, window, math.log(bracket.proved or math.inf))
    least = needed_samples(A, C, window)
    for period, k in whole_windows(PeriodProblem(A, C, None, L), best, least):
        if period <= window / bracket.samples:
            break
        sampled = Sampled.from_plant(A, C, period, k)
        norms = Norms.from_sampled(sampled, L) if sampled_index(sampled) <= k else None
        if norms is not None and norms.condition(period) is True:
            claim = replace(_condition_claim(norms, period, True), id="condition_13_admissible")
            claims = (*bracket.claims, claim)
            return replace(bracket, samples=k, claims=claims, whole_period=period)
    return bracket


def _shortest_window(problem: Problem, period: float, budget: TimeBudget) -> _Bracket:
    """Ends of (13) in the number of samples at this period."""
    free = PeriodProblem(problem.plant.flow.A, problem.plant.output.C, None, problem.gains.get("L"))
    least = sampled_index(Sampled.from_plant(free.A, free.C, period, len(free.A)))
    k, best = fewest_samples(free, period, least, budget)
    return replace(_window_bracket(problem, period, (least, k), best.L), remarks=best.remarks)


def _window_bracket(
    problem: Problem, period: float, counts: tuple[int, int | None], L: Array
) -> _Bracket:
    """The bracket of a search; counts: the least that determine the state, those with (13)."""
    A, C, (least, k) = problem.plant.flow.A, problem.plant.output.C, counts
    if k is None:
        reason = f"(13) holds for no window with period {period!r}"
        return _Bracket.empty(least * period, L, reason)
    window = k * period
    norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), L)
    if norms is None or norms.condition(period) is not True:
        return _Bracket.empty(window, L, f"(13) is not certain at T = {window:.9g}")
    claims = (_condition_claim(norms, period, True),)
    below = (k - 1) * period
    if k == least:
        reason = f"{least} samples are needed to determine the state"
        return _Bracket(window, k, L, claims, reason, window, below if k > 1 else None)
    shorter = _shorter_windows_claim((A, C, L), period, range(max(least, k - _MOST_SHOWN), k))
    reason = f"(13) is false for all windows of {least} to {k - 1} samples"
    return _Bracket(window, k, L, (*claims, shorter), reason, window, below)


def _shorter_windows_claim(
    plant: tuple[Array, Array, Array], period: float, counts: range
) -> Claim:
    """Claim that (13) is false for every one of these windows; plant: A, C, L."""
    A, C, L = plant
    held = []
    for k in counts:
        norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), L)
        if norms is not None and norms.condition(period) is not False:
            held.append(k)
    evidence: dict[str, Any] = {"samples": [counts.start, counts.stop - 1]}
    if held:
        evidence["reason"] = f"(13) may hold with {held[0]} samples"
    return Claim(
        "shorter_windows",
        f"(13) is false at period {period!r} for windows of {counts.start} to {counts.stop - 1} "
        "samples and this L",
        _SOURCE,
        "undecided" if held else "proved",
        evidence,
    )


def _condition_claim(norms: Norms, period: float, wanted: bool) -> Claim:
    """Claim that (13) holds, or fails, at a period."""
    is_as_wanted = norms.condition(period) is wanted
    word = "holds" if wanted else "fails"
    return Claim(
        "condition_13" if wanted else "condition_13_ends",
        f"(13) {word} at period {period!r}, T = {float_below(norms.T):.9g}",
        _SOURCE,
        "proved" if is_as_wanted else "undecided",
        {} if is_as_wanted else {"reason": f"at {period!r} it is too close to call"},
    )
