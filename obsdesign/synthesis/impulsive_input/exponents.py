"""Exponents of the modulating kernels by rule, and when they let an impulse be evaluated.

The largest lambda for which what (15) neglects stays below `ratio` (it is monotone), and its
neighbours below. Where |b| has no peak, exponents spread over the scales of the window. With noise
`noisy_exponents` looks for better ones.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.memory import OversizeError
from lmi.solvers import Solvers
from lmi.time_budget import Remark
from obsdesign.equations.impulsive_input.evaluation_rule import (
    evaluation_rule,
    has_noise,
    reason_against_exponents,
    reason_against_margin,
)
from obsdesign.equations.impulsive_input.features import FeatureWindow, neglected_ratio
from obsdesign.errors import InputError
from obsdesign.synthesis.impulsive_input.integral_window import IntegralWindow

_RATIO = 0.05
_SPACING = 1 / 13  # of exponents, relative to the largest
_SPREAD_SPEED = 10.0  # the fastest of spread exponents, times the margin
_CORNER_SPEED = 3.3  # lambda margin, where no lambda keeps the ratio
# of an exponent to an eigenvalue of A - K C, relative: at an eigenvalue (12) does not hold
_LEAST_DISTANCE = 1e-3


@dataclass(frozen=True)
class ExponentChoice:
    """Exponents (m,), the rule of evaluation that they allow, and how they were chosen.

    family: exponents of the same kind, of any number.
    """

    label: str
    exponents: Matrix
    rule: str
    family: Callable[[int], Matrix]
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


def rule_choices(integral: IntegralWindow) -> list[ExponentChoice]:
    """Corner and spread exponents, in order of preference.

    Spread ones first where |b| has no peak: impulses are then evaluated when they are old, which
    fast kernels weigh no more. They also differ most from each other: with many states neighbours
    are too much alike for the rank.
    """
    n, options = integral.problem.plant.n, integral.options
    first = slowest_exponent(integral.features(np.zeros(0)), largest_ratio(integral))
    corner_of = partial(corner_exponents, integral, first)
    spread_of = partial(spread_exponents, integral)
    exponents = spread_of(2 * n)
    label = f"{2 * n} spread exponents"
    spread = ExponentChoice(label, exponents, rule_for(integral, exponents), spread_of)
    corners = [corner_of(count) for count in (2 * n, 2 * n + 2)]
    rules = [rule_or_none(integral, corner) for corner in corners]
    choices = [
        ExponentChoice(f"{len(corner)} exponents", corner, rule, corner_of)
        for corner, rule in zip(corners, rules, strict=True)
        if rule is not None
    ]
    needs_corner = any(options.is_stated(x) for x in ("ratio", "threshold", "smallest_weight"))
    spread_first = not needs_corner and rules[0] in (None, "position")
    return [spread, *choices] if spread_first else [*choices, spread]


def rule_or_none(integral: IntegralWindow, exponents: Matrix) -> str | None:
    """Return the rule of these exponents; None where they cannot work in the window."""
    try:
        return rule_for(integral, exponents)
    except InputError:
        return None


def rule_for(integral: IntegralWindow, exponents: Matrix) -> str:
    """Return the rule of evaluation: a peak of |R| where every impulse makes one, else position."""
    plant, window = integral.problem.plant, integral.window
    if text := reason_against_exponents(exponents, plant.n, plant.p, window):
        raise InputError(text)
    try:
        rule, oldest = evaluation_rule(integral.features(exponents), noisy=has_noise(plant.output))
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


def largest_ratio(integral: IntegralWindow) -> float:
    """What (15) may neglect of an impulse, against what it keeps."""
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


def corner_exponents(integral: IntegralWindow, first: float | None, count: int) -> Matrix:
    """`count` exponents: the slowest one the ratio allows, and as many below it, evenly spaced.

    first: `slowest_exponent`. Where no ratio can be kept: from the length of the window to that of
    the margin, evenly in proportion.
    """
    if first is None:
        exponents = -np.geomspace(1.0 / integral.window, _CORNER_SPEED / integral.margin, count)
    else:
        exponents = first * (1 + _SPACING * np.arange(count, dtype=np.float64))
    return _apart_from_modes(integral, exponents)


def spread_exponents(integral: IntegralWindow, count: int) -> Matrix:
    """`count` exponents from the length of the window to a tenth of the margin, in proportion."""
    exponents = -np.geomspace(1.0 / integral.window, _SPREAD_SPEED / integral.margin, count)
    return _apart_from_modes(integral, exponents)


def _apart_from_modes(integral: IntegralWindow, exponents: Matrix) -> Matrix:
    """The exponents, faster by a little where they are eigenvalues of A - K C but for rounding."""
    modes = np.linalg.eigvals(integral.D)

    def nearest(exponent: float) -> float:
        steps = (exponent * (1 + k * _LEAST_DISTANCE) for k in itertools.count())
        return next(
            each for each in steps if (np.abs(modes - each) > _LEAST_DISTANCE * abs(each)).all()
        )

    return np.array([nearest(exponent) for exponent in exponents.tolist()])
