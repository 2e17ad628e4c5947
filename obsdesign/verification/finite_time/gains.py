"""Finite-time estimation: stored gains are the method's, unbiased, and their error is bounded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lmi.arithmetic.balls import exact, scalar, to_float
from lmi.arithmetic.norms import float_above, well_ranked
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    approximate_gain,
    difference_matrix,
    exact_gain,
    exact_matrix,
    half_period,
)
from obsdesign.analysis.finite_time.error_radius import bias, disturbance_bound, error_radius
from obsdesign.document import Claim
from obsdesign.equations.finite_time.gains import REFERENCES, START, UNBIASED
from obsdesign.verification.finite_time.window import (
    PAPER,
    SINGULAR,
    make_claim,
    sampled_index,
    with_reason,
)

# stored gains agree with their formula to this part of the largest one of a row
SAME_GAIN = 2.0**-40
# e^36 is beyond the rounding of what it multiplies
_MOST_GROWTH = 36.0
# a radius is the largest error to within this factor
_ATTAINED = 1.000001
# e^0.01 is no growth to speak of
_SOME_GROWTH = 1e-2
# decay within a period, as an exponent, that hides what e^{-A s} is added to
_MOST_IN_A_PERIOD = 10.0
_TOO_MUCH = (
    "the series of e^{-A s} L over one period takes too many steps to be enclosed in a few "
    "seconds; method 'least_squares' does not need it"
)


def invertible(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """M_T for (14); P^k - A_d^k for (9) with (16), alone or times A_d^-k."""
    approximate = gains["method"] == "approximate"
    T = sampled.k * sampled.period
    threshold = f"its smallest singular value is at least {SINGULAR:g} of its norm"
    if approximate:
        name, source = "difference_invertible", f"{PAPER}, Theorem 1, (2)"
        statement = (
            "M_T = e^(-A T) - e^(-F T), F = A + L C, is invertible at "
            f"T = {T:.9g}: scaled, {threshold}"
        )
        verdict = _scaled_rank(sampled, difference_matrix(sampled, gains["L"])[0])
    else:
        name, source = "injection_invertible", f"{PAPER}, (9) with (16)"
        statement = (
            "P^k - A_d^k, P = A_d + K_d C = Phi^(-1) over a period, is invertible at "
            f"T = {T:.9g}: scaled, alone or times A_d^(-k), {threshold}"
        )
        verdict = _of_the_difference(sampled, gains["L"])
    if verdict.outcome == "undecided":
        verdict = undecided(_hidden(sampled) or str(verdict.evidence["reason"]))
    if verdict.outcome == "refuted":
        letter = "M_T" if approximate else "P^k - A_d^k"
        ratio = verdict.evidence["approx_ratio"]
        why = f"{letter} is singular: L C = 0"
        if np.any(np.asarray(gains["L"]) @ gains["C"]):
            least = f"{ratio:.1e}" if ratio > 1e-14 else "less than 1e-14"
            why = (
                f"{letter} is singular, but for {least} of its norm: for this L at T = {T:.9g}; "
                "another L or window might do, or method 'least_squares', which has none"
            )
        verdict = with_reason(verdict, why)
    return make_claim(name, statement, source, verdict)


def _of_the_difference(sampled: Sampled, L: Any) -> Verdict:
    """P^k - A_d^k acts on x(t_i - T), and times A_d^-k on x(t_i): a good one of them is enough.

    Where modes decay by many digits, the second hides those that stay.
    """
    found = []
    for reference in (sampled.reference, *REFERENCES):
        pair = exact_matrix(replace(sampled, reference=reference), L)
        if pair is None:
            return undecided(_TOO_MUCH)
        found.append(_scaled_rank(sampled, pair[0]))
        if found[-1].outcome == "proved":
            return found[-1]
    # `REFERENCES` ends with P^k - A_d^k itself, of which a witness has to speak
    open_ones = [verdict for verdict in found if verdict.outcome == "undecided"]
    return open_ones[0] if open_ones else found[-1]


def _scaled_rank(sampled: Sampled, matrix: Any) -> Verdict:
    """In units in which the samples see all states about equally well."""
    scales = sampled.units()
    return well_ranked(matrix * scales / scales[:, None], SINGULAR)


def _hidden(sampled: Sampled) -> str | None:
    """Why e^{-A s} within one period hides the matrix of a method, if it does."""
    rates = np.linalg.eigvals(to_float(sampled.A)).real
    decay = float(-rates.min(initial=0.0)) * sampled.period
    if decay < _MOST_IN_A_PERIOD:
        return None
    return (
        f"a mode of A decays by e^-{decay:.3g} in one period; the method multiplies by its "
        "inverse, which method 'least_squares' does not need"
    )


def of_the_method(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """The stored gains are what the formula says, to rounding."""
    approximate = gains["method"] == "approximate"
    of_paper = approximate_gain(sampled, gains["L"]) if approximate else None
    if not approximate:
        of_paper = exact_gain(sampled, gains["L"])
    elif of_paper is not None and gains["half_sample"] == "corrected":
        of_paper = half_period(sampled) @ of_paper
    formula = "(14)" if approximate else "(9) with (16)"
    statement = f"the stored gains are those of {formula} for the stored L, to rounding"
    if approximate and gains["half_sample"] == "corrected":
        statement = (
            "the stored gains are those of (14) for the stored L times e^(A nu / 2), which takes "
            "the half-sample delay off, to rounding"
        )
    verdict = undecided("the matrix of the method is not certainly invertible")
    if of_paper is not None:
        verdict = _close(exact(gains["window_gain"]), of_paper)
    return make_claim("gains_of_the_method", statement, f"{PAPER}, {formula}", verdict)


def _close(stored: Any, formula: Any) -> Verdict:
    largest = 0.0
    for r, (row, wanted) in enumerate(zip(stored, formula, strict=True)):
        size = max(abs(x).abs_upper() for x in wanted)
        off = [abs(x - y) for x, y in zip(row, wanted, strict=True)]
        for c, distance in enumerate(off):
            if distance > size * scalar(exact(SAME_GAIN).item()):
                witness = {"entry": [r + 1, c + 1], "reason": f"entry ({r + 1}, {c + 1}) differs"}
                return refuted(witness)
            if not distance <= size * scalar(exact(SAME_GAIN).item()):
                return undecided(f"entry ({r + 1}, {c + 1}) is not known well enough")
        largest = max(largest, float_above(max(off) / size) if size > 0 else 0.0)
    return proved(largest_difference=largest)


def unbiased(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """G O = I, or A_d^k, up to rounding, by exact numbers; with what the gains amplify."""
    error, size = bias(sampled, gains["window_gain"])
    amplified = np.abs(exact(gains["window_gain"])) @ np.abs(sampled.rows())
    amplification = float_above(max(sum(row) for row in amplified))
    limit = scalar(exact(UNBIASED).item())
    evidence: dict[str, Any] = {"amplification": amplification, "error": float_above(size)}
    if sampled.reference == START:
        evidence["reference"] = START
    stated = np.array([[float_above(abs(x)) for x in row] for row in error])
    if size <= limit and not (stated <= gains["state_error"]).all():
        verdict = undecided("gains.state_error is below what is proved", **evidence)
    elif size <= limit and _too_large(sampled, gains["state_error"]):
        reason = f"gains.state_error is above {UNBIASED:g} (scaled), far more than what is missed"
        verdict = refuted({"reason": reason}, **evidence)
    elif size <= limit:
        verdict = proved(**evidence)
    elif size > limit:
        verdict = refuted(_missed(sampled, stated, amplification), **evidence)
    else:
        verdict = undecided("the gains are not known well enough", **evidence)
    source = "docs/finite_time.md; Gramian estimator, (16)"
    if sampled.reference == START:
        statement = (
            "the stored gains reproduce every state up to rounding of what it was at the window's "
            f"start: sum_j G_j C A_d^j = A_d^k to within {UNBIASED:g} (scaled), and "
            "|xhat - x| <= state_error |x(t_i - T)| entry by entry"
        )
    else:
        statement = (
            "the stored gains reproduce every state: sum_j G_j C A_d^(j-k) = I to within "
            f"{UNBIASED:g} (scaled), and |G O - I| <= state_error entry by entry"
        )
    return make_claim("unbiased", statement, source, verdict)


def _too_large(sampled: Sampled, state_error: Any) -> bool:
    """Would bounds that run be wider than what is told, for nothing?"""
    units = sampled.units()
    scaled: list[Any] = list((exact(state_error) * units / units[:, None]).flat)
    return bool(sum(x * x for x in scaled) > exact((2 * UNBIASED) ** 2).item())


def _missed(sampled: Sampled, error: Any, amplification: float) -> dict[str, Any]:
    """A state that is not reproduced, and why; error (n, n) in floats."""
    n = len(error)
    r, c = np.unravel_index(int(np.argmax(error)), (n, n))
    when = " at the window's start" if sampled.reference == START else ""
    costs = (
        f"; the gains amplify by {amplification:.3g}, which costs "
        f"{np.log10(amplification):.0f} of 16 digits"
        if amplification > 1
        else ""
    )
    reason = _too_fast(sampled) or (
        f"with x{c + 1} = 1{when} and no noise the estimate of x{r + 1} is off by "
        f"{error[r][c]:.3g}{costs}"
    )
    return {"state": np.eye(n)[c].tolist(), "reason": reason}


def _too_fast(sampled: Sampled) -> str | None:
    """The reason where modes decay and grow in the window beyond what binary64 can hold."""
    T = sampled.k * sampled.period
    rates = np.linalg.eigvals(to_float(sampled.A)).real
    decay, growth = float(-rates.min(initial=0.0)), float(rates.max(initial=0.0))
    if (decay + growth) * T < _MOST_GROWTH:
        return None
    told = [f"decays by e^-{decay * T:.3g}"] if decay * T > _SOME_GROWTH else []
    told += [f"grows by e^{growth * T:.3g}"] if growth * T > _SOME_GROWTH else []
    limit = _MOST_GROWTH / (decay + growth)
    advice = f"choose a window below {limit:.3g}"
    if limit < sampled_index(sampled) * sampled.period:  # no window of enough samples is
        advice = "choose a shorter period, and with it a shorter window"
    return (
        f"over the window T = {T:.6g} a mode of A {' and another one '.join(told)}, more than "
        f"binary64 can hold; {advice}"
    )


def error_radius_claim(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """The componentwise bound of `window_bounds`, at most the stored radius."""
    bounds = error_radius(
        sampled, gains["window_gain"], gains["noise_bound"], disturbance_bound(gains)
    )
    stored = [scalar(x) for x in exact(gains["radius"])]
    verdict = proved(largest_error=[float_above(x) for x in bounds])
    for r, (bound, radius) in enumerate(zip(bounds, stored, strict=True)):
        if bound > radius:
            reason = (
                f"noise and a switching disturbance inside their bounds move the estimate of "
                f"x{r + 1} by {float_above(bound):.9g}, more than radius {gains['radius'][r]:.9g}"
            )
            verdict = refuted({"state": r + 1, "reason": reason})
            break
        if not bound <= radius:
            verdict = undecided(f"radius of x{r + 1} is too close to the largest error")
            break
        if radius > scalar(exact(float_above(bound) * _ATTAINED).item()):
            reason = (
                f"the estimate of x{r + 1} is off by at most {float_above(bound):.9g}, less than "
                f"radius {gains['radius'][r]:.9g}: what runs is not what is told"
            )
            verdict = refuted({"state": r + 1, "reason": reason})
            break
    return make_claim(
        "error_radius",
        "with noise and disturbance inside their bounds, no estimate of x_r is off by more than "
        f"radius_r, which is attained to within a factor of {_ATTAINED:g} (by noise and "
        "disturbance that switch with the signs of their weights)",
        "docs/finite_time.md; error of an unbiased gain",
        verdict,
    )
