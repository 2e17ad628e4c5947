"""Finite-time estimation: what a user may rely on, in sentences."""

from __future__ import annotations

import math

from obsdesign.analysis.finite_time.requirements import has_announced_jumps
from obsdesign.document import Claim, Guarantee
from obsdesign.equations.finite_time.gains import NEED_L
from obsdesign.equations.finite_time.rows import START, pathological_pairs
from obsdesign.problem.options import FiniteTimeOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.finite_time.discrete_time import step_window_guarantees
from obsdesign.verification.finite_time.evidence import DesignEvidence, TheoremEvidence
from obsdesign.verification.state_widths import StateWidths, errors_of_claim

# rounding of the data is amplified beyond this: most of the 16 digits are at stake
_LARGE_AMPLIFICATION = 1e6
_SMALL_ROW_RATIO = 1e-6


def guarantees(problem: Problem, claims: tuple[Claim, ...]) -> tuple[Guarantee, ...]:
    """The sentences a user may rely on, and those that are not proved."""
    if problem.plant.flow.dt is not None:
        return step_window_guarantees(problem, claims)
    evidence = DesignEvidence.from_claims(claims)
    options = problem.options_as(FiniteTimeOptions)
    result = [_estimate(problem, options, evidence)]
    if evidence.largest_error is not None:
        result.append(_bounded(problem, evidence, evidence.largest_error))
    if problem.plant.output.noise_bound is None and options.method != "approximate":
        text = "Bounds of the state around the estimate: output.noise_bound is not given."
        result.append(Guarantee.not_proved(text))
    if evidence.theorem is not None:
        result.append(_theorem(problem, evidence, evidence.theorem))
    if evidence.tighter is not None and evidence.tighter.is_applicable:
        result.append(_tighter(problem, evidence, evidence.tighter))
    if evidence.transformed is not None and evidence.transformed.is_applicable:
        result.append(_in_coordinates(problem, evidence, evidence.transformed))
    return tuple(result)


def _estimate(problem: Problem, options: FiniteTimeOptions, evidence: DesignEvidence) -> Guarantee:
    """Error of the estimate from a full window without disturbance and noise."""
    absent = ["disturbance", "noise", *_unbounded(problem)]
    free = f"{', '.join(absent[:-1])} or {absent[-1]}"
    since = "or since the last jump, " if has_announced_jumps(problem.plant) else ""
    when = f"Once the window is full of samples {since}and without {free} in it,"
    ids = ["consistent", "observable", "sampled_observable", "window_long_enough"]
    if options.method != "approximate":
        is_relative = evidence.bias is not None and evidence.bias.reference == START
        reference = " of what it was at the window's start" if is_relative else ""
        text = f"{when} the estimate is the state, to rounding{reference}."
        return Guarantee.from_verdicts(text, [*ids, "unbiased"], evidence.verdicts)
    ids += ["difference_invertible", "gains_of_the_method"]
    if evidence.error_factor is not None:
        factor = evidence.error_factor
        text = f"{when} the estimate is off by at most {factor:.6g} times the largest |x| in it."
        return Guarantee.from_verdicts(text, [*ids, "error_identity"], evidence.verdicts)
    order = "second" if options.half_sample_correction else "first"
    text = f"{when} the estimate is off by a term of {order} order in the period."
    return Guarantee.from_verdicts(text, ids, evidence.verdicts)


def _unbounded(problem: Problem) -> list[str]:
    """Names of unknown signals without bounds."""
    plant = problem.plant
    names = ["unknown input d"] if plant.flow.D is not None else []
    is_hidden = plant.jump is not None and not has_announced_jumps(plant)
    return [*names, "unannounced impulses"] if is_hidden else names


def _bounded(problem: Problem, evidence: DesignEvidence, largest_error: list[float]) -> Guarantee:
    """Bounds of the state around the estimate, where disturbance and noise have theirs."""
    free = " or ".join(_unbounded(problem))
    sizes = ", ".join(f"{x:.6g}" for x in largest_error)
    if evidence.has_decayed_modes:
        text = (
            "With disturbance and noise inside their bounds, and a full window"
            f"{' without ' + free if free else ''} and no sample missing, the state is at a "
            f"sample this far from the estimate: {sizes}, and state_error times what it was at "
            "the window's start. The samples do not bound modes that decay within one period, so "
            "that the bounds at run time are infinite."
        )
    else:
        text = (
            "With disturbance and noise inside their bounds, a full window"
            f"{' without ' + free if free else ''} and no sample missing, the state is inside the "
            f"stated bounds; at a sample they are this far from the estimate: {sizes}."
        )
    return Guarantee.from_verdicts(text, ["unbiased", "error_radius"], evidence.verdicts)


