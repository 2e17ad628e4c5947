"""Longest period and shortest window of condition (13), Theorem 1 of Mazenc and Ahmed.

`longest_period` replaces the period of the file: the end of (13) for its window and its L, or for
those that are found where the file leaves them open. `shortest_window` keeps the period and looks
for the fewest samples. Both ends are proved in ball arithmetic; where L or the window was searched
for, the far end speaks of the found ones only and is undecided.

What lets Theorem 1 hold for longer periods than (13) as printed: coordinates S, and a tighter
Lemma 2 (`tighter_sigma`). Both change the bound, not the observer; each is told beside (13).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import precision
from lmi.arithmetic.norms import float_above, float_below
from lmi.time_budget import collect_remarks, remark, sentences
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.document import Claim
from obsdesign.equations.finite_time import gains as equations
from obsdesign.errors import InputError
from obsdesign.problem.kinds import PERIOD_SEARCHES
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.injection import (
    SECONDS,
    Injection,
    Open,
    best_injection,
    fewest_samples,
)
from obsdesign.synthesis.finite_time.whole_windows import whole_windows
from obsdesign.verification.answers import with_end
from obsdesign.verification.finite_time.theorem_1 import Sizes
from obsdesign.verification.finite_time.window import observable, sampled_index
from obsdesign.workflow import Outcome

# told where it gains more than rounding
_BETTER = 1 + 1e-6


def longer_periods(problem: Problem, plain: Injection | None) -> dict[str, Any]:
    """{"coordinates": {"S", "L", "window", "proved"}, "tighter": the same}, where they gain.

    proved: a period for which the condition is proved; plain: what (13) allows, log_period that
    of the proved one, if any. S is [] where it is I.
    """
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    if not np.any(A) or (L is not None and not np.any(L @ C)):
        return {}
    asked = Open(A, C, problem.options.get("window"), L)
    first = () if plain is None else (plain,)
    least = 0.0 if plain is None else math.exp(plain.log_period)
    told = {}
    moved = best_injection(replace(asked, coordinates=True), first, seconds=_SECONDS)
    longest = _proved(asked, moved)
    if longest > least * _BETTER:
        told["coordinates"] = _told(moved, longest)
    asked = replace(asked, tighter=True)
    found = best_injection(asked, first, seconds=SECONDS)
    longest = _proved(asked, found)
    moved = best_injection(replace(asked, coordinates=True), (found,), seconds=_SECONDS)
    further = _proved(asked, moved)
    if further > longest * _BETTER:
        found, longest = moved, further
    if longest > least * _BETTER:
        told["tighter"] = _told(found, longest)
    return told


def shorter_windows(problem: Problem, plain: int | None, period: float) -> dict[str, Any]:
    """The same with "samples", and the window as "proved"; plain: the fewest samples of (13)."""
    A, C, L = problem.plant.flow.A, problem.plant.output.C, problem.gains.get("L")
    if not np.any(A) or (L is not None and not np.any(L @ C)):
        return {}
    told = {}
    least = sampled_index(Sampled.of(A, C, period, len(A)))
    for name in ("coordinates", "tighter"):
        asked = Open(A, C, None, L, **{name: True})
        k, found = fewest_samples(asked, period, least)
        if k is None or (plain is not None and k >= plain):
            continue
        sizes = Sizes.of(Sampled.of(A, C, period, k), found.L, found.S)
        if sizes is not None and sizes.condition(period, asked.tighter) is True:
            window = k * period
            told[name] = _told(replace(found, window=window), window) | {"samples": k}
    return told


def _proved(asked: Open, found: Injection) -> float:
    """A period for which the condition is proved; 0 where there is none."""
    sizes = Sizes.of(Sampled.of(asked.A, asked.C, found.window, 1), found.L, found.S)
    longest = None if sizes is None else sizes.longest_period(asked.tighter)
    if sizes is None or longest is None:
        return 0.0
    most = found.window / needed_samples(asked.A, asked.C, found.window)
    period = min(float_below(longest), most)
    return period if sizes.condition(period, asked.tighter) is True else 0.0


def _told(found: Injection, value: float) -> dict[str, Any]:
    S = [] if found.S is None else found.S.tolist()
    return {"S": S, "L": found.L, "window": found.window, "proved": value}


def needed_samples(A: Any, C: Any, window: float) -> int:
    """The least k for which k samples, window/k apart, determine the state."""
    for k in range(1, len(A) + 1):
        if sampled_index(Sampled.of(A, C, window / k, k)) <= k:
            return k
    return len(A)


_BITS = 160
_TOO_MANY = (
    f"{{}} samples in a window are more than the {equations.MOST_SAMPLES} that a design may hold: "
    "none has the period that is found"
)
# windows with fewer samples than the one that is found are all shown to fail, up to that many
_MOST_SHOWN = 2000
_SECONDS = 2.0
_SOURCE = "Mazenc, Ahmed, MICNON 2018, Theorem 1, (13)"


@dataclass(frozen=True)
class _Found:
    """Ends of a bracket in the searched quantity, with window, samples and L."""

    proved: float | None
    not_proved: float | None
    window: float
    samples: int
    L: Any
    claims: tuple[Claim, ...]
    reason: str | None
    whole: float | None = None  # a period for which (13) is proved with T = samples * whole


def search_period(problem: Problem, what: str) -> Outcome:
    """The bracket for `what`.

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
    asked = {} if what == "shortest_window" else _without_window(problem)
    if text := equations.objection(problem.plant, asked):
        raise InputError(text)
    with collect_remarks() as remarks, precision(_BITS):
        first = observable(Sampled.of(problem.plant.flow.A, problem.plant.output.C, period, 1))
        if first.verdict != "proved":
            return _outcome(problem, None, first, False)
        find = _longest_period if what == "longest_period" else _shortest_window
        found = find(problem, period)
        if found.samples > equations.MOST_SAMPLES:
            remark(_TOO_MANY.format(found.samples))
        better = _better(problem, found, None if what == "longest_period" else period)
    searched = "L" not in problem.gains or (what, "window" in problem.options) == (
        "longest_period", False,
    )  # fmt: skip
    outcome = _outcome(problem, found, first, searched)
    if remarks:
        better["remarks"] = sentences(remarks)
    end = next((one.evidence for one in reversed(remarks) if one.evidence), {})
    claims = tuple(with_end(claim, end) for claim in outcome.claims)
    return replace(outcome, claims=claims, result={**outcome.result, **better, **end})


