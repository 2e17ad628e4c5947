"""What a problem requires of the stored gains of an observer of impulses.

Entries that are computed in floats are those of the file where they agree but for rounding.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.analysis.impulsive_input.requirements import (
    reason_against_jumps,
    reason_against_sizes,
)
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.impulsive_input.decision_rule import (
    evaluation_rule,
    reason_against_exponents,
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
    is_whole_multiple,
)
from obsdesign.equations.impulsive_input.output_units import output_units
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

_ROUNDING = 1e-6  # of entries that are computed in floats


def reason_against_gains(problem: Problem, stored: Entries) -> str | None:
    """Return why the kind cannot serve the problem, or the stored gains are none; or None."""
    plant = problem.plant
    required = problem.reason_without("jump.H", "jump.dwell_time")
    if text := required or problem.reason_unless_measured("continuous", "periodic"):
        return text
    assert plant.jump is not None
    if text := reason_against_jumps(plant.jump, plant.n) or reason_against_sizes(plant):
        return text
    for name in ("window", "margin"):
        if not is_positive(stored.get(name)):
            return f"gains.{name} must be a positive number"
    for name in ("state_correction", "nonnegative"):
        if not isinstance(stored.get(name), bool):
            return f"gains.{name} must be true or false"
    text = None
    if stored.get("operator") == "integral":
        text = _reason_against_integral(plant, stored)
    elif stored.get("operator") == "samples":
        text = _reason_against_samples(plant, stored)
    if text is not None:
        return text
    noisy = (plant.output.noise_std > 0) | (plant.output.noise_cv > 0)
    if stored.get("weighting") == "gls" and not noisy.all():
        return "weighting 'gls' needs noise on every output"
    return None


def _reason_against_integral(plant: Plant, stored: Entries) -> str | None:
    ends = _margin_and_window(stored)
    if ends is None or not ends[0] < ends[1]:
        return "gains.margin must be less than gains.window"
    exponents = stored.get("exponents")
    if not are_exponents(exponents):
        return "gains.exponents must be distinct, finite numbers, one or more"
    return reason_against_exponents(np.asarray(exponents), plant.n, plant.p, ends[1])


def _margin_and_window(stored: Entries) -> tuple[float, float] | None:
    """The youngest and the oldest age that is looked at; None where one is no positive number."""
    margin, window = stored.get("margin"), stored.get("window")
    if not (is_positive(margin) and is_positive(window)):
        return None
    return float(margin), float(window)


def _reason_against_samples(plant: Plant, stored: Entries) -> str | None:
    period = plant.output.period
    window: Value = stored.get("window")
    H = None if plant.jump is None else plant.jump.H
    if plant.output.measured != "periodic" or period is None or not is_positive(period):
        return "output.measured must be 'periodic' for operator 'samples'"
    if not is_whole_multiple(window, period):
        return f"gains.window must be a multiple of output.period = {period!r}; got {window!r}"
    if stored.get("weighting") != "gls":
        return "gains.weighting must be 'gls' for operator 'samples'"
    if H is None or H.shape[1] != 1:
        return "jump.H must have one column for operator 'samples'"
    return None


def _required_rule(plant: Plant, stored: Entries) -> str:
    """Return the rule that the stored exponents need; any where these are refuted."""
    rule = stored.get("rule")
    fallback = rule if isinstance(rule, str) and rule in RULES[:2] else "peak"
    window = _stored_window(plant, stored)
    if window is None:
        return fallback
    try:
        rule, oldest = evaluation_rule(window)
    except ValueError:
        return fallback
    refused = reason_against_margin(oldest, window.tau, window.margin) is not None
    # no rule can work with ages that leave nothing
    return "" if refused and window.H.any() else rule


def _stored_window(plant: Plant, stored: Entries) -> FeatureWindow | None:
    """Features of the stored K, exponents, window and margin; None where they make none."""
    K, exponents = stored.get("K"), stored.get("exponents")
    ends = _margin_and_window(stored)
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
    K, ends = stored.get("K"), _margin_and_window(stored)
    if "output_units" not in stored or plant.jump is None or plant.jump.H is None or ends is None:
        return None
    if not isinstance(K, np.ndarray) or K.shape != (plant.n, plant.p) or not np.isfinite(K).all():
        return None
    D = flow_error_matrix(plant.flow.A, K, plant.output.C)
    required, units = output_units(plant.output, D, plant.jump.H, ends[1]), stored["output_units"]
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


def expected_gains(problem: Problem, stored: Entries) -> NewEntries:
    """Entries that the problem requires, for `consistent_gains`."""
    plant, options = problem.plant, problem.options_as(ImpulsiveInputOptions)
    samples = stored.get("operator") == "samples"
    # those that the problem leaves open are checked in `reason_against_gains`
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
