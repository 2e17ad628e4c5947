"""What lets Theorem 1 hold for longer periods than (13) as printed: coordinates S, and a tighter
Lemma 2 (`tighter_sigma`). Both change the bound, not the observer; each is told beside (13).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.norms import float_below
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.injection import (
    SECONDS,
    Injection,
    Open,
    best_injection,
    fewest_samples,
)
from obsdesign.verification.finite_time.theorem_1 import Sizes
from obsdesign.verification.finite_time.window import sampled_index

# told where it gains more than rounding
_BETTER = 1 + 1e-6
_SECONDS = 2.0


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
