"""Finite-time estimation: what a user may rely on, in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from obsdesign.document import Claim
from obsdesign.equations.finite_time import gains as equations
from obsdesign.problem.problem import Problem

# rounding of the data is amplified beyond this: most of the 16 digits are at stake
_HUGE = 1e6
_WEAK = 1e-6


def guarantees(problem: Problem, found: tuple[Claim, ...]) -> tuple[dict[str, Any], ...]:
    """The sentences a user may rely on, and those that were asked for and not proved."""
    verdicts = {claim.id: claim.verdict for claim in found}
    evidence = {claim.id: claim.evidence for claim in found}
    method = problem.options.get("method", "least_squares")
    told = [_estimate(problem, method, evidence), *_bounded(problem, evidence)]
    result = [_entry(text, ids, verdicts) for text, ids in told]
    if problem.plant.output.noise_bound is None and method != "approximate":
        text = "Bounds of the state around the estimate: output.noise_bound is not given."
        result.append({"statement": text, "given": False, "claims": []})
    if "theorem_1_numbers" in evidence:
        result.append(_theorem(problem, evidence["theorem_1_numbers"], verdicts))
    if evidence.get("theorem_1_tighter", {}).get("condition_13") == "true":
        result.append(_tighter(problem, evidence["theorem_1_tighter"], verdicts))
    if evidence.get("theorem_1_coordinates", {}).get("condition_13") == "true":
        result.append(_in_coordinates(problem, evidence["theorem_1_coordinates"], verdicts))
    return (*result, *_warnings(problem, evidence))


def _entry(text: str, ids: list[str], verdicts: Mapping[str, str]) -> dict[str, Any]:
    given = all(verdicts.get(name) == "proved" for name in ids)
    return {"statement": text, "given": given, "claims": ids}


def _estimate(problem: Problem, method: str, evidence: Mapping[str, Any]) -> tuple[str, list[str]]:
    """When and without what the estimate is the state, or near to it."""
    plant = problem.plant
    without = ["disturbance", "noise", *_unbounded(problem)]
    announced = equations.announced_jumps(plant)
    free = f"{', '.join(without[:-1])} or {without[-1]}"
    since = "or since the last jump, " if announced else ""
    when = f"Once the window is full of samples {since}and without {free} in it,"
    ids = ["consistent", "observable", "sampled_observable", "window_long_enough"]
    if method != "approximate":
        of_what = ""
        if evidence.get("unbiased", {}).get("reference") == equations.START:
            of_what = " of what it was at the window's start"
        return f"{when} the estimate is the state, to rounding{of_what}.", [*ids, "unbiased"]
    ids += ["difference_invertible", "gains_of_the_method"]
    if "error_identity" in evidence:
        factor = evidence["error_identity"].get("factor", math.inf)
        return (
            f"{when} the estimate is off by at most {factor:.6g} times the largest |x| in it.",
            [*ids, "error_identity"],
        )
    order = "second" if problem.options.get("half_sample_correction") else "first"
    return f"{when} the estimate is off by a term of {order} order in the period.", ids


def _unbounded(problem: Problem) -> list[str]:
    """What moves the state without bounds and without being told."""
    plant = problem.plant
    found = ["unknown input d"] if plant.flow.D is not None else []
    hidden = plant.jump is not None and not equations.announced_jumps(plant)
    return [*found, "unannounced impulses"] if hidden else found


def _bounded(problem: Problem, evidence: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Bounds of the state around the estimate, where disturbance and noise have theirs."""
    if "error_radius" not in evidence:
        return []
    free = " or ".join(_unbounded(problem))
    sizes = evidence["error_radius"].get("largest_error", [])
    told = ", ".join(f"{x:.6g}" for x in sizes)
    if evidence.get("window_long_enough", {}).get("died_out"):
        return [
            (
                "With disturbance and noise inside their bounds, and a full window"
                f"{' without ' + free if free else ''} and no sample missing, the state is at a "
                f"sample this far from the estimate: {told}, and state_error times what it was at "
                "the window's start. The samples do not bound all of that, modes that die within a "
                "period: the bounds that run are infinite.",
                ["unbiased", "error_radius"],
            )
        ]
    return [
        (
            "With disturbance and noise inside their bounds, a full window"
            f"{' without ' + free if free else ''} and no sample missing, the state is inside the "
            f"stated bounds; at a sample they are this far from the estimate: {told}.",
            ["unbiased", "error_radius"],
        )
    ]


