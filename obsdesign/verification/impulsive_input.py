"""Impulsive inputs: what an observer of Mattsson and Medvedev rests on, proved for its numbers.

Beyond the paper: (12) does not make W(tau) of full rank where the spectrum is complex, so that its
rank is proved by itself; uniqueness of (17) is false in general, and decided
(`verification.uniqueness`). See docs/impulsive_input.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.balls import exact, fixed_vector, to_float
from obsdesign.document import Claim
from obsdesign.equations import impulsive_input as equations
from obsdesign.equations.estimation_error import flow_error_matrix, plant_data
from obsdesign.equations.impulse_expectations import expectations
from obsdesign.problem import Problem
from obsdesign.verification import impulse_window as window_claims
from obsdesign.verification.consistency import consistency
from obsdesign.verification.impulse_samples import sampled_claims
from obsdesign.verification.uniqueness import SOURCE, decide_uniqueness

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
    window, margin = float(gains["window"]), float(gains["margin"])
    found = [agreement, window_claims.observable(A, C), window_claims.dwell(window, low)]
    if gains["operator"] == "samples":
        return (*found, *sampled_claims(A, C, H, gains))
    D = flow_error_matrix(A, exact(gains["K"]), C)
    exponents = [float(value) for value in gains["exponents"]]
    found.append(window_claims.hurwitz(D))
    found.append(window_claims.enough_exponents(D, C, exponents))
    found.append(window_claims.full_rank(D, C, exponents, window))
    if "ratio" in problem.options:
        asked = float(problem.options["ratio"])
        found.append(window_claims.ratio(D, C, H, exponents, window, margin, asked))
    verdict = decide_uniqueness(D, C, H, exponents, window, margin)
    try:
        expected = expectations(to_float(D), gains)
    except ValueError:  # numbers beyond what floats can follow: nothing to expect
        expected = {}
    found.append(
        Claim(
            "uniqueness",
            f"without noise and error of the state, the features of a window determine time and "
            f"weight of an impulse whose age lies in [{margin!r}, {window!r}]",
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
        value = gains.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
            return f"gains.{name} must be a positive number"
    for name in ("state_correction", "nonnegative"):
        if not isinstance(gains.get(name), bool):
            return f"gains.{name} must be true or false"
    if gains.get("operator") == "integral":
        if not float(gains["margin"]) < float(gains["window"]):
            return "gains.margin must be less than gains.window"
        exponents = np.asarray(gains.get("exponents", ()))
        if exponents.ndim != 1 or len(set(exponents.tolist())) < len(exponents):
            return "gains.exponents must be distinct numbers"
    noisy = (plant.output.noise_std > 0) | (plant.output.noise_cv > 0)
    if gains.get("weighting") == "gls" and not noisy.all():
        return "weighting 'gls' needs noise on every output"
    return None


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
    if plant.output.measured == "periodic":
        expected["period"] = plant.output.period
    if gains.get("operator") == "integral":
        expected |= {"K": problem.gains.get("K", (n, p))}
        given = options.get("exponents")
        expected["exponents"] = gains.get("exponents") if given is None else np.array(given)
        expected["rule"] = {"peak", "position"}
        if "threshold" in options:
            expected |= {"threshold": options["threshold"], "rule": "threshold"}
    if samples:
        expected["margin"] = plant.output.period
    named = ("window", "margin", "nonnegative", "operator", "weighting")
    for name in (*named, *(() if samples else ("state_correction",))):
        if name in options:
            expected[name] = options[name]
    return expected


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    verdicts = {claim.id: claim.verdict for claim in found}
    needed = list(verdicts)
    plant = problem.plant
    without = ["disturbance"] + (["unknown input d"] if plant.flow.D is not None else [])
    low = "" if plant.jump is None else f"{problem.require_dwell_time()[0]!r}"
    between = _between_samples(plant)
    told = [
        (
            f"Without noise and {' and '.join(without)}, an impulse at least {low} from its "
            "neighbours that a window holds alone is found at its time and with its weight, up to "
            f"what is left of the initial error, which decays{between}.",
            all(verdicts[name] == "proved" for name in needed),
            needed,
        ),
        (
            "Two impulses within one window are not told apart where one impulse explains the "
            "record as well; the test of fit flags them only where noise does not hide them.",
            False,
            [],
        ),
        ("That every impulse is found in noise is not claimed: small ones are missed.", False, []),
    ]
    return tuple({"statement": text, "given": given, "claims": ids} for text, given, ids in told)


def _between_samples(plant: Any) -> str:
    """What samples cannot tell: the onset between two of them, where e^{A v} H g stays in H."""
    if plant.output.measured != "periodic":
        return ""
    H, A = exact(plant.jump.H), exact(plant.flow.A)
    if fixed_vector([np.hstack([H, A @ H])]) is None:
        return ""
    some = " for weights g with flow.A jump.H g in the span of jump.H" if H.shape[1] > 1 else ""
    return f"; samples show only between which two of them it came{some}"
