"""Exponents of the modulating kernels, and when they let an impulse be evaluated.

The largest lambda for which what (15) neglects stays below `ratio` (it is monotone), and its
neighbours below: among all choices with that ratio the slow corner is the least sensitive to noise
(`observer.check_exponents` asks IPOPT whether it is). Where |b| has no peak, exponents spread over
the scales of the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.memory import OversizeError
from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget
from obsdesign.equations.impulsive_input.evaluation import (
    EVALUATED_AGE_SHARE,
    evaluation_rule,
    reason_against_exponents,
    reason_against_margin,
)
from obsdesign.equations.impulsive_input.features import FeatureWindow, neglected_ratio
from obsdesign.errors import InputError
from obsdesign.synthesis.impulsive_input import exponent_program
from obsdesign.synthesis.impulsive_input.integral_window import IntegralWindow

_RATIO = 0.05
_SPACING = 1 / 13  # of exponents, relative to the largest
_IMPROVED_RATIO = 0.99  # deviation against the corner's from which another choice counts
_SPREAD_SPEED = 10.0  # the fastest of spread exponents, times the margin
_CORNER_SPEED = 3.3  # lambda margin, where no lambda keeps the ratio


@dataclass(frozen=True)
class ExponentChoice:
    """Exponents (m,), the rule of evaluation that they allow, and how they were chosen."""

    label: str
    exponents: Matrix
    rule: str
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


def exponent_choices(integral: IntegralWindow, budget: TimeBudget) -> Iterator[ExponentChoice]:
    """Yield the corner and spread exponents, in order of preference.

    Spread ones first where |b| has no peak: impulses are then evaluated when they are old, which
    fast kernels weigh no more. They also differ most from each other: with many states neighbours
    are too much alike for the rank.
    """
    n, options = integral.problem.plant.n, integral.options
    exponents = -np.geomspace(1.0 / integral.window, _SPREAD_SPEED / integral.margin, 2 * n)
    label = f"{2 * n} spread exponents"
    spread = ExponentChoice(label, exponents, rule_for(integral, exponents))
    corners = [corner_exponents(integral, count) for count in (2 * n, 2 * n + 2)]
    needs_corner = any(
        options.is_stated(x) for x in ("ratio", "check_exponents", "threshold", "smallest_weight")
    )
    spread_first = not needs_corner and _rule_or_none(integral, corners[0]) in (None, "position")
    if spread_first:
        yield spread
    for corner in corners:
        if _rule_or_none(integral, corner) is None:
            continue
        yield from _refined_by_ipopt(integral, corner, budget)
    if not spread_first:
        yield spread


def _rule_or_none(integral: IntegralWindow, exponents: Matrix) -> str | None:
    """Return the rule of these exponents; None where they cannot work in the window."""
    try:
        return rule_for(integral, exponents)
    except InputError:
        return None


def _refined_by_ipopt(
    integral: IntegralWindow, corner: Matrix, budget: TimeBudget
) -> Iterator[ExponentChoice]:
    """Yield what IPOPT finds better, with `check_exponents`; then the corner."""
    label = f"{len(corner)} exponents"
    if not integral.options.check_exponents:
        yield ExponentChoice(label, corner, rule_for(integral, corner))
        return
    tau, std = integral.window, integral.problem.plant.output.noise_std
    age = None if rule_for(integral, corner) == "peak" else EVALUATED_AGE_SHARE * tau
    scale = std / std.max() if std.any() else np.ones(len(std))
    better, size, remarks = exponent_program.refined_exponents(
        integral.features(corner), scale, age, budget
    )
    comparison = f"times {size:.3g} as uncertain as with {corner[0]:.4g} ... {corner[-1]:.4g}"
    if better is None:
        label += "; IPOPT did not converge"
    elif size > _IMPROVED_RATIO:
        label += ", confirmed by IPOPT"
    elif neglected_ratio(integral.features(better))[0] > _ratio(integral) * (1 + 1e-6):
        label += f"; IPOPT finds {comparison}, but more is neglected than the ratio allows"
    else:
        rule = rule_for(integral, better)
        refined = f"{label} from IPOPT, {comparison}"
        yield ExponentChoice(refined, better, rule, remarks, ("IPOPT",))
        remarks = ()
    yield ExponentChoice(label, corner, rule_for(integral, corner), remarks, ("IPOPT",))


def rule_for(integral: IntegralWindow, exponents: Matrix) -> str:
    """Return the rule of evaluation: a peak of |R| where every impulse makes one, else position."""
    plant, window = integral.problem.plant, integral.window
    if text := reason_against_exponents(exponents, plant.n, plant.p, window):
        raise InputError(text)
    try:
        rule, oldest = evaluation_rule(integral.features(exponents))
    except OversizeError:
        raise
    except ValueError as error:
        if window >= integral.problem.require_dwell_time()[0]:
            return "position"  # a claim refutes the window, whatever the rule
        raise InputError(
            f"{error}; are the units of flow.A and output.C what they should be?"
        ) from None
    text = reason_against_margin(oldest, window, integral.margin)
    if text and integral.H.any():
        raise InputError(text)
    return "threshold" if integral.options.has_threshold else rule


def _ratio(integral: IntegralWindow) -> float:
    ratio = integral.options.ratio
    return _RATIO if ratio is None else ratio


def slowest_exponent(window: FeatureWindow, ratio: float) -> float | None:
    """The largest lambda <= -1/window with |E| <= ratio |b| for ages in [margin, window].

    By bisection. None where no lambda does: then h changes sign, and rows of b have zeros. Kernels
    slower than the window are all alike on it: their features hardly differ. The exponents of
    `window` are replaced.
    """
    tau = window.tau

    def holds(size: float) -> bool:
        worst, _ = neglected_ratio(replace(window, exponents=np.array([-size])), 60)
        return worst <= ratio

    high = 1.0 / window.margin
    while not holds(high):
        high *= 2
        if high * tau > 500:
            return None
    low = high / 2
    while holds(low):
        if low * tau <= 1:
            return -1.0 / tau
        low /= 2
    for _ in range(40):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return -high


def corner_exponents(integral: IntegralWindow, count: int) -> Matrix:
    """`count` exponents: the slowest one the ratio allows, and as many below it, evenly spaced.

    Where no ratio can be kept: from the length of the window to that of the margin, evenly in
    proportion.
    """
    first = slowest_exponent(integral.features(np.zeros(0)), _ratio(integral))
    if first is None:
        return -np.geomspace(1.0 / integral.window, _CORNER_SPEED / integral.margin, count)
    return first * (1 + _SPACING * np.arange(count, dtype=np.float64))
