"""The smallest weight that a threshold evaluates."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.balls import PRECISIONS, ball, exact, exp_times, number, precision, to_float
from lmi.verdict import Verdict, proved, undecided
from obsdesign.document import Claim
from obsdesign.equations.impulsive_input.evaluation_rule import impulse_curve
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_scales,
    filtered_system,
)
from obsdesign.verification.impulsive_input.window import PAPER


def smallest_weight(window: FeatureWindow, weight: float, threshold: float) -> Claim:
    """|g| |b(age)| > threshold at an age in [margin, tau] for all |g| >= weight, by (16).

    One direction H; |R| = |g| |b(age)| without noise and error of the state.
    """
    statement = (
        f"without noise and error of the state, the features of every impulse of weight {weight!r} "
        f"or more exceed the threshold at an age in [{window.margin!r}, {window.tau!r}]"
    )
    try:
        verdict = _exceeds(window, weight, threshold)
    except ValueError as error:
        verdict = undecided(str(error))
    return Claim.from_verdict("smallest_weight", statement, f"{PAPER}, (16)", verdict)


def _exceeds(window: FeatureWindow, weight: float, threshold: float) -> Verdict:
    """Verdict on the age where |b| is largest in floats, evaluated in balls."""
    n, scales = len(window.D), feature_scales(window.exponents, window.tau)
    curve = impulse_curve(_in_floats(window))
    ages = curve.ages
    size = np.linalg.norm(curve.states[:, n:, 0], axis=1)
    age = float(ages[int(np.argmax(np.where(ages >= window.margin, size, -1.0)))])
    F = filtered_system(window.D, window.C, exact(window.exponents), exact(scales))
    start = np.vstack([window.H, exact(np.zeros((len(F) - n, 1)))])
    for bits in PRECISIONS:
        with precision(bits):
            state = (exp_times(F, age) * ball(start)).tolist()
            squares = sum((row[0] * row[0] for row in state[n:]), number(0.0))
            if squares * number(weight) ** 2 > number(threshold) ** 2:
                return proved(approx_age=age, threshold=threshold)
    reached = weight * float(size[ages >= window.margin].max(initial=0.0))
    return undecided(
        f"features of weight {weight!r} reach {reached:.6g} at ages from the margin on, the "
        f"threshold is {threshold:.6g}",
        approx_age=age,
    )


def _in_floats(window: FeatureWindow) -> FeatureWindow:
    return FeatureWindow(
        to_float(window.D), to_float(window.C), to_float(window.H),
        exponents=window.exponents, tau=window.tau, margin=window.margin,
    )  # fmt: skip
