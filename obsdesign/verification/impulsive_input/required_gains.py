"""Gains that a problem requires of a design, for claim `consistent`."""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.impulsive_input.evaluation_rule import (
    evaluation_rule,
    has_noise,
    reason_against_margin,
    threshold_for,
)
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import (
    OPERATORS,
    RULES,
    WEIGHTINGS,
    are_exponents,
    is_positive,
)
from obsdesign.equations.impulsive_input.output_units import output_units
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

_ROUNDING = 1e-6  # of a threshold that is computed in floats


def margin_and_window(stored: Entries) -> tuple[float, float] | None:
    """The youngest and the oldest age that is looked at; None where one is no positive number."""
    margin, window = stored.get("margin"), stored.get("window")
    if not (is_positive(margin) and is_positive(window)):
        return None
    return float(margin), float(window)


def _required_rule(plant: Plant, stored: Entries) -> str:
    """Return the rule that the stored exponents need; any where `_reason_against` refutes them."""
    rule = stored.get("rule")
    fallback = rule if isinstance(rule, str) and rule in RULES[:2] else "peak"
    window = _stored_window(plant, stored)
    if window is None:
        return fallback
    # those of old, without units of outputs, search |R| in noise too
    noisy = has_noise(plant.output) and "output_units" in stored
    try:
        rule, oldest = evaluation_rule(window, noisy=noisy)
    except ValueError:
        return fallback
    refused = reason_against_margin(oldest, window.tau, window.margin) is not None
    # no rule can work with ages that leave nothing
    return "" if refused and window.H.any() else rule


def _stored_window(plant: Plant, stored: Entries) -> FeatureWindow | None:
    """Features of the stored K, exponents, window and margin; None where they make none."""
    K, exponents = stored.get("K"), stored.get("exponents")
    ends = margin_and_window(stored)
    H = None if plant.jump is None else plant.jump.H
    if H is None or ends is None or not are_exponents(exponents):
        return None
    if not isinstance(K, np.ndarray) or K.shape != (plant.n, plant.p) or not np.isfinite(K).all():
        return None
    C = plant.output.C
    units = _required_units(plant, stored)
    return FeatureWindow(
        flow_error_matrix(plant.flow.A, K, C), C if units is None else C / units[:, None], H,
        exponents=np.asarray(exponents, float),
        tau=ends[1], margin=ends[0],
    )  # fmt: skip


def _required_units(plant: Plant, stored: Entries) -> Matrix | None:
    """Return the units of several outputs; None where the design is of old and has none.

    Those of an impulse are computed in floats: stored ones serve that are the same but for
    rounding.
    """
    K, ends = stored.get("K"), margin_and_window(stored)
    if "output_units" not in stored or plant.jump is None or plant.jump.H is None or ends is None:
        return None
    if not isinstance(K, np.ndarray) or K.shape != (plant.n, plant.p) or not np.isfinite(K).all():
        return None
    required, units = output_units(plant, K, plant.jump.H, ends[1]), stored["output_units"]
    if required is None or not isinstance(units, np.ndarray) or units.shape != required.shape:
        return required
    return units if np.allclose(units, required, rtol=_ROUNDING, atol=0.0) else required


def _required_threshold(problem: Problem, stored: Entries) -> float | None:
    """Return the threshold of the problem: stated, or from the stored exponents and K.

    The latter is computed in floats: the stored one serves where it is the same but for rounding.
    """
    options = problem.options_as(ImpulsiveInputOptions)
    if options.smallest_weight is None:
        return options.threshold
    threshold: Value = stored.get("threshold")
    window = _stored_window(problem.plant, stored)
    if window is None or not is_positive(threshold):
        return None
    try:
        required = threshold_for(window, options.smallest_weight)
    except ValueError:  # floats cannot follow the features: the claim is undecided
        return float(threshold)
    return float(threshold) if math.isclose(threshold, required, rel_tol=_ROUNDING) else required


def required_gains(problem: Problem, stored: Entries) -> NewEntries:
    """Entries that the problem requires, for `consistent_gains`."""
    plant, options = problem.plant, problem.options_as(ImpulsiveInputOptions)
    samples = stored.get("operator") == "samples"
    # those that the problem leaves open are checked in `_reason_against`
    expected = plant_data(plant) | {
        "H": None if plant.jump is None else plant.jump.H,
        "noise_std": plant.output.noise_std,
        "noise_cv": plant.output.noise_cv,
        "operator": set(OPERATORS) if options.operator is None else options.operator,
        "weighting": set(WEIGHTINGS) if options.weighting is None else options.weighting,
        "window": stored.get("window") if options.window is None else options.window,
        "margin": plant.output.period if samples else stored.get("margin"),
        # negative weights that are looked for would make the guarantee false
        "nonnegative": options.nonnegative,
        "state_correction": samples,
    }
    if options.margin is not None:
        expected |= {"margin": options.margin}
    if not samples and stored.get("weighting") == "gls":  # the guarantee holds for both
        expected |= {"state_correction": stored.get("state_correction")}
    if not samples and options.state_correction is not None:
        expected |= {"state_correction": options.state_correction}
    if options.initial_std is not None:
        expected |= {"initial_std": np.array(options.initial_std)}
    if plant.output.measured == "periodic":
        expected |= {"period": plant.output.period}
    if stored.get("operator") == "integral":
        given = options.exponents
        expected |= {
            "K": problem.gains.get("K", (plant.n, plant.p)),
            "exponents": stored.get("exponents") if given is None else np.array(given),
            "rule": _required_rule(plant, stored),
        }
        if (units := _required_units(plant, stored)) is not None:
            expected |= {"output_units": units}
        if options.has_threshold:
            expected |= {"threshold": _required_threshold(problem, stored), "rule": "threshold"}
    return expected
