"""Periods and windows beyond condition (13) as printed: coordinates S, a tighter Lemma 2.

Both change the bound of Theorem 1, not the observer. Their gain is proved in ball arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.norms import float_below
from lmi.time_budget import Remark, TimeBudget
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.equations.finite_time.rows import approx_observability_index
from obsdesign.synthesis.finite_time.injection import EFFORT, best_injection, fewest_samples
from obsdesign.synthesis.finite_time.period_problem import Injection, PeriodProblem
from obsdesign.verification.finite_time.theorem_1 import Norms

# extensions of (13) are reported where they gain more than rounding
_LEAST_RATIO = 1 + 1e-6
# of a search that may replace the one of a design
LONG_EFFORT = EFFORT.times(3)

Extensions = tuple[NewEntries, tuple[Remark, ...]]  # entries of the result, remarks


def longer_periods(
    printed: PeriodProblem, plain: Injection | None, budget: TimeBudget
) -> Extensions:
    """{"coordinates": {"S", "L", "window", "proved"}, "tighter": the same}, where they gain.

    proved: a period for which the condition is proved; plain: the solution for (13) as printed,
    log_period that of the proved one, if any. S is [] where it is I.
    """
    if not np.any(printed.A) or printed.has_zero_gain:
        return {}, ()
    first = () if plain is None else (plain,)
    least = 0.0 if plain is None else math.exp(plain.log_period)
    extensions: NewEntries = {}
    coordinates = replace(printed, coordinates=True)
    transformed = best_injection(coordinates, budget, first, effort=LONG_EFFORT)
    remarks = transformed.remarks
    longest = _proved_period(printed, transformed)
    if longest > least * _LEAST_RATIO:
        extensions |= {"coordinates": _extension(transformed, longest)}
    tighter = replace(printed, tighter=True)
    best = best_injection(tighter, budget, first)
    remarks += best.remarks
    longest = _proved_period(tighter, best)
    coordinates = replace(tighter, coordinates=True)
    transformed = best_injection(coordinates, budget, (best,), effort=LONG_EFFORT)
    remarks += transformed.remarks
    further = _proved_period(tighter, transformed)
    if further > longest * _LEAST_RATIO:
        best, longest = transformed, further
    if longest > least * _LEAST_RATIO:
        extensions |= {"tighter": _extension(best, longest)}
    return extensions, remarks


def shorter_windows(
    printed: PeriodProblem, plain: int | None, period: float, budget: TimeBudget
) -> Extensions:
    """The same with "samples", and the window as "proved"; plain: the fewest samples of (13)."""
    A, C = printed.A, printed.C
    if not np.any(A) or printed.has_zero_gain:
        return {}, ()
    extensions, remarks = {}, tuple[Remark, ...]()
    least = approx_observability_index(A, C, period) or len(A)
    for name, extended in (
        ("coordinates", replace(printed, coordinates=True)),
        ("tighter", replace(printed, tighter=True)),
    ):
        k, injection = fewest_samples(extended, period, least, budget)
        remarks += injection.remarks
        if k is None or (plain is not None and k >= plain):
            continue
        norms = Norms.from_sampled(Sampled.from_plant(A, C, period, k), injection.L, injection.S)
        if norms is not None and norms.condition(period, extended.tighter) == "proved":
            window = k * period
            extension = _extension(replace(injection, window=window), window)
            extensions[name] = extension | {"samples": k}
    return extensions, remarks


def _proved_period(problem: PeriodProblem, injection: Injection) -> float:
    """A period for which the condition is proved; 0 where there is none."""
    A, C, window = problem.A, problem.C, injection.window
    norms = Norms.from_sampled(Sampled.from_plant(A, C, window, 1), injection.L, injection.S)
    longest = None if norms is None else norms.longest_period(problem.tighter)
    if norms is None or longest is None:
        return 0.0
    period = min(float_below(longest), window / needed_samples(A, C, window))
    return period if norms.condition(period, problem.tighter) == "proved" else 0.0


def _extension(injection: Injection, proved: float) -> NewEntries:
    S = [] if injection.S is None else injection.S.tolist()
    return {"S": S, "L": injection.L, "window": injection.window, "proved": proved}


def needed_samples(A: Matrix, C: Matrix, window: float) -> int:
    """The least k for which k samples, window/k apart, determine the state."""
    for k in range(1, len(A) + 1):
        if (approx_observability_index(A, C, window / k) or len(A)) <= k:
            return k
    return len(A)
