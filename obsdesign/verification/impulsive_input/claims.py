"""Hypotheses of an observer of Mattsson and Medvedev, proved for its numbers.

Beyond the paper: (12) does not make W(tau) of full rank where the spectrum is complex, so that its
rank is proved by itself; uniqueness of (17) is false in general, and decided
(`uniqueness`). See docs/impulsive_input.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.impulsive_input import requirements
from obsdesign.equations.impulsive_input import rule as impulse_rule
from obsdesign.equations.impulsive_input.expectations import expectations
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.equations.impulsive_input.gains import (
    IntegralGains,
    SamplesGains,
    gains_from_document,
)
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistent_gains
from obsdesign.verification.impulsive_input import window as window_claims
from obsdesign.verification.impulsive_input.choices import mark_inevitable
from obsdesign.verification.impulsive_input.rank import full_rank
from obsdesign.verification.impulsive_input.samples import sampled_claims, window_samples
from obsdesign.verification.impulsive_input.uniqueness import SOURCE, decide_uniqueness

PAPER = "Mattsson, Medvedev, ECC 2013"


def claims(
    problem: Problem,
    stored: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
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
        claims += sampled_claims(gains)
    else:
        if gains.period is not None:
            claims.append(window_samples(gains, gains.period, low))
        claims += _integral_claims(problem, gains, budget)
    return tuple(mark_inevitable(problem, gains.operator, claim) for claim in claims)


def _integral_claims(problem: Problem, gains: IntegralGains, budget: TimeBudget) -> list[Claim]:
    """Claims about the features of operator `integral`."""
    A, C, H = exact(gains.A), exact(gains.C), exact(gains.H)
    D = flow_error_matrix(A, exact(gains.K), C)
    exponents: Any = gains.exponents.tolist()
    window = FeatureWindow(D, C, H, exponents, gains.window, gains.margin)
    claims = [
        window_claims.hurwitz(D),
        window_claims.enough_exponents(D, C, exponents),
        full_rank(D, C, exponents, gains.window),
    ]
    if "ratio" in problem.options:
        bound = float(problem.options["ratio"])
        claims.append(window_claims.ratio(window, bound))
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


def _reason_against(problem: Problem, stored: Mapping[str, Any]) -> str | None:
    plant = problem.plant
    if plant.jump is None or plant.jump.H is None or plant.jump.dwell_time is None:
        return "jump.H and jump.dwell_time are required by kind 'impulsive_input'"
    if text := requirements.reason_against_plant(plant):
        return text
    for name in ("window", "margin"):
        if not requirements.is_positive(stored.get(name)):
            return f"gains.{name} must be a positive number"
    for name in ("state_correction", "nonnegative"):
        if not isinstance(stored.get(name), bool):
            return f"gains.{name} must be true or false"
    text = None
    if stored.get("operator") == "integral":
        text = _reason_against_integral(plant, stored)
    elif stored.get("operator") == "samples":
        text = requirements.reason_against_samples(plant, stored["window"], stored.get("weighting"))
    if text is not None:
        return text
    noisy = (plant.output.noise_std > 0) | (plant.output.noise_cv > 0)
    if stored.get("weighting") == "gls" and not noisy.all():
        return "weighting 'gls' needs noise on every output"
    return None


def _reason_against_integral(plant: Any, stored: Mapping[str, Any]) -> str | None:
    window = float(stored["window"])
    if not float(stored["margin"]) < window:
        return "gains.margin must be less than gains.window"
    if not requirements.are_exponents(stored.get("exponents")):
        return "gains.exponents must be distinct, finite numbers, one or more"
    return impulse_rule.reason_against_exponents(
        np.asarray(stored["exponents"]), plant.n, plant.p, window
    )


def _required_rule(problem: Problem, stored: Mapping[str, Any]) -> str:
    """Return the rule that the stored exponents need; any where `_reason_against` refutes them."""
    rule = stored.get("rule")
    fallback = rule if isinstance(rule, str) and rule in requirements.RULES[:2] else "peak"
    K, plant = stored.get("K"), problem.plant
    H = None if plant.jump is None else plant.jump.H
    readable = requirements.is_positive(stored.get("window")) and requirements.is_positive(
        stored.get("margin")
    )
    if H is None or not readable or not requirements.are_exponents(stored.get("exponents")):
        return fallback
    if not isinstance(K, np.ndarray) or K.shape != (plant.n, plant.p) or not np.isfinite(K).all():
        return fallback
    D = flow_error_matrix(plant.flow.A, K, plant.output.C)
    window, margin = float(stored["window"]), float(stored["margin"])
    exponents = np.asarray(stored["exponents"], float)
    features = FeatureWindow(D, plant.output.C, H, exponents, window, margin)
    try:
        rule, oldest = impulse_rule.evaluation_rule(features)
    except ValueError:
        return fallback
    refused = H.any() and impulse_rule.reason_against_margin(oldest, window, margin) is not None
    return "" if refused else rule  # no rule can work with ages that leave nothing


def _expected(problem: Problem, stored: Mapping[str, Any]) -> dict[str, Any]:
    plant, options = problem.plant, problem.options
    n, p = plant.n, plant.p
    expected = plant_data(plant) | {
        "H": None if plant.jump is None else plant.jump.H,
        "noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv,
        "operator": set(requirements.OPERATORS), "weighting": set(requirements.WEIGHTINGS),
    }  # fmt: skip
    # numbers that the problem leaves open are checked in `_reason_against`
    expected |= {name: stored.get(name) for name in ("window", "margin")}
    # off unless the problem sets them: nonnegative weights would make the guarantee false
    samples = stored.get("operator") == "samples"
    expected |= {"nonnegative": False, "state_correction": samples}
    if not samples and stored.get("weighting") == "gls":  # the guarantee holds for both
        expected["state_correction"] = stored.get("state_correction")
    if "initial_std" in options:
        expected["initial_std"] = np.array(options["initial_std"])
    if plant.output.measured == "periodic":
        expected["period"] = plant.output.period
    if stored.get("operator") == "integral":
        expected |= {"K": problem.gains.get("K", (n, p))}
        given = options.get("exponents")
        expected["exponents"] = stored.get("exponents") if given is None else np.array(given)
        expected["rule"] = _required_rule(problem, stored)
        if "threshold" in options:
            expected |= {"threshold": options["threshold"], "rule": "threshold"}
    if samples:
        expected["margin"] = plant.output.period
    named = ("window", "margin", "nonnegative", "operator", "weighting")
    for name in (*named, *(() if samples else ("state_correction",))):
        if name in options:
            expected[name] = options[name]
    return expected
