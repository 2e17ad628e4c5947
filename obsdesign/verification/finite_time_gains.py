"""Finite-time estimation: stored gains are the method's, unbiased, and their error is bounded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lmi.balls import entries, exact, identity, scalar, to_float
from lmi.norms import float_above, well_ranked
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.document import Claim
from obsdesign.verification.finite_time_window import (
    PAPER,
    SINGULAR,
    make_claim,
    state_scales,
    with_reason,
)
from obsdesign.window_bounds import disturbance_bound, error_radius
from obsdesign.window_gains import (
    Sampled,
    approximate_gain,
    difference_matrix,
    exact_gain,
    half_period,
)

# largest deviation of G O from the identity, states in units of `state_scales`: what rounding
# leaves of gains that do not amplify beyond reason
UNBIASED = 1e-8
# stored gains agree with their formula to this part of the largest one of a row
SAME_GAIN = 2.0**-40
# a decay e^-36 is beyond the rounding of what it multiplies
_MOST_DECAY = 36.0


def invertible(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """M_T for (14); P^k - A_d^k for (9) with (16), times A_d^-k."""
    L = gains["L"]
    T = sampled.k * sampled.period
    if gains["method"] == "approximate":
        name, source = "difference_invertible", f"{PAPER}, Theorem 1, (2)"
        statement = "M_T = e^(-A T) - e^(-F T), F = A + L C, is invertible"
        matrix = difference_matrix(sampled, L)[0]
    else:
        name, source = "injection_invertible", f"{PAPER}, (9) with (16)"
        statement = "P^k - A_d^k, P = A_d + K_d C = Phi^(-1) over a period, is invertible"
        matrix = exact_gain(sampled, L)[0]
    statement += (
        f" at T = {T:.9g}: scaled, its smallest singular value is at least {SINGULAR:g} of its norm"
    )
    # in units in which the samples see all states about equally well
    scales = state_scales(sampled, sampled.k)
    verdict = well_ranked(matrix * scales / scales[:, None], SINGULAR)
    if verdict.outcome == "refuted":
        why = "L C = 0" if not np.any(np.asarray(L) @ gains["C"]) else f"for this L at T = {T:.9g}"
        letter = "M_T" if gains["method"] == "approximate" else "P^k - A_d^k"
        verdict = with_reason(verdict, f"{letter} is singular: {why}")
    return make_claim(name, statement, source, verdict)


def of_the_method(sampled: Sampled, gains: Mapping[str, Any]) -> Claim:
    """The stored gains are what the formula says, to rounding."""
    approximate = gains["method"] == "approximate"
    of_paper = approximate_gain(sampled, gains["L"]) if approximate else None
    if not approximate:
        of_paper = exact_gain(sampled, gains["L"])[1]
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
    """G O = I up to rounding, by exact numbers; with how much the gains amplify what comes in."""
    rows, n = sampled.rows(), len(sampled.A)
    G = exact(gains["window_gain"])
    scales = state_scales(sampled, sampled.k)
    error = G @ rows - entries(identity(n))
    relative = (error * scales) / scales[:, None]
    size = _root_sum(relative)
    amplified = np.abs(G) @ np.abs(rows)
    amplification = float_above(max(sum(row) for row in amplified))
    limit = scalar(exact(UNBIASED).item())
    evidence = {"amplification": amplification, "error": float_above(size)}
    stated = [[float_above(abs(x)) for x in row] for row in error]
    if size <= limit and not (np.array(stated) <= gains["state_error"]).all():
        verdict = undecided("gains.state_error is below what is proved", **evidence)
    elif size <= limit:
        verdict = proved(**evidence)
    elif size > limit:
        r, c = np.unravel_index(int(np.argmax(stated)), (n, n))
        reason = (
            f"with x{c + 1} = 1 and no noise the estimate of x{r + 1} is off by "
            f"{stated[r][c]:.3g}; the gains amplify by {amplification:.3g}, which costs "
            f"{np.log10(max(amplification, 1)):.0f} of 16 digits"
        )
        reason = _too_fast(sampled) or reason
        verdict = refuted({"state": np.eye(n)[c].tolist(), "reason": reason}, **evidence)
    else:
        verdict = undecided("the gains are not known well enough", **evidence)
    return make_claim(
        "unbiased",
        "the stored gains reproduce every state: sum_j G_j C A_d^(j-k) = I to within "
        f"{UNBIASED:g} (scaled), and |G O - I| <= state_error entry by entry",
        "docs/finite_time.md; Gramian estimator, (16)",
        verdict,
    )


def _too_fast(sampled: Sampled) -> str | None:
    """The reason where a mode decays in the window beyond what binary64 can turn back."""
    T = sampled.k * sampled.period
    fastest = float(-np.linalg.eigvals(to_float(sampled.A)).real.min(initial=0.0))
    if fastest * T < _MOST_DECAY:
        return None
    return (
        f"a mode of A decays by e^-{fastest * T:.3g} over the window T = {T:.6g}, so that samples "
        "at its start cannot be told in terms of the last state in binary64; choose a window "
        f"below {_MOST_DECAY / fastest:.3g}"
    )


def _root_sum(X: Any) -> Any:
    return scalar(sum(x * x for x in X.flat)).sqrt()


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
    return make_claim(
        "error_radius",
        "with noise and disturbance inside their bounds, no estimate of x_r is off by more than "
        "radius_r (attained by noise and disturbance that switch with the signs of their weights)",
        "docs/finite_time.md; error of an unbiased gain",
        verdict,
    )
