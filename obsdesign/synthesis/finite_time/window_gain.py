"""Gains on the window of finite-time estimation and bounds of their errors, as stored.

Gains of (14) and (9) come from ball enclosures and are rounded once, so that a matrix with a bad
condition costs no digits; least squares by QR; minimax by a linear program per state. Gains that
should be unbiased are made so to rounding before they are stored.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, precision, scalar
from lmi.arithmetic.norms import float_above, middles
from lmi.solvers import Solvers
from lmi.time_budget import Remark
from obsdesign.analysis.finite_time.enclosed_gains import method_gain
from obsdesign.analysis.finite_time.error_radius import (
    PRECISIONS,
    bias,
    disturbance_bound,
    error_radius,
)
from obsdesign.analysis.finite_time.requirements import stored_plant
from obsdesign.equations.finite_time.gains import FREE, FiniteTimeGains
from obsdesign.equations.finite_time.rows import (
    DECAYED,
    END,
    SINGULAR,
    UNBIASED,
    approx_determinacy,
    last_state,
    least_squares_gain,
    sample_rows,
    unbiased_gain,
)
from obsdesign.errors import InputError
from obsdesign.synthesis.finite_time.minimax import minimax_gain
from obsdesign.synthesis.finite_time.window_task import WindowTask

_BITS = (160, 320)
# a bias above is corrected once more, with exact numbers
_ROUNDING = 1e-13
# parts of the largest singular value of the samples' rows below which a state may count as
# unobserved, and the bias that is as good as none
_CUTS = (1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-8)
_NEGLIGIBLE_BIAS = DECAYED / 4
# an error beyond floats, as it is stored
_UNBOUNDED = 1e300


@dataclass(frozen=True)
class CompletedGains:
    """The gains of a design, the remarks of their search, and the solvers that made them."""

    gains: FiniteTimeGains
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


@dataclass(frozen=True)
class _MethodGain:
    """Gains (n, k p) of the method, the remarks of their search, and the solvers that made them."""

    gain: Matrix
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


@dataclass(frozen=True)
class _UnbiasedGain:
    """Gains (n, k p), |bias| entry by entry (n, n), and its size with units scaled away."""

    gain: Matrix
    state_error: Matrix
    size: float
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


def completed_gains(task: WindowTask) -> CompletedGains:
    """The gains of a design: those on the window, and bounds of their errors.

    Their bias is bounded relative to the last state; where fast modes have decayed too far for
    that, relative to the first.
    """
    if task.method == "approximate":
        of_method = _window_gain(task)
        return CompletedGains(_stored_gains(task, of_method.gain), of_method.remarks)
    chosen = _refined(task)
    remarks = chosen.remarks
    if not chosen.size <= UNBIASED and np.linalg.eigvals(task.A).real.min() < 0:
        relative = _gains_relative_to_start(task.relative_to_start())
        remarks += relative.remarks
        if relative.size <= UNBIASED:
            task, chosen = task.relative_to_start(), relative
    noise = task.plant.output.noise_radius
    is_biased = not chosen.size <= UNBIASED
    radius = None if noise is None else _radius(task, chosen.gain, noise, is_biased)
    gains = _stored_gains(task, chosen.gain, chosen.state_error, radius)
    return CompletedGains(gains, remarks, chosen.solvers)


def _stored_gains(
    task: WindowTask, gain: Matrix, state_error: Matrix | None = None, radius: Matrix | None = None
) -> FiniteTimeGains:
    return FiniteTimeGains(
        **stored_plant(task.plant),
        method=task.method,
        samples=task.samples,
        half_sample=task.half_sample,
        deviations=task.deviations if task.method == "least_squares" else None,
        L=task.L,
        reference=task.reference if task.is_relative_to_start else None,
        window_gain=gain,
        state_error=state_error,
        radius=radius,
    )


def _gains_relative_to_start(task: WindowTask) -> _UnbiasedGain:
    """Gains whose bias is bounded relative to x(t_i - T), for all or only the slow modes.

    Modes that decay within a period cannot be distinguished by the samples, and need not be.
    """
    if task.method not in FREE:
        return _refined(task)
    fitted = replace(task, method="least_squares")

    def bias_with(cut: float) -> float:
        return _refined(fitted, cut).size

    cut, least = 0.0, bias_with(0.0)
    is_determined = approx_determinacy(_rows(task)[0], task.scales) > SINGULAR
    if not (least <= _NEGLIGIBLE_BIAS and is_determined):
        sizes = {cut: least} | {larger: bias_with(larger) for larger in _CUTS}
        negligible = [each for each in sizes if sizes[each] <= _NEGLIGIBLE_BIAS]
        # larger cuts amplify less
        cut = max(negligible) if negligible else min(sizes, key=lambda each: sizes[each])
    return _refined(task, cut)


def _window_gain(task: WindowTask, cut: float = 0.0) -> _MethodGain:
    """Gains of the method; zeros, which are refuted, where it has none in binary64."""
    zeros = _MethodGain(np.zeros((len(task.A), task.samples * len(task.C))))
    rows, wanted = _rows(task)
    if not (np.isfinite(rows).all() and np.isfinite(wanted).all()):
        return zeros
    if not cut and approx_determinacy(rows, np.ones(len(task.A))) == 0.0:
        return zeros
    left_inverse = least_squares_gain(rows, np.tile(task.deviations, task.samples), cut)

    def projected(gain: Matrix) -> Matrix:
        return unbiased_gain(gain, rows, left_inverse, wanted)

    fitted = wanted @ left_inverse
    if task.method == "least_squares":
        return _MethodGain(projected(fitted))
    if task.method == "minimax":
        least = minimax_gain(task, projected(fitted), projected)
        return _MethodGain(least.gain, _remark_kept(least.kept), least.solvers)
    formula = None if task.L is None else _formula(task, task.L)
    if formula is None or not np.isfinite(formula).all():
        return zeros
    return _MethodGain(formula)


def _remark_kept(kept: list[int]) -> tuple[Remark, ...]:
    """Remark on the states whose gains are those of least squares."""
    if not kept:
        return ()
    names = ", ".join(f"x{r + 1}" for r in kept)
    text = (
        f"minimax: the solvers find nothing better for {names} than least squares, whose "
        "gains are used for it"
    )
    return (Remark(text),)


def _rows(task: WindowTask) -> tuple[Matrix, Matrix]:
    """The samples, (k p, n), and the last state, (n, n), as functions of the reference.

    Relative to the start they are rounded from enclosures: decayed modes drown in the rounding of
    the others.
    """
    if task.is_relative_to_start:
        with precision(_BITS[1]):
            sampled = task.sampled()
            return middles(sampled.rows), middles(sampled.last)
    rows = sample_rows(task.A, task.C, task.period, task.samples)
    wanted = last_state(task.A, task.samples * task.period, END)
    return rows.reshape(-1, len(task.A)), wanted


def _formula(task: WindowTask, L: Matrix) -> Matrix | None:
    """(14), or (9) with (16), rounded from an enclosure that is tight enough."""
    for bits in _BITS:
        with precision(bits):
            enclosed = method_gain(task.sampled(), L, task.half_sample)
            if enclosed is not None:
                return np.asarray(middles(enclosed))
    return None


def _radius(task: WindowTask, gain: Matrix, noise: Matrix, is_biased: bool) -> Matrix:
    """Largest errors (n,) under noise and disturbance inside their bounds, rounded upwards.

    Biased gains are refuted, however few digits their radius has.
    """
    flow = task.plant.flow
    Delta = disturbance_bound(*flow.b_bounds)
    for bits in PRECISIONS:
        with precision(bits):
            sizes = error_radius(task.sampled(), gain, noise, Delta)
            above = np.array([0.0 if x == 0 else float_above(scalar(x)) for x in sizes])
            is_known = all(x == 0 or x > 0 for x in sizes)
        if is_known or (is_biased and np.isfinite(above).all()):
            return above
    raise InputError(
        f"observer.window = {task.samples * task.period!r} is too long for bounds: the errors of "
        f"{task.samples} samples drown in rounding. Choose a shorter window."
    )


def _refined(task: WindowTask, cut: float = 0.0) -> _UnbiasedGain:
    """The gain of the method, made unbiased once more, with exact numbers.

    Floats alone leave a bias that is amplified twice.
    """
    of_method = _window_gain(task, cut)
    for bits in _BITS:
        with precision(bits):
            refined = _refined_once(task, of_method.gain, cut)
        if refined.size <= UNBIASED:
            break
        if np.isfinite(refined.size) and not task.is_relative_to_start:
            break  # no digits are missing
    return replace(refined, remarks=of_method.remarks, solvers=of_method.solvers)


def _refined_once(task: WindowTask, gain: Matrix, cut: float) -> _UnbiasedGain:
    sampled = task.sampled()
    error, size = bias(sampled, gain)
    if task.method in FREE and _ROUNDING < float_above(size) < 1:
        corrected = _corrected(task, gain, error, cut)
        corrected_error, corrected_size = bias(sampled, corrected)
        if float_above(corrected_size) < float_above(size):
            gain, error, size = corrected, corrected_error, corrected_size
    bound = np.array([[float_above(abs(x)) for x in row] for row in error])
    return _UnbiasedGain(gain, np.where(np.isfinite(bound), bound, _UNBOUNDED), float_above(size))


def _corrected(task: WindowTask, gain: Matrix, error: Exact, cut: float) -> Matrix:
    """The gain less an error (n, n) of G O."""
    rows = _rows(task)[0]
    left_inverse = least_squares_gain(rows, np.ones(len(rows)), cut)
    return np.asarray(gain - middles(error) @ left_inverse)