def _of_the_theorem(problem: Problem) -> str:
    """What Theorem 1 speaks of: (14) as printed, and nothing unknown in the window."""
    free = " or ".join(["without disturbance", "noise", *_unbounded(problem)])
    since = ", and since the last jump" if equations.announced_jumps(problem.plant) else ""
    taken = ""
    if problem.options.get("half_sample_correction"):
        taken = " before its half-sample correction, which is not what runs"
    return f"for observer (14) with this L{taken}, {free} in the window{since}, as corrected"


def _bound(evidence: Mapping[str, Any]) -> str:
    """The right-hand side of Theorem 1."""
    alpha, beta = evidence["alpha"][1], evidence["beta"][1]
    last = evidence["gamma"][1] * evidence["sigma"][1]
    return (
        f"{alpha:.6g} |int e^(A (t_i - m - T)) delta dm| + {beta:.6g} |T~| + {last:.6g} T_Delta, "
        "integrals over the window"
    )


def _theorem(
    problem: Problem, evidence: Mapping[str, Any], verdicts: Mapping[str, str]
) -> dict[str, Any]:
    """Theorem 1 where (13) holds, with its constants; else (13) with its number."""
    longest = evidence["longest_period"]
    below = "" if longest == "inf" else f"; it holds for periods below {longest:.9g}"
    if evidence["condition_13"] == "true":
        text = (
            f"Theorem 1 {_of_the_theorem(problem)}: |xhat - x| <= {_bound(evidence)} "
            f"((13) is true{below})."
        )
        return _entry(text, ["theorem_1_numbers"], verdicts)
    word = "is false" if evidence["condition_13"] == "false" else "is too close to call"
    text = f"The bound of Theorem 1 for observer (14): its condition (13) {word} here{below}."
    return {"statement": text, "given": False, "claims": []}


def _tighter(
    problem: Problem, evidence: Mapping[str, Any], verdicts: Mapping[str, str]
) -> dict[str, Any]:
    """The theorem with a tighter Lemma 2, where its condition holds: a smaller bound."""
    longest = evidence["longest_period"]
    below = "" if longest == "inf" else f", which it is for periods below {longest:.9g}"
    text = (
        f"With a tighter Lemma 2 Theorem 1 {_of_the_theorem(problem)}, says more: |xhat - x| <= "
        f"{_bound(evidence)} (its condition, with that in place of Sigma, is true{below})."
    )
    return _entry(text, ["theorem_1_tighter"], verdicts)


def _in_coordinates(
    problem: Problem, evidence: Mapping[str, Any], verdicts: Mapping[str, str]
) -> dict[str, Any]:
    """Theorem 1 for S x, and what that says of x."""
    alpha, beta = evidence["alpha"][1], evidence["beta"][1]
    last = evidence["gamma"][1] * evidence["sigma"][1]
    text = (
        f"Theorem 1 {_of_the_theorem(problem)}, in the coordinates S x: "
        f"|S (xhat - x)| <= {alpha:.6g} |S int e^(A (t_i - m - T)) delta dm| + {beta:.6g} |S T~| + "
        f"{last:.6g} T_Delta with |S .| inside it, and |xhat - x| is at most "
        f"{evidence['norm_of_back'][1]:.6g} times that ((13) is true for S A S^-1, C S^-1, S L)."
    )
    return _entry(text, ["theorem_1_coordinates"], verdicts)


def _warnings(problem: Problem, evidence: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a user should know although the claims hold."""
    told = []
    plant = problem.plant
    method = problem.options.get("method", "least_squares")
    if "L" in problem.gains and method not in equations.NEED_L:
        told.append(
            f"An estimate that depends on observer.gains.L: method {method!r} has no L, and the "
            "one of the file is not used."
        )
    if evidence.get("sampled_observable"):
        for one, other, turns in equations.pathological_pairs(
            plant.flow.A, plant.output.period or 1.0
        ):
            told.append(
                f"A period away from pathological sampling: the eigenvalues {one:.6g} and "
                f"{other:.6g} differ by {turns:.6g} x 2 pi i / period, and only together do the "
                "outputs tell them apart."
            )
    ratio = evidence.get("window_long_enough", {}).get("approx_ratio", 1.0)
    if ratio < _WEAK:
        told.append(
            "A window that determines the state well: the smallest singular value of its scaled "
            f"rows is {ratio:.1e} of their norm."
        )
    amplified = evidence.get("unbiased", {}).get("amplification", 1.0)
    if amplified > _HUGE:
        told.append(
            f"Well-conditioned gains: rounding of the samples is amplified by {amplified:.1e}, "
            f"about {math.log10(amplified):.0f} of 16 digits are lost."
        )
    return [{"statement": text, "given": False, "claims": []} for text in told]
