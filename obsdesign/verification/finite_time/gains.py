"""Claims of finite-time gains: those of the method, unbiased, with a bounded error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.arithmetic.balls import Exact, exact, scalar, to_float
from lmi.arithmetic.norms import float_above, well_ranked
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    difference_matrix,
    exact_matrix,
    method_gain,
)
from obsdesign.analysis.finite_time.error_radius import bias, disturbance_bound, error_radius
from obsdesign.document import Claim
from obsdesign.equations.finite_time.gains import CORRECTED, FiniteTimeGains
from obsdesign.equations.finite_time.rows import REFERENCES, SINGULAR, START, UNBIASED
from obsdesign.verification.finite_time.evidence import BiasEvidence
from obsdesign.verification.finite_time.window import PAPER, sampled_index, with_reason

# claims that the matrix of a method is invertible, by formula
INVERTIBLE = ("difference_invertible", "injection_invertible")
# stored gains agree with their formula to this part of the largest one of a row
SAME_GAIN = 2.0**-40
# e^36 is beyond the rounding of what it multiplies
_MOST_GROWTH_EXPONENT = 36.0
# a radius is the largest error to within this factor
_ATTAINED_FACTOR = 1.000001
# smaller exponents are not mentioned as growth
_LEAST_GROWTH_EXPONENT = 1e-2
# decay within a period, as an exponent, that hides what e^{-A s} is added to
_MOST_DECAY_EXPONENT = 10.0
_TOO_MANY_STEPS = (
    "the series of e^{-A s} L over one period takes too many steps to be enclosed in a few "
    "seconds; method 'least_squares' does not need it"
)


def invertible(sampled: Sampled, gains: FiniteTimeGains) -> Claim:
    """Claim that M_T, or P^k - A_d^k alone or times A_d^-k, is invertible: (14), (9) with (16)."""
    approximate = not gains.is_unbiased
    T = sampled.k * sampled.period
    threshold = f"its smallest singular value is at least {SINGULAR:g} of its norm"
    if approximate:
        name, source = "difference_invertible", f"{PAPER}, Theorem 1, (2)"
        statement = (
            "M_T = e^(-A T) - e^(-F T), F = A + L C, is invertible at "
            f"T = {T:.9g}: scaled, {threshold}"
        )
        verdict = _scaled_rank(sampled, difference_matrix(sampled, gains.injection)[0])
    else:
        name, source = "injection_invertible", f"{PAPER}, (9) with (16)"
        statement = (
            "P^k - A_d^k, P = A_d + K_d C = Phi^(-1) over a period, is invertible at "
            f"T = {T:.9g}: scaled, alone or times A_d^(-k), {threshold}"
        )
        verdict = _difference_rank(sampled, gains.injection)
    if verdict.outcome == "undecided":
        verdict = undecided(_reason_against_inverse(sampled) or verdict.reason)
    if verdict.outcome == "refuted":
        letter = "M_T" if approximate else "P^k - A_d^k"
        ratio = verdict.evidence["approx_ratio"]
        why = f"{letter} is singular: L C = 0"
        if np.any(gains.injection @ gains.C):
            least = f"{ratio:.1e}" if ratio > 1e-14 else "less than 1e-14"
            why = (
                f"{letter} is nearly singular for this L at T = {T:.9g}: smallest singular value "
                f"{least} of its norm; try another L or window, or method 'least_squares', which "
                "has no L"
            )
        verdict = with_reason(verdict, why)
    return Claim.from_verdict(name, statement, source, verdict)


def _difference_rank(sampled: Sampled, L: Matrix) -> Verdict:
    """Decide the rank of P^k - A_d^k, alone for x(t_i - T) or times A_d^-k for x(t_i).

    One of them is enough: where modes decay by many digits, the second hides the slow ones.
    """
    verdicts = []
    for reference in (sampled.reference, *REFERENCES):
        pair = exact_matrix(replace(sampled, reference=reference), L)
        if pair is None:
            return undecided(_TOO_MANY_STEPS)
        verdicts.append(_scaled_rank(sampled, pair[0]))
        if verdicts[-1].outcome == "proved":
            return verdicts[-1]
    # `REFERENCES` ends with P^k - A_d^k itself, which a witness refers to
    undecided_ranks = [verdict for verdict in verdicts if verdict.outcome == "undecided"]
    return undecided_ranks[0] if undecided_ranks else verdicts[-1]


def _scaled_rank(sampled: Sampled, matrix: Exact) -> Verdict:
    """Decide the rank in units in which all states are about equally observable."""
    return well_ranked(sampled.in_units(matrix), SINGULAR)


def _reason_against_inverse(sampled: Sampled) -> str | None:
    """Reason why e^{-A s} within one period hides the matrix of a method, or None."""
    rates = np.linalg.eigvals(to_float(sampled.A)).real
    decay = float(-rates.min(initial=0.0)) * sampled.period
    if decay < _MOST_DECAY_EXPONENT:
        return None
    return (
        f"a mode of A decays by e^-{decay:.3g} in one period; the method multiplies by its "
        "inverse, which method 'least_squares' does not need"
    )


def method_gains_claim(sampled: Sampled, gains: FiniteTimeGains) -> Claim:
    """Claim that the stored gains are those of the formula, to rounding."""
    enclosed = method_gain(sampled, gains.injection, gains.half_sample)
    formula = "(9) with (16)" if gains.half_sample is None else "(14)"
    statement = f"the stored gains are those of {formula} for the stored L, to rounding"
    if gains.half_sample == CORRECTED:
        statement = (
            "the stored gains are those of (14) for the stored L times e^(A nu / 2), which takes "
            "the half-sample delay off, to rounding"
        )
    verdict = undecided("the matrix of the method is not certainly invertible")
    if enclosed is not None:
        verdict = _agreement(exact(gains.window_gain), enclosed)
    return Claim.from_verdict("gains_of_the_method", statement, f"{PAPER}, {formula}", verdict)


def _agreement(stored: Exact, formula: Exact) -> Verdict:
    """Decide whether stored gains are within `SAME_GAIN` of enclosed ones, row by row."""
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


def unbiased(sampled: Sampled, gains: FiniteTimeGains) -> Claim:
    """Claim that G O = I, or A_d^k, up to rounding, by exact numbers; with the amplification."""
    error, size = bias(sampled, gains.window_gain)
    amplified = np.abs(exact(gains.window_gain)) @ np.abs(sampled.rows)
    amplification = float_above(max(sum(row) for row in amplified))
    limit = scalar(exact(UNBIASED).item())
    evidence = BiasEvidence(amplification, float_above(size), sampled.reference).to_evidence()
    stated = np.array([[float_above(abs(x)) for x in row] for row in error])
    if size <= limit and not (stated <= gains.bias_bound).all():
        verdict = undecided("gains.state_error is below what is proved", **evidence)
    elif size <= limit and _is_too_large(sampled, gains.bias_bound):
        reason = f"gains.state_error is above {UNBIASED:g} (scaled), far above the proved bias"
        verdict = refuted({"reason": reason}, **evidence)
    elif size <= limit:
        verdict = proved(**evidence)
    elif size > limit:
        verdict = refuted(_bias_witness(sampled, stated, amplification), **evidence)
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
    return Claim.from_verdict("unbiased", statement, source, verdict)


def _is_too_large(sampled: Sampled, state_error: Matrix) -> bool:
    """Is the stored state_error more than twice the largest admissible bias?"""
    scaled = sampled.in_units(exact(state_error))
    return bool((scaled * scaled).sum() > exact((2 * UNBIASED) ** 2).item())


def _bias_witness(sampled: Sampled, error: Matrix, amplification: float) -> NewEntries:
    """A state that is not reproduced, and the reason; error (n, n) in floats."""
    n = len(error)
    r, c = np.unravel_index(int(np.argmax(error)), (n, n))
    when = " at the window's start" if sampled.reference == START else ""
    costs = (
        f"; the gains amplify by {amplification:.3g}, which costs "
        f"{np.log10(amplification):.0f} of 16 digits"
        if amplification > 1
        else ""
    )
    reason = _reason_against_window(sampled) or (
        f"with x{c + 1} = 1{when} and no noise the estimate of x{r + 1} is off by "
        f"{error[r][c]:.3g}{costs}"
    )
    return {"state": np.eye(n)[c].tolist(), "reason": reason}


def _reason_against_window(sampled: Sampled) -> str | None:
    """Reason where modes decay and grow in the window beyond binary64, or None."""
    T = sampled.k * sampled.period
    rates = np.linalg.eigvals(to_float(sampled.A)).real
    decay, growth = float(-rates.min(initial=0.0)), float(rates.max(initial=0.0))
    if (decay + growth) * T < _MOST_GROWTH_EXPONENT:
        return None
    changes = []
    if decay * T > _LEAST_GROWTH_EXPONENT:
        changes.append(f"decays by e^-{decay * T:.3g}")
    if growth * T > _LEAST_GROWTH_EXPONENT:
        changes.append(f"grows by e^{growth * T:.3g}")
    limit = _MOST_GROWTH_EXPONENT / (decay + growth)
    advice = f"choose a window below {limit:.3g}"
    if limit < sampled_index(sampled) * sampled.period:  # no window of enough samples is
        advice = "choose a shorter period, and with it a shorter window"
    return (
        f"over the window T = {T:.6g} a mode of A {' and another one '.join(changes)}, more than "
        f"binary64 can hold; {advice}"
    )


def error_radius_claim(sampled: Sampled, gains: FiniteTimeGains) -> Claim:
    """Claim that the largest error of each state is the stored radius, up to rounding."""
    Delta = disturbance_bound(gains.flow_lower, gains.flow_upper)
    bounds = error_radius(sampled, gains.window_gain, gains.noise, Delta)
    stored = [scalar(x) for x in exact(gains.error_bound)]
    verdict = proved(largest_error=[float_above(x) for x in bounds])
    for r, (bound, radius) in enumerate(zip(bounds, stored, strict=True)):
        if bound > radius:
            reason = (
                f"noise and a switching disturbance inside their bounds move the estimate of "
                f"x{r + 1} by {float_above(bound):.9g}, more than radius {gains.error_bound[r]:.9g}"
            )
            verdict = refuted({"state": r + 1, "reason": reason})
            break
        if not bound <= radius:
            verdict = undecided(f"radius of x{r + 1} is too close to the largest error")
            break
        if radius > scalar(exact(float_above(bound) * _ATTAINED_FACTOR).item()):
            reason = (
                f"the estimate of x{r + 1} is off by at most {float_above(bound):.9g}, less than "
                f"radius {gains.error_bound[r]:.9g}: the stored radius is larger than the proved "
                "error"
            )
            verdict = refuted({"state": r + 1, "reason": reason})
            break
    return Claim.from_verdict(
        "error_radius",
        "with noise and disturbance inside their bounds, no estimate of x_r is off by more than "
        f"radius_r, which is attained to within a factor of {_ATTAINED_FACTOR:g} (by noise and "
        "disturbance that switch with the signs of their weights)",
        "docs/finite_time.md; error of an unbiased gain",
        verdict,
    )
