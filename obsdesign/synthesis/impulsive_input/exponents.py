"""Exponents of the modulating kernels, and when they let an impulse be evaluated.

The largest lambda for which what (15) neglects stays below `ratio` (it is monotone), and its
neighbours below: among all choices with that ratio the slow corner is the least sensitive to noise
(`observer.check_exponents` asks IPOPT whether it is). Where |b| has no peak, exponents spread over
the scales of the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.impulsive_input import features as equations
from obsdesign.equations.impulsive_input import rule as impulse_rule
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.impulsive_input import exponent_program as exponent_nlp

Matrix = NDArray[np.float64]

_RATIO = 0.05
_SPACING = 1 / 13  # of exponents, relative to the largest
_BETTER = 0.99  # deviation against the corner's from which another choice counts
_SPREAD = 10.0  # the fastest of spread exponents, times the margin
_FASTEST = 3.3  # lambda margin, where no lambda keeps the ratio


def exponent_choices(
    problem: Problem, data: dict[str, Any], D: Matrix
) -> Iterator[tuple[str, Matrix, str]]:
    """(label, exponents, rule): the corner and spread exponents.

    Spread ones first where |b| has no peak: impulses are then evaluated when they are old, which
    fast kernels have forgotten. They also differ most from each other: with many states neighbours
    are too much alike for the rank.
    """
    n, window, margin = len(D), data["window"], data["margin"]
    spread = np.asarray(-np.geomspace(1.0 / window, _SPREAD / margin, 2 * n), dtype=np.float64)
    last = (f"{2 * n} spread exponents", spread, rule_for(data, D, spread))
    corners = [
        corner_exponents(D, data["C"], data["H"], window, margin, _ratio(problem), count)
        for count in (2 * n, 2 * n + 2)
    ]
    asked = any(name in problem.options for name in ("ratio", "check_exponents", "threshold"))
    early = not asked and _rule_or_none(data, D, corners[0]) in (None, "position")
    if early:
        yield last
    for corner in corners:
        if _rule_or_none(data, D, corner) is None:
            continue
        for label, chosen in _looked_at_again(problem, data, D, corner):
            yield label, chosen, rule_for(data, D, chosen)
    if not early:
        yield last


def _rule_or_none(data: dict[str, Any], D: Matrix, exponents: Matrix) -> str | None:
    """None where these exponents cannot work in the window."""
    try:
        return rule_for(data, D, exponents)
    except InputError:
        return None


def _looked_at_again(
    problem: Problem, data: dict[str, Any], D: Matrix, corner: Matrix
) -> Iterator[tuple[str, Matrix]]:
    """(label, exponents): the corner, and before it what IPOPT finds better, where asked."""
    label = f"{len(corner)} exponents"
    if not problem.options.get("check_exponents"):
        yield label, corner
        return
    tau, std = data["window"], problem.plant.output.noise_std
    age = None if rule_for(data, D, corner) == "peak" else equations.OLD * tau
    scale = std / std.max() if std.any() else np.ones(len(std))
    found, size = exponent_nlp.second_opinion(D, data["C"], data["H"], corner, scale, tau, age)
    told = f"times {size:.3g} as uncertain as with {corner[0]:.4g} ... {corner[-1]:.4g}"
    if found is None:
        label += "; IPOPT did not converge"
    elif size > _BETTER:
        label += ", confirmed by IPOPT"
    elif equations.neglected_ratio(
        D, data["C"], data["H"], found, tau, data["margin"]
    )[0] > _ratio(problem) * (1 + 1e-6):  # fmt: skip
        label += f"; IPOPT finds {told}, but more is neglected than the ratio allows"
    else:
        yield f"{label} from IPOPT, {told}", found
    yield label, corner


def rule_for(data: dict[str, Any], D: Matrix, exponents: Matrix) -> str:
    """When to evaluate: at a peak of |R| where every impulse makes one, else by position."""
    window, margin = data["window"], data["margin"]
    if text := impulse_rule.growth_objection(exponents, len(D), len(data["C"]), window):
        raise InputError(text)
    try:
        rule, oldest = impulse_rule.rule_of(D, data["C"], data["H"], exponents, window, margin)
    except ValueError as error:
        if window >= data["dwell_time"][0]:
            return "position"  # a claim refutes the window, whatever the rule
        raise InputError(
            f"{error}; are the units of flow.A and output.C what they should be?"
        ) from None
    text = impulse_rule.margin_objection(oldest, window, margin)
    if text and data["H"].any():
        raise InputError(text)
    return "threshold" if "threshold" in data else rule


def _ratio(problem: Problem) -> float:
    return float(problem.options.get("ratio", _RATIO))


def slowest_exponent(
    D: Matrix, C: Matrix, H: Matrix, window: float, margin: float, ratio: float
) -> float | None:
    """The largest lambda <= -1/window with |E| <= ratio |b| for ages in [margin, window].

    By bisection. None where no lambda does: then h changes sign, and rows of b have zeros. Kernels
    slower than the window are all alike on it: their features hardly differ.
    """

    def holds(size: float) -> bool:
        worst, _ = equations.neglected_ratio(D, C, H, np.array([-size]), window, margin, 60)
        return worst <= ratio

    high = 1.0 / margin
    while not holds(high):
        high *= 2
        if high * window > 500:
            return None
    low = high / 2
    while holds(low):
        if low * window <= 1:
            return -1.0 / window
        low /= 2
    for _ in range(40):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return -high


def corner_exponents(
    D: Matrix, C: Matrix, H: Matrix, window: float, margin: float, ratio: float, count: int
) -> Matrix:
    """`count` exponents: the slowest one the ratio allows, and as many below it, evenly spaced.

    Where no ratio can be kept: from the length of the window to that of the margin, evenly in
    proportion.
    """
    first = slowest_exponent(D, C, H, window, margin, ratio)
    if first is None:
        return np.asarray(-np.geomspace(1.0 / window, _FASTEST / margin, count), dtype=np.float64)
    return np.asarray(first * (1 + _SPACING * np.arange(count)), dtype=np.float64)
