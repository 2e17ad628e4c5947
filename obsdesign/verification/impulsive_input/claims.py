"""Impulsive inputs: what an observer of Mattsson and Medvedev rests on, proved for its numbers.

Beyond the paper: (12) does not make W(tau) of full rank where the spectrum is complex, so that its
rank is proved by itself; uniqueness of (17) is false in general, and decided
(`verification.uniqueness`). See docs/impulsive_input.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, to_float
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import flow_error_matrix, plant_data
from obsdesign.equations.impulsive_input import features as equations
from obsdesign.equations.impulsive_input import rule as impulse_rule
from obsdesign.equations.impulsive_input.expectations import expectations
from obsdesign.problem.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.impulsive_input import window as window_claims
from obsdesign.verification.impulsive_input.choices import mark_inevitable
from obsdesign.verification.impulsive_input.guarantees import guarantees as guarantees
from obsdesign.verification.impulsive_input.rank import full_rank
from obsdesign.verification.impulsive_input.samples import sampled_claims, window_samples
from obsdesign.verification.impulsive_input.uniqueness import SOURCE, decide_uniqueness

PAPER = "Mattsson, Medvedev, ECC 2013"


def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design, each with its verdict; nothing is taken from certificates."""
    agreement = consistency(_objection(problem, gains), gains, _expected(problem, gains))
    if agreement.verdict != "proved":
        return (agreement,)
    low, _ = problem.require_dwell_time()
    A, C, H = (exact(gains[name]) for name in ("A", "C", "H"))
    window = float(gains["window"])
    found = [agreement, window_claims.observable(A, C), window_claims.dwell(window, low)]
    if gains["operator"] == "samples":
        found += sampled_claims(A, C, H, gains)
    else:
        if "period" in gains:
            found.append(window_samples(A, C, H.shape[1], gains, low))
        found += _integral_claims(problem, gains, A, C, H)
    return tuple(mark_inevitable(problem, gains["operator"], claim) for claim in found)


def _integral_claims(
    problem: Problem, gains: Mapping[str, Any], A: Any, C: Any, H: Any
) -> tuple[Claim, ...]:
    """What operator `integral` claims of its gains; A, C, H exact."""
    window, margin = float(gains["window"]), float(gains["margin"])
    D = flow_error_matrix(A, exact(gains["K"]), C)
    exponents = [float(value) for value in gains["exponents"]]
    found = [
        window_claims.hurwitz(D),
        window_claims.enough_exponents(D, C, exponents),
        full_rank(D, C, exponents, window),
    ]
    if "ratio" in problem.options:
        asked = float(problem.options["ratio"])
        found.append(window_claims.ratio(D, C, H, exponents, window, margin, asked))
    nonnegative = bool(gains["nonnegative"])
    verdict = decide_uniqueness(D, C, H, exponents, window, margin, nonnegative)
    try:
        expected = expectations(to_float(D), gains)
    except ValueError:  # numbers beyond what floats can follow: nothing to expect
        expected = {}
    found.append(
        Claim(
            "uniqueness",
            f"without noise and error of the state, the features of a window determine time and "
            f"{'nonnegative ' if nonnegative else ''}weight of an impulse whose age lies in "
            f"[{margin!r}, {window!r}]",
            SOURCE,
            verdict.outcome,
            {**verdict.evidence, "approx_expected": expected},
        )
    )
    return tuple(found)


def _objection(problem: Problem, gains: Mapping[str, Any]) -> str | None:
    plant = problem.plant
    if plant.jump is None or plant.jump.H is None or plant.jump.dwell_time is None:
        return "jump.H and jump.dwell_time are required by kind 'impulsive_input'"
    if text := equations.objection(plant):
        return text
    for name in ("window", "margin"):
        if not equations.is_positive(gains.get(name)):
            return f"gains.{name} must be a positive number"
    for name in ("state_correction", "nonnegative"):
        if not isinstance(gains.get(name), bool):
            return f"gains.{name} must be true or false"
    text = None
    if gains.get("operator") == "integral":
        text = _integral_objection(plant, gains)
    elif gains.get("operator") == "samples":
        text = equations.samples_objection(plant, gains)
    if text is not None:
        return text
    noisy = (plant.output.noise_std > 0) | (plant.output.noise_cv > 0)
    if gains.get("weighting") == "gls" and not noisy.all():
        return "weighting 'gls' needs noise on every output"
    return None


def _integral_objection(plant: Any, gains: Mapping[str, Any]) -> str | None:
    window = float(gains["window"])
    if not float(gains["margin"]) < window:
        return "gains.margin must be less than gains.window"
    if not equations.are_exponents(gains.get("exponents")):
        return "gains.exponents must be distinct, finite numbers, one or more"
    return impulse_rule.growth_objection(np.asarray(gains["exponents"]), plant.n, plant.p, window)


def _rule(problem: Problem, gains: Mapping[str, Any]) -> str:
    """What the stored exponents need; any rule where other claims tell what is wrong."""
    stored = gains.get("rule")
    fallback = stored if isinstance(stored, str) and stored in equations.RULES[:2] else "peak"
    K, plant = gains.get("K"), problem.plant
    H = None if plant.jump is None else plant.jump.H
    readable = equations.is_positive(gains.get("window")) and equations.is_positive(
        gains.get("margin")
    )
    if H is None or not readable or not equations.are_exponents(gains.get("exponents")):
        return fallback
    if not isinstance(K, np.ndarray) or K.shape != (plant.n, plant.p) or not np.isfinite(K).all():
        return fallback
    D = flow_error_matrix(plant.flow.A, K, plant.output.C)
    window, margin = float(gains["window"]), float(gains["margin"])
    exponents = np.asarray(gains["exponents"], float)
    try:
        rule, oldest = impulse_rule.rule_of(D, plant.output.C, H, exponents, window, margin)
    except ValueError:
        return fallback
    refused = H.any() and impulse_rule.margin_objection(oldest, window, margin) is not None
    return "" if refused else rule  # no rule can work with ages that leave nothing


def _expected(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    plant, options = problem.plant, problem.options
    n, p = plant.n, plant.p
    expected = plant_data(plant) | {
        "H": None if plant.jump is None else plant.jump.H,
        "noise_std": plant.output.noise_std, "noise_cv": plant.output.noise_cv,
        "operator": set(equations.OPERATORS), "weighting": set(equations.WEIGHTINGS),
    }  # fmt: skip
    # numbers that the problem leaves open are what they are; `_objection` has looked at them
    expected |= {name: gains.get(name) for name in ("window", "margin")}
    # what nobody asked for: weights that are not negative would make the guarantee false
    samples = gains.get("operator") == "samples"
    expected |= {"nonnegative": False, "state_correction": samples}
    if not samples and gains.get("weighting") == "gls":  # either is what the guarantee says
        expected["state_correction"] = gains.get("state_correction")
    if "initial_std" in options:
        expected["initial_std"] = np.array(options["initial_std"])
    if plant.output.measured == "periodic":
        expected["period"] = plant.output.period
    if gains.get("operator") == "integral":
        expected |= {"K": problem.gains.get("K", (n, p))}
        given = options.get("exponents")
        expected["exponents"] = gains.get("exponents") if given is None else np.array(given)
        expected["rule"] = _rule(problem, gains)
        if "threshold" in options:
            expected |= {"threshold": options["threshold"], "rule": "threshold"}
    if samples:
        expected["margin"] = plant.output.period
    named = ("window", "margin", "nonnegative", "operator", "weighting")
    for name in (*named, *(() if samples else ("state_correction",))):
        if name in options:
            expected[name] = options[name]
    return expected
