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

from lmi.balls import exact, number
from lmi.deficient import MARGIN, check_deficient, decide_full_rank, prove_again
from lmi.stack import Stack
from lmi.verdict import Verdict, overall, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.equations import impulsive as equations
from obsdesign.equations.estimation_error import plant_data
from obsdesign.problem import Problem
from obsdesign.verification.consistency import consistency
from obsdesign.verification.dwell import range_text
from obsdesign.verification.impulsive_alone import alone, quadratic_claims
from obsdesign.verification.impulsive_blocks import (
    blocks_of,
    in_its_coordinates,
    in_state,
    whole_bound,
)
from obsdesign.verification.impulsive_guarantees import guarantees
from obsdesign.verification.impulsive_rate import (
    Bound,
    absorbed,
    in_balls,
    promised,
    quadratic_bound,
    window_reach,
)

__all__ = ["claims", "expected_gains", "guarantees"]

PAPER = "Medina, Lawrence, State Estimation for Linear Impulsive Systems"
_MATRICES = ("A", "C", "G", "image", "coimage", "basis", "core_A", "core_C", "core_G")


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
    low, high = problem.require_dwell_time()
    bounded = _bounded(high)
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
            found.append(_rate(told))
        if rate > 0:
            found.append(_decay(told, rate, high))
    elif rate > 0:
        found.append(_decay(None, rate, high))
    return tuple(found)


def _windowed(
    problem: Problem, numbers: Mapping[str, Any], certificates: Any, paranoid: bool
) -> tuple[list[Claim], Bound | None]:
    """Claims of a window on the plant or on a part of it, and the bound that follows."""
    low, high = problem.require_dwell_time()
    core = equations.core_of(numbers)
    window, alpha = int(numbers["window"]), float(numbers["alpha"])
    certificate = certificates.get("strongly_observable", {})
    found = [_observable(problem, core, window, certificate)]
    own, into = in_its_coordinates(core, low, high, window)
    blocks = blocks_of(numbers, own, into)
    if blocks is None:
        reason = "gains.basis is singular"
        found.append(_nominal(numbers, refuted({"entry": "gains.basis", "reason": reason})))
        return found, None
    rate = float(problem.options.get("decay_rate", 0.0))
    decaying: dict[str, Bound] = {}
    for name, pair in (("hidden", blocks.hidden), ("rest", blocks.rest)):
        if pair is not None:
            claim = alone(name, pair, (low, high), certificates, paranoid, rate)
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
        found.append(_nominal(numbers, verdict))
    if whole is None or found[-1].verdict != "proved":
        return found, None
    with in_balls():
        return found, in_state(whole.bound.perturbed(whole.change), blocks)


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
    if type(window) is not int or window < 1:
        return "gains.window must be a whole number >= 1"
    if type(alpha) is not float or not 1 < alpha < math.inf:
        return "gains.alpha must be a number > 1"
    return None


def _bounded(high: float) -> Claim:
    verdict = proved(longest=high)
    if math.isinf(high):
        reason = (
            "jump.dwell_time has no longest spacing: the bounds of the window, and with them "
            "uniform convergence, need one; give a finite jump.dwell_time[1]"
        )
        verdict = refuted({"entry": "jump.dwell_time", "longest": "inf", "reason": reason})
    return Claim(
        "bounded_spacing",
        "the time between impulses has an upper bound",
        f"{PAPER}, Assumption 2.1",
        verdict.outcome,
        verdict.evidence,
    )


def _nominal(numbers: Mapping[str, Any], verdict: Verdict) -> Claim:
    """The plant is the one that the gain is worked out for."""
    parts = []
    if numbers["strategy"] == "subspace":
        parts.append(
            "in the coordinates of basis, A and G are block upper triangular, with core_A and "
            "core_G in the middle, and C sees core_C there and nothing of the first block"
        )
    if "image" in numbers:
        name = "core_G" if "core_G" in numbers else "G"
        parts.append(f"{name} equals image @ coimage: the error after an impulse is in the image")
    return Claim(
        "invariant" if numbers["strategy"] == "subspace" else "image",
        "; ".join(parts) + "; up to rounding that the proved convergence absorbs",
        f"{PAPER}, section IV, carried over to any plant",
        verdict.outcome,
        verdict.evidence,
    )


def _rate(told: Mapping[str, float]) -> Claim:
    return Claim(
        "rate",
        "the error just before an impulse is, N impulses later, at most constant * per_impulse^N "
        "of what it was, and it decays like e^(-in_time t), for all spacings in the range",
        f"{PAPER}, Theorem 3.1 and Lemma 3.2",
        "proved",
        told,
    )


def _decay(told: Mapping[str, float] | None, rate: float, high: float) -> Claim:
    verdict = undecided("convergence itself is not proved")
    if told is not None:
        with in_balls():
            reached = number(told["per_impulse"]) <= (-number(rate) * number(high)).exp()
        verdict = (
            proved(per_impulse=told["per_impulse"])
            if reached
            else undecided(
                f"the proved rate is {told['in_time']:.6g} per unit of time; alpha must be at least "
                "e^(decay_rate * longest spacing)"
            )
        )
    return Claim(
        "decay_rate",
        f"the error decays like e^(-{rate!r} t)",
        f"{PAPER}, Theorem 3.1",
        verdict.outcome,
        verdict.evidence,
    )


def _observable(
    problem: Problem, core: equations.Core, window: int, certificate: Mapping[str, Any]
) -> Claim:
    low, high = problem.require_dwell_time()
    stack = Stack(*core.stack(window))
    verdict = full_rank(stack, low, high, certificate)
    verdict = _admissible(verdict, problem)
    what = "states" if core.U is None else "states after an impulse"
    return Claim(
        "strongly_observable",
        f"any {window} impulses in a row tell all {what} apart, for every sequence of spacings in "
        f"{range_text(low, high)}: the window matrix has full column rank, its smallest singular "
        f"value above {MARGIN:g} of that at usual spacings",
        f"{PAPER}, Definition 2.3, Lemma 2.6",
        verdict.outcome,
        verdict.evidence,
    )


def full_rank(stack: Stack, low: float, high: float, certificate: Mapping[str, Any]) -> Verdict:
    """The proof again from what a finder left: a margin, or a witness; from scratch without."""
    asked, witness = certificate.get("asked"), certificate.get("witness")
    if isinstance(witness, Mapping):
        verdict = check_deficient(stack, low, high, witness)
        if verdict.outcome == "refuted":
            return verdict
    if not isinstance(asked, float) or not 0 <= asked < math.inf:
        return decide_full_rank(stack, low, high)
    verdict = prove_again(stack, low, high, asked)
    seen = {key: certificate[key] for key in ("approx_sigma_min", "approx_worst", "asked")
            if key in certificate}  # fmt: skip
    return Verdict(verdict.outcome, {**seen, **verdict.evidence})


def _admissible(verdict: Verdict, problem: Problem) -> Verdict:
    """A witness must keep to the jitter that is allowed from one spacing to the next."""
    jump = problem.plant.jump
    thetas = verdict.evidence.get("witness", {}).get("thetas", ())
    if jump is None or verdict.outcome != "refuted":
        return verdict
    if all(abs(b - a) <= jump.dwell_jitter for a, b in zip(thetas[:-1], thetas[1:], strict=True)):
        return verdict
    return undecided("the only spacings found that defeat it change by more than dwell_jitter",
                     **verdict.evidence)  # fmt: skip
