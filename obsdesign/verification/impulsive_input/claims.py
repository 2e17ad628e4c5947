"""Hypotheses of an observer of Mattsson and Medvedev, proved for its numbers.

Beyond the paper: (12) does not make W(tau) of full rank where the spectrum is complex, so that its
rank is proved by itself; uniqueness of (17) is false in general, and decided
(`uniqueness`). See docs/impulsive_input.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Entries, EntriesByClaim, Matrix, NewEntries, Value
from lmi.arithmetic.balls import exact, to_float
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.impulsive_input.requirements import (
    reason_against_jumps,
    reason_against_noise,
    reason_against_sizes,
)
from obsdesign.analysis.riccati import riccati_shift
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.impulsive_input.decision_rule import (
    evaluation_rule,
    has_noise,
    reason_against_exponents,
    reason_against_margin,
    threshold_for,
)
from obsdesign.equations.impulsive_input.expectations import expectations
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import (
    OPERATORS,
    RULES,
    WEIGHTINGS,
    IntegralGains,
    SamplesGains,
    are_exponents,
    gains_from_document,
    is_positive,
    is_whole_multiple,
)
from obsdesign.equations.impulsive_input.output_units import output_units
from obsdesign.problem.options import ImpulsiveInputOptions
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem
from obsdesign.verification import stated_poles, stated_weights
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.impulsive_input import window as window_claims
from obsdesign.verification.impulsive_input.choices import mark_inevitable
from obsdesign.verification.impulsive_input.rank import full_rank
from obsdesign.verification.impulsive_input.robustness import robustness
from obsdesign.verification.impulsive_input.samples import sampled_claims, window_samples
from obsdesign.verification.impulsive_input.smallest_weight import smallest_weight
from obsdesign.verification.impulsive_input.uniqueness import SOURCE, decide_uniqueness

_ROUNDING = 1e-6  # of a threshold that is computed in floats


def claims(
    problem: Problem,
    stored: Entries,
    certificates: EntriesByClaim,
    *,
    paranoid: bool = False,
    budget: TimeBudget = UNLIMITED,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; nothing is taken from certificates.

    stored: gains as a design file states them.
    """
    agreement, gains = consistent_gains(
        _reason_against(problem, stored), stored, _expected(problem, stored), gains_from_document
    )
    if gains is None:
        return (agreement,)
    low, _ = problem.require_dwell_time()
    A, C = exact(gains.A), exact(gains.C)
    claims = [agreement, window_claims.observable(A, C), window_claims.dwell(gains.window, low)]
    if isinstance(gains, SamplesGains):
        claims += sampled_claims(gains, low)
    else:
        if gains.period is not None:
            claims.append(window_samples(gains, gains.period, low))
        claims += _integral_claims(problem, gains, budget)
    marked = [mark_inevitable(problem, gains.operator, claim) for claim in claims]
    chosen = [] if isinstance(gains, SamplesGains) else _choice_of_K(problem, gains)
    return (*marked, *chosen)


def _choice_of_K(problem: Problem, gains: IntegralGains) -> Iterator[Claim]:
    """Claims that K is the one that stated poles or weights choose."""
    options = problem.options_as(ImpulsiveInputOptions)
    if options.poles is not None:
        D = flow_error_matrix(exact(gains.A), exact(gains.K), exact(gains.C))
        changes = stated_poles.rounding_of_gain(gains.K, gains.C)
        yield stated_poles.poles_claim(D, options.poles, name="A - K C", changes=changes)
    if options.weights:
        shifts = [riccati_shift(gains.A, gains.C, 0.0)]
        yield stated_weights.weights_claim(
            gains.A, gains.C, gains.K, options.weights, shifts, letter="K"
        )


def _integral_claims(problem: Problem, gains: IntegralGains, budget: TimeBudget) -> list[Claim]:
    """Claims about the features of operator `integral`."""
    A, C, H = exact(gains.A), exact(gains.C), exact(gains.H)
    D = flow_error_matrix(A, exact(gains.K), C)
    units = gains.output_units
    response = C if units is None else C / exact(units)[:, None]
    window = FeatureWindow(
        D, response, H, exponents=gains.exponents, tau=gains.window, margin=gains.margin
    )
    claims = [
        window_claims.hurwitz(D),
        window_claims.enough_exponents(D, C, gains.exponents.tolist()),
        full_rank(D, C, gains.exponents.tolist(), gains.window),
    ]
    options = problem.options_as(ImpulsiveInputOptions)
    if options.ratio is not None:
        claims.append(window_claims.ratio(window, options.ratio))
    if options.uncertainty is not None:
        claims.append(robustness(window, A, np.array(options.uncertainty)))
    weight = options.smallest_weight
    if weight is not None and gains.threshold is not None:
        claims.append(smallest_weight(window, weight, gains.threshold))
    nonnegative = bool(gains.nonnegative)
    verdict = decide_uniqueness(window, nonnegative, budget)
    try:
        expected = expectations(to_float(D), gains).to_evidence()
    except ValueError:  # numbers beyond what floats can follow: nothing to expect
        expected = {}
    claims.append(
        Claim(
            "uniqueness",
            f"without noise and error of the state, the features of a window determine time and "
            f"{'nonnegative ' if nonnegative else ''}weight of an impulse whose age lies in "
            f"[{gains.margin!r}, {gains.window!r}]",
            SOURCE,
            verdict.outcome,
            {**verdict.evidence, "approx_expected": expected},
        )
    )
    return claims


def _reason_against(problem: Problem, stored: Entries) -> str | None:
    """Return why the kind cannot serve the problem, or the stored gains are none; or None."""
    plant = problem.plant
    required = problem.reason_without("jump.H", "jump.dwell_time")
    if text := required or problem.reason_unless_measured("continuous", "periodic"):
        return text
    assert plant.jump is not None
    if text := reason_against_jumps(plant.jump, plant.n) or reason_against_sizes(plant):
        return text
    if text := reason_against_noise(plant.output):
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


def _expected(problem: Problem, stored: Entries) -> NewEntries:
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