def _better(problem: Problem, found: _Found, period: float | None) -> dict[str, Any]:
    """Longer periods, or shorter windows at this one, than those of (13) as printed."""
    if period is not None:
        return shorter_windows(problem, None if found.proved is None else found.samples, period)
    if found.proved is None or not 0 < found.proved < math.inf:
        return longer_periods(problem, None)
    return longer_periods(problem, Injection(found.L, found.window, math.log(found.proved)))


def _without_window(problem: Problem) -> dict[str, Any]:
    """Options but for the window: it need not be a multiple of a period that is searched for."""
    return {name: value for name, value in problem.options.items() if name != "window"}


def _longest_period(problem: Problem, period: float) -> _Found:
    A, C = problem.plant.flow.A, problem.plant.output.C
    given = problem.options.get("window")
    L = problem.gains.get("L")
    if not np.any(A):  # (13) holds for any period: the window is all there is
        window, L = given or 2 * period, C.T if L is None else L
    elif given is None or L is None:
        best = best_injection(Open(A, C, given, L), seconds=_SECONDS)
        window, L = best.window, best.L
    else:
        window = given
    sizes = Sizes.of(Sampled.of(A, C, window, 1), L)
    if sizes is None:
        return _nothing(window, L, f"M_T is not certainly invertible at T = {window!r}")
    longest = sizes.longest_period()
    ends = (math.inf, math.inf) if longest is None else (float_below(longest), float_above(longest))
    if not ends[0] > window * 2.0**-52:
        reason = f"at T = {window!r} (13) allows periods below {ends[1]:.3g} only: too many samples"
        return _nothing(window, L, reason)
    least = needed_samples(A, C, window)
    if ends[0] * least > window:
        reason = f"the window {window!r} has to hold {least} samples; (13) would allow more"
        period = window / least
        only = (_condition(sizes, period, True),)
        return _Found(period, None, window, least, L, only, reason)
    claims = (_condition(sizes, ends[0], True), _condition(sizes, ends[1], False))
    k = math.floor(window / ends[0]) + (window / math.floor(window / ends[0]) > ends[0])
    reason = f"at T = {window!r}, (13) fails beyond"
    found = _Found(ends[0], ends[1], window, max(k, least), L, claims, reason)
    return found if given is not None or not np.any(A) else _in_whole_samples(A, C, found)