def _hypotheses_of_theorem(problem: Problem) -> str:
    """Conditions of Theorem 1: (14) as printed, and no unknown signal in the window."""
    free = " or ".join(["without disturbance", "noise", *_unbounded(problem)])
    since = ", and since the last jump" if has_announced_jumps(problem.plant) else ""
    is_corrected = problem.options_as(FiniteTimeOptions).half_sample_correction
    stage = " before its half-sample correction, which is not what runs" if is_corrected else ""
    return f"for observer (14) with this L{stage}, {free} in the window{since}, as corrected"


def _bound(constants: TheoremEvidence) -> str:
    """The right-hand side of Theorem 1."""
    alpha, beta, last = constants.factors
    return (
        f"{alpha:.6g} |int e^(A (t_i - m - T)) delta dm| + {beta:.6g} |T~| + {last:.6g} T_Delta, "
        "integrals over the window"
    )


def _theorem(problem: Problem, evidence: DesignEvidence, constants: TheoremEvidence) -> Guarantee:
    """Theorem 1 where (13) holds, with its constants; else (13) with its number."""
    longest = constants.longest_period
    below = "" if longest == "inf" else f"; it holds for periods below {longest:.9g}"
    if constants.is_applicable:
        text = (
            f"Theorem 1 {_hypotheses_of_theorem(problem)}: |xhat - x| <= {_bound(constants)} "
            f"((13) is true{below})."
        )
        return Guarantee.from_verdicts(text, ["theorem_1_numbers"], evidence.verdicts)
    verdict = "is false" if constants.condition_13 == "false" else "is too close to call"
    return Guarantee.not_proved(
        f"The bound of Theorem 1 for observer (14): its condition (13) {verdict} here{below}."
    )


def _tighter(problem: Problem, evidence: DesignEvidence, constants: TheoremEvidence) -> Guarantee:
    """The theorem with a tighter Lemma 2, where its condition holds: a smaller bound."""
    longest = constants.longest_period
    below = "" if longest == "inf" else f", which it is for periods below {longest:.9g}"
    text = (
        f"With a tighter Lemma 2 Theorem 1 {_hypotheses_of_theorem(problem)}, says more: "
        f"|xhat - x| <= {_bound(constants)} (its condition, with that in place of Sigma, is "
        f"true{below})."
    )
    return Guarantee.from_verdicts(text, ["theorem_1_tighter"], evidence.verdicts)


def _in_coordinates(
    problem: Problem, evidence: DesignEvidence, constants: TheoremEvidence
) -> Guarantee:
    """Theorem 1 for S x, and the bound of |x| that follows."""
    alpha, beta, last = constants.factors
    back = math.inf if constants.norm_of_back is None else constants.norm_of_back[1]
    text = (
        f"Theorem 1 {_hypotheses_of_theorem(problem)}, in the coordinates S x: "
        f"|S (xhat - x)| <= {alpha:.6g} |S int e^(A (t_i - m - T)) delta dm| + {beta:.6g} |S T~| + "
        f"{last:.6g} T_Delta with |S .| inside it, and |xhat - x| is at most "
        f"{back:.6g} times that ((13) is true for S A S^-1, C S^-1, S L)."
    )
    return Guarantee.from_verdicts(text, ["theorem_1_coordinates"], evidence.verdicts)


def states(problem: Problem, claims: tuple[Claim, ...]) -> tuple[StateWidths, ...]:
    """Proved bound of the error of each state at a sample."""
    return errors_of_claim(problem, claims, "error_radius", "largest_error")


def warnings(problem: Problem, claims: tuple[Claim, ...]) -> tuple[str, ...]:
    """Sentences on options that have no effect, pathological sampling and lost digits."""
    evidence = DesignEvidence.from_claims(claims)
    sentences = []
    plant, method = problem.plant, problem.options_as(FiniteTimeOptions).method
    if "L" in problem.gains and method not in NEED_L:
        sentences.append(f"observer.gains.L is not used: method {method!r} has no L.")
    if "sampled_observable" in evidence.verdicts:
        for first, second, turns in pathological_pairs(plant.flow.A, plant.output.sample_period):
            sentences.append(
                f"The period is near pathological sampling: the eigenvalues {first:.6g} and "
                f"{second:.6g} differ by {turns:.6g} x 2 pi i / period, and only several outputs "
                "together distinguish them."
            )
    if evidence.row_ratio < _SMALL_ROW_RATIO:
        sentences.append(
            "The window barely determines the state: the smallest singular value of its scaled "
            f"rows is {evidence.row_ratio:.1e} of their norm."
        )
    amplification = 1.0 if evidence.bias is None else evidence.bias.amplification
    if amplification > _LARGE_AMPLIFICATION:
        sentences.append(
            f"The gains are ill-conditioned: rounding of the samples is amplified by "
            f"{amplification:.1e}, about {math.log10(amplification):.0f} of 16 digits are lost."
        )
    return tuple(sentences)
