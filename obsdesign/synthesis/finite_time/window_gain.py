"""Gains on the window of finite-time estimation, and what they may be off by, rounded to be stored.

Gains of (14) and (9) come from ball enclosures and are rounded once, so that a matrix with a bad
condition costs no digits; least squares by QR; minimax by a linear program per state. What should
be unbiased is made so to rounding before it is stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lmi.arithmetic.balls import precision, scalar
from lmi.arithmetic.norms import float_above, middles
from lmi.time_budget import remark
from obsdesign.analysis.finite_time.enclosed_gains import (
    Sampled,
    approximate_gain,
    exact_gain,
    half_period,
)
from obsdesign.analysis.finite_time.error_radius import bias, disturbance_bound, error_radius
from obsdesign.equations.finite_time import gains as equations
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.finite_time.minimax import minimax_gain

_BITS = (160, 320)
# a bias above is corrected once more, with exact numbers
_ROUNDING = 1e-13
# parts of the largest singular value of the samples' rows below which a state may count as unseen,
# and the bias that is as good as none
_CUTS = (1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-8)
_WELL = equations.DEAD / 4
# rows that are that far from losing rank, relative to their norm, show every state
_SEEN = 1e-11


def completed(problem: Problem, gains: dict[str, Any]) -> dict[str, Any]:
    """With the gains on the window and what they may be off by.

    Against the last state; where that is hopeless, as fast modes have decayed, against the first.
    """
    if gains["method"] == "approximate":
        return gains | {"window_gain": _window_gain(problem, gains)}
    chosen, error, size = _refined(gains | {"window_gain": _window_gain(problem, gains)})
    if not size <= equations.UNBIASED and np.linalg.eigvals(gains["A"]).real.min() < 0:
        other, of_other, smaller = _against_the_start(problem, gains)
        if smaller <= equations.UNBIASED:
            chosen, error = other, of_other
    chosen = chosen | {"state_error": error}
    return chosen | {"radius": _radius(chosen)} if "noise_bound" in chosen else chosen


def _against_the_start(
    problem: Problem, gains: dict[str, Any]
) -> tuple[dict[str, Any], Any, float]:
    """Gains that speak of the window's start: of all states, or of those that last.

    Modes that die within a period cannot be told apart, and need not be.
    """
    start = gains | {"reference": equations.START}
    if gains["method"] not in equations.FREE:
        return _refined(start | {"window_gain": _window_gain(problem, start)})
    fitted = start | {"method": "least_squares"}

    def missed(cut: float) -> float:
        return _refined(fitted | {"window_gain": _window_gain(problem, fitted, cut)}, cut)[2]

    rows = _rows(start)[0]
    scales = equations.state_scales(gains["A"], gains["C"], gains["samples"] * gains["period"])
    cut, least = 0.0, missed(0.0)
    if not (least <= _WELL and equations.approx_determinacy(rows, scales) > _SEEN):
        sizes = {cut: least} | {other: missed(other) for other in _CUTS}
        well = [other for other in sizes if sizes[other] <= _WELL]
        # the more is cut the less is amplified
        cut = max(well) if well else min(sizes, key=lambda other: sizes[other])
    return _refined(start | {"window_gain": _window_gain(problem, start, cut)}, cut)


def _window_gain(problem: Problem, gains: dict[str, Any], cut: float = 0.0) -> Any:
    """Gains (n, k p) of the method; zeros, which are refuted, where it has none in binary64."""
    A, C, k, method = gains["A"], gains["C"], gains["samples"], gains["method"]
    nothing = np.zeros((len(A), k * len(C)))
    flat, wanted = _rows(gains)
    if not (np.isfinite(flat).all() and np.isfinite(wanted).all()):
        return nothing
    if not cut and equations.approx_determinacy(flat, np.ones(len(A))) == 0.0:
        return nothing
    left = equations.least_squares_gain(
        flat, np.tile(equations.relative_deviations(problem.plant.output), k), cut
    )
    fitted = wanted @ left
    if method == "least_squares":
        return equations.made_unbiased(fitted, flat, left, wanted)
    if method == "minimax":

        def project(gain: Any) -> Any:
            return equations.made_unbiased(gain, flat, left, wanted)

        found, kept = minimax_gain(gains, project(fitted), project)
        if kept:
            told = ", ".join(f"x{r + 1}" for r in kept)
            remark(
                f"minimax: the solvers find nothing better for {told} than least squares, whose "
                "gains are used for it"
            )
        return found
    found = _formula(gains)
    return nothing if found is None or not np.isfinite(found).all() else found


def _rows(gains: dict[str, Any]) -> tuple[Any, Any]:
    """The samples, (k p, n), and the last state, (n, n), as functions of the reference.

    Against the start rounded from enclosures: what has died is rounding of what has not.
    """
    A, k = gains["A"], gains["samples"]
    if gains.get("reference", equations.END) == equations.START:
        with precision(_BITS[1]):
            sampled = _sampled(gains)
            return middles(sampled.rows()), middles(sampled.last())
    rows = equations.sample_rows(A, gains["C"], gains["period"], k)
    wanted = equations.last_state(A, k * gains["period"], equations.END)
    return rows.reshape(-1, len(A)), wanted


def _formula(gains: dict[str, Any]) -> Any:
    """(14), or (9) with (16), rounded from an enclosure that is tight enough."""
    for bits in _BITS:
        with precision(bits):
            sampled = _sampled(gains)
            if gains["method"] == "exact":
                found = exact_gain(sampled, gains["L"])
            else:
                found = approximate_gain(sampled, gains["L"])
                if found is not None and gains["half_sample"] == "corrected":
                    found = half_period(sampled) @ found
            if found is not None:
                return middles(found)
    return None


def _radius(gains: dict[str, Any]) -> Any:
    """(n,): what noise and disturbance inside their bounds do to the estimate, rounded upwards."""
    with precision(_BITS[0]):
        sizes = error_radius(
            _sampled(gains), gains["window_gain"], gains["noise_bound"], disturbance_bound(gains)
        )
        return np.array([float_above(scalar(x)) if x > 0 else 0.0 for x in sizes])


def _refined(gains: dict[str, Any], cut: float = 0.0) -> tuple[dict[str, Any], Any, float]:
    """Gains made unbiased once more; state_error (n, n); the latter's size, units scaled away.

    With exact numbers: floats alone leave a bias that is amplified twice.
    """
    for bits in _BITS:
        with precision(bits):
            found = _refined_once(gains, cut)
        if found[2] <= equations.UNBIASED:
            break
        if np.isfinite(found[2]) and "reference" not in gains:
            break  # no digits are missing
    return found


def _refined_once(gains: dict[str, Any], cut: float) -> tuple[dict[str, Any], Any, float]:
    sampled = _sampled(gains)
    error, size = bias(sampled, gains["window_gain"])
    if gains["method"] in equations.FREE and _ROUNDING < float_above(size) < 1:
        moved = _less(gains, error, cut)
        of_moved, smaller = bias(sampled, moved["window_gain"])
        if float_above(smaller) < float_above(size):
            gains, error, size = moved, of_moved, smaller
    found = np.array([[float_above(abs(x)) for x in row] for row in error])
    return gains, np.where(np.isfinite(found), found, 1e300), float_above(size)


def _less(gains: dict[str, Any], error: Any, cut: float) -> dict[str, Any]:
    """The gains less an error (n, n) of G O."""
    rows = _rows(gains)[0]
    left = equations.least_squares_gain(rows, np.ones(len(rows)), cut)
    return gains | {"window_gain": gains["window_gain"] - middles(error) @ left}


def _sampled(gains: dict[str, Any]) -> Sampled:
    reference = gains.get("reference", equations.END)
    return Sampled.of(gains["A"], gains["C"], gains["period"], gains["samples"], reference)