def _in_whole_samples(A: Any, C: Any, found: _Found) -> _Found:
    """With another window near the found one, where that allows a longer period T/k."""
    asked = Open(A, C, None, found.L)
    best = Injection(found.L, found.window, math.log(found.proved or math.inf))
    least = needed_samples(A, C, found.window)
    for period, k in whole_windows(asked, best, least):
        if period <= found.window / found.samples:
            break
        sampled = Sampled.of(A, C, period, k)
        sizes = Sizes.of(sampled, found.L) if sampled_index(sampled) <= k else None
        if sizes is not None and sizes.condition(period) is True:
            claim = replace(_condition(sizes, period, True), id="condition_13_admissible")
            return replace(found, samples=k, claims=(*found.claims, claim), whole=period)
    return found


def _shortest_window(problem: Problem, period: float) -> _Found:
    A, C = problem.plant.flow.A, problem.plant.output.C
    least = sampled_index(Sampled.of(A, C, period, len(A)))
    given = problem.gains.get("L")
    k, best = fewest_samples(Open(A, C, None, given), period, least)
    L = best.L
    if k is None:
        return _nothing(least * period, L, f"(13) holds for no window with period {period!r}")
    sizes = Sizes.of(Sampled.of(A, C, period, k), L)
    if sizes is None or sizes.condition(period) is not True:
        return _nothing(k * period, L, f"(13) is not certain at T = {k * period:.9g}")
    claims = [_condition(sizes, period, True)]
    if k == least:
        reason = f"{least} samples are needed to determine the state"
        below = (k - 1) * period if k > 1 else None
        return _Found(k * period, below, k * period, k, L, tuple(claims), reason)
    shorter = _all_fail(A, C, L, period, range(max(least, k - _MOST_SHOWN), k))
    reason = f"(13) is false for all windows of {least} to {k - 1} samples"
    return _Found(k * period, (k - 1) * period, k * period, k, L, (*claims, shorter), reason)


def _all_fail(A: Any, C: Any, L: Any, period: float, counts: range) -> Claim:
    """(13) is false for every one of these windows, or else undecided."""
    held = []
    for k in counts:
        sizes = Sizes.of(Sampled.of(A, C, period, k), L)
        if sizes is not None and sizes.condition(period) is not False:
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


def _condition(sizes: Sizes, period: float, wanted: bool) -> Claim:
    found = sizes.condition(period)
    word = "holds" if wanted else "fails"
    T = float_below(sizes.T)
    verdict = "proved" if found is wanted else "undecided"
    evidence = {} if found is wanted else {"reason": f"at {period!r} it is too close to call"}
    name = "condition_13" if wanted else "condition_13_ends"
    return Claim(name, f"(13) {word} at period {period!r}, T = {T:.9g}", _SOURCE, verdict, evidence)


def _nothing(window: float, L: Any, reason: str) -> _Found:
    claim = Claim("condition_13", "(13) holds for some period", _SOURCE, "undecided",
                  {"reason": reason})  # fmt: skip
    return _Found(None, None, window, 0, L, (claim,), reason)


def _outcome(problem: Problem, found: _Found | None, first: Claim, searched: bool) -> Outcome:
    result: dict[str, Any] = {"proved": None, "not_proved": None, "not_proved_verdict": None}
    if found is None:
        return Outcome("refuted", "finite_time", (first,), result, None)
    result |= {"window": found.window, "gains": {"L": found.L}, "reason": found.reason}
    claims = (first, *found.claims)
    verdict = "proved" if all(claim.verdict == "proved" for claim in claims) else "undecided"
    if found.proved is not None:
        result |= {"proved": found.proved, "not_proved": found.not_proved}
        period = found.window / found.samples if found.whole is None else found.whole
        window = found.window if found.whole is None else found.samples * found.whole
        result |= {"samples": found.samples, "admissible": period, "admissible_window": window}
        if found.not_proved is not None:
            result["not_proved_verdict"] = "undecided" if searched else "refuted"
    return Outcome(verdict, "finite_time", claims, result, None)
