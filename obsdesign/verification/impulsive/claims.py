"""Impulsive observers: every hypothesis of Theorem 3.1 about given gains, proved for all spacings.

Source: E. A. Medina, D. A. Lawrence, State Estimation for Linear Impulsive Systems. The claims
speak about the stored binary64 numbers; strong observability is proved with a margin, for every
sequence of spacings in `jump.dwell_time` (Definition 2.3 restricted to it, as its proofs use it).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact
from lmi.verdict import overall, proved, refuted, undecided
from obsdesign.analysis.hidden_modes import hidden_for_ever
from obsdesign.analysis.impulsive_noise import estimate, missed
from obsdesign.document import Claim
from obsdesign.equations.estimation_error import plant_data, seen_before_jump
from obsdesign.equations.impulsive import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.verification.choices import mark_witness
from obsdesign.verification.consistency import consistency
from obsdesign.verification.dwell import Dwell
from obsdesign.verification.impulsive.blocks import (
    blocks_of,
    in_its_coordinates,
    in_state,
    whole_bound,
)
from obsdesign.verification.impulsive.guarantees import guarantees
from obsdesign.verification.impulsive.rate import (
    Bound,
    absorbed,
    in_balls,
    promised,
    quadratic_bound,
    window_reach,
)
from obsdesign.verification.impulsive.statements import (
    bounded_spacing,
    decay_claim,
    missed_target,
    nominal_plant,
    rate_claim,
    strongly_observable,
)
from obsdesign.verification.impulsive.windowless import alone, quadratic_claims

__all__ = ["claims", "expected_gains", "guarantees"]

_MATRICES = ("A", "C", "G", "image", "coimage", "basis", "core_A", "core_C", "core_G")


@np.errstate(all="ignore")
def claims(
    problem: Problem,
    gains: Mapping[str, Any],
    certificates: Mapping[str, Mapping[str, Any]],
    *,
    paranoid: bool = False,
) -> tuple[Claim, ...]:
    """All hypotheses of the design's theorem, each with its verdict.

    certificates: {"strongly_observable": {"asked"} or {"witness"}} and what the strategies add.
    """
    objection = equations.objection(problem.plant) or _unreadable(gains)
    agreement = consistency(objection, gains, {} if objection else expected_gains(problem, gains))
    if agreement.verdict != "proved":
        return (agreement,)
    high = problem.require_dwell_time()[1]
    bounded = bounded_spacing(high)
    if bounded.verdict != "proved":
        return agreement, bounded
    numbers = dict(gains) | {name: exact(gains[name]) for name in _MATRICES if name in gains}
    rate = float(problem.options.get("decay_rate", 0.0))
    if gains["strategy"] == "quadratic":
        found, bound = quadratic_claims(problem, numbers, certificates, paranoid)
    else:
        found, bound = _windowed(problem, numbers, certificates, paranoid)
    found = [agreement, bounded, *found]
    if overall(claim.verdict for claim in found) == "proved" and bound is not None:
        with in_balls():
            told = promised(bound, high, certificates.get("rate", {}))
        if told is not None:
            told_too = "estimated" in certificates.get("rate", {})
            found.append(rate_claim(told, estimate(problem, gains) if told_too else None))
        if rate > 0:
            found.append(decay_claim(told, rate, high))
    elif rate > 0:
        found.append(decay_claim(None, rate, high))
    if certificates.get("noise_target"):
        found.append(missed_target(missed(problem, gains)))
    return tuple(found)


def _windowed(
    problem: Problem, numbers: Mapping[str, Any], certificates: Any, paranoid: bool
) -> tuple[list[Claim], Bound | None]:
    """Claims of a window on the plant or on a part of it, and the bound that follows."""
    low, high = problem.require_dwell_time()
    core = equations.core_of(numbers)
    window, alpha = int(numbers["window"]), float(numbers["alpha"])
    certificate = certificates.get("strongly_observable", {})
    found = [strongly_observable(problem, core, window, certificate)]
    own, into = in_its_coordinates(core, low, high, window)
    blocks = blocks_of(numbers, own, into)
    if blocks is None:
        reason = "gains.basis is singular"
        found.append(nominal_plant(numbers, refuted({"entry": "gains.basis", "reason": reason})))
        return found, None
    rate = float(problem.options.get("decay_rate", 0.0))
    decaying: dict[str, Bound] = {}
    for name, pair in (("hidden", blocks.hidden), ("rest", blocks.rest)):
        if pair is not None:
            claim = alone(name, pair, Dwell.of(problem), certificates, paranoid, rate)
            if name == "hidden" and (blocks.exact or _has_undetectable_part(problem)):
                claim = mark_witness(claim)  # no basis changes what no measurement sees
            found.append(claim)
            if "P" in claim.evidence:
                P = np.asarray(claim.evidence["P"], dtype=np.float64)
                decaying[name] = quadratic_bound(P, claim.evidence["factor"])
    whole = None
    if overall(claim.verdict for claim in found) == "proved":
        with in_balls():
            reach = window_reach(own, low, high, window, alpha, found[0].evidence)
            whole = whole_bound(blocks, reach, decaying, high, rate)
    if numbers["strategy"] != "full":
        verdict = proved(exact=True)
        if not blocks.exact:
            verdict = undecided("it differs from it, and no convergence is proved to absorb that")
            if whole is not None:
                with in_balls():
                    verdict = absorbed(whole.bound, whole.change)
        found.append(nominal_plant(numbers, verdict))
    if whole is None or found[-1].verdict != "proved":
        return found, None
    with in_balls():
        return found, in_state(whole.bound, blocks)


def _has_undetectable_part(problem: Problem) -> bool:
    """Is a part of the state unobservable for all dwell times, and does not decay? Exactly."""
    flow, jump, output = problem.plant.flow, problem.plant.jump, problem.plant.output
    assert jump is not None
    C = seen_before_jump(jump.G, output.C, output.jump_measurement)
    return hidden_for_ever(flow.A, jump.G, C, problem.require_dwell_time()) is not None


def expected_gains(problem: Problem, gains: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of `gains` and what the problem says of them: a value, or the shape it must have."""
    n, p = problem.plant.n, problem.plant.p
    asked = problem.options.get("strategy", "auto")
    words = set(equations.STRATEGIES) if asked == "auto" else {asked}
    expected: dict[str, Any] = plant_data(problem.plant) | {"strategy": words}
    strategy, d = gains["strategy"], n
    if strategy == "quadratic":
        cells = len(gains["cells"])
        return expected | {"cells": (cells,), "table": (cells - 1, n, p)}
    if strategy == "subspace":
        d = int(gains["core_place"][1])
        expected |= {"basis": (n, n), "core_place": (2,)}
        expected |= {"core_A": (d, d), "core_C": (p, d), "core_G": (d, d)}
    if strategy == "compressed" or "image" in gains:
        r = np.shape(gains["image"])[-1]
        expected |= {"image": (d, r), "coimage": (r, d)}
    for name in ("window", "alpha"):
        expected[name] = problem.options.get(name, gains[name])
    return expected


def _unreadable(gains: Mapping[str, Any]) -> str | None:
    """What makes gains useless before they are compared; one sentence."""
    strategy = gains.get("strategy")
    if strategy not in equations.STRATEGIES:
        return f"gains.strategy must be one of {', '.join(equations.STRATEGIES)}"
    needed = {
        "full": (),
        "compressed": ("image",),
        "subspace": ("core_place",),
        "quadratic": ("cells",),
    }[strategy]
    for name in needed:
        if not isinstance(gains.get(name), np.ndarray) or not gains[name].size:
            return f"gains.{name} is missing"
    if strategy == "quadratic":
        return None
    window, alpha = gains.get("window"), gains.get("alpha")
    if type(window) is not int or not 1 <= window <= equations.LONGEST_WINDOW:
        return f"gains.window must be a whole number from 1 to {equations.LONGEST_WINDOW}"
    if type(alpha) is not float or not 1 < alpha < math.inf:
        return "gains.alpha must be a number > 1"
    return None
