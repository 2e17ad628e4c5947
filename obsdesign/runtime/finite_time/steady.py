"""Usual step of a finite-time observer: from one instant to the next, with a full window.

The same estimate as `window.sampled`, by one product with the gains and a few of size n.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import MODERATE, Estimate, Sample, centred, vector
from obsdesign.runtime.finite_time.clock import is_next_instant
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.runtime.finite_time.error_radius import window_length
from obsdesign.runtime.finite_time.known_inputs import KnownInput
from obsdesign.runtime.finite_time.state import CachedRadius, FiniteTimeState, HeldInput
from obsdesign.runtime.finite_time.tape import extend
from obsdesign.runtime.finite_time.window import held_input

# estimate, w, residual, known inputs, radius
_Response = tuple[Matrix, Matrix, Matrix, KnownInput | None, CachedRadius | None]


def steady_step(
    constants: WindowConstants, state: FiniteTimeState, t: float, sample: Sample
) -> tuple[FiniteTimeState, Estimate] | None:
    """State and estimate after the sample; None for any step but the usual one.

    The window of the state is full, the sample has no jump.
    """
    filling, periods = state.filling, state.periods_since_anchor + 1
    if filling.missing or not filling.moderate or periods > constants.most_periods_counted:
        return None
    if not is_next_instant(state, t, constants.period, periods):
        return None
    y = sample.y
    if y is None:
        return None
    if not isinstance(y, np.ndarray) or y.shape != (constants.p,):
        y = vector(y, constants.p, "y")
    y = centred(y, constants.gains)
    held = state.held if sample.u is None else _held(constants, state.held, sample.u)
    if held is None or not _is_moderate(y):
        return None
    response = _response(constants, state, y)
    if response is None:
        return None
    x, w, residual, known, cached = response
    window, tape, tape_end = extend(state.tape, state.tape_end, state.window, residual)
    bounds, low, high = state.bounds, None, None
    if cached is not None:
        radius, rounding = cached.radius, cached.w_rounding
        bounds = bounds._replace(centre=x, radius=radius, w_rounding=rounding, cached_radius=cached)
        low, high = outward_ends(x, radius)
    # in the order of the fields: names would cost a tenth of the step
    following = FiniteTimeState(
        t, x, w, held, window, known, filling, bounds, state.since_shift + 1, t,
        state.anchor_time, periods, True, tape, tape_end,
    )  # fmt: skip
    return following, Estimate(t, x, low, high)


def _held(constants: WindowConstants, held: HeldInput, u: ArrayLike) -> HeldInput | None:
    """The input from now on; None if products with it may overflow."""
    u = vector(u, len(held.u), "u")
    if not _is_moderate(u):
        return None
    return held if (u == held.u).all() else held_input(constants, u)


def outward_ends(centre: Matrix, radius: Matrix) -> tuple[Matrix, Matrix]:
    """Lower and upper bound, rounded outwards."""
    low, high = centre - radius, centre + radius
    return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)


def _is_moderate(values: Matrix) -> bool:
    """Can no product with these numbers overflow?"""
    return (abs(values.item()) if len(values) == 1 else math.hypot(*values.tolist())) < MODERATE


def _response(constants: WindowConstants, state: FiniteTimeState, y: Matrix) -> _Response | None:
    """Estimate and residual with the known response and the radius; None for an unusual step."""
    # dot, as its overhead is half that of @
    x = constants.gain.dot(state.window)
    if constants.is_plain:
        return x, state.w, y, state.known, None
    if not constants.is_driven:
        return _bounded(constants, state, (x, state.w, y, state.known, None))
    if constants.inputs is not None and state.known is not None:
        if state.known.age:
            return None  # an input changed before the last sample
        known = constants.inputs.advanced_by_period(state.known, state.held.drive)
        x = x + constants.inputs.weights.dot(known.closed)
        return (x, state.w, y, known, None) if _is_moderate(x) else None
    if state.since_shift + 1 >= constants.k:
        return None  # w is due to be shifted onto the estimate
    # one product for w and C w
    w_and_output = constants.flow_and_output.dot(state.w) + state.held.drive
    if not _is_moderate(w_and_output):
        return None
    w, residual = w_and_output[: -constants.p], y - w_and_output[-constants.p :]
    x = x + (w if constants.gains.is_unbiased else constants.reproduced_state.dot(w))
    return _bounded(constants, state, (x, w, residual, state.known, None))


def _bounded(
    constants: WindowConstants, state: FiniteTimeState, response: _Response
) -> _Response | None:
    """The response with its radius, where it has one; None where it may overflow."""
    x, w, residual, known, _ = response
    if not constants.has_bounds:
        return response if _is_moderate(x) else None
    cached = state.bounds.cached_radius
    if cached is None or not _is_valid(cached, constants, state, x, w):
        cached = _new_radius(constants, state, x, w)
        if not math.hypot(*cached.x.tolist(), *cached.radius.tolist()) < MODERATE:
            return None
    return x, w, residual, known, cached


def _is_valid(
    cached: CachedRadius, constants: WindowConstants, state: FiniteTimeState, x: Matrix, w: Matrix
) -> bool:
    """Does the cached radius cover x, with the rounding of w up to now?"""
    return bool(
        float(state.window.dot(state.window)) <= cached.square
        and state.bounds.shift_rounding is cached.shift_rounding
        and (np.abs(x) <= cached.x).all()
        and (not constants.is_driven or (np.abs(w) <= cached.w).all())
        and (not len(state.held.u) or (state.held.size <= cached.forced).all())
    )


def _new_radius(
    constants: WindowConstants, state: FiniteTimeState, x: Matrix, w: Matrix
) -> CachedRadius:
    """The radius for twice the sizes it depends on: all it adds to `proved` is rounding."""
    most_x, most_w = 2 * np.abs(x), 2 * np.maximum(np.abs(w), np.abs(state.w))
    most_forced = 2 * state.held.size
    w_rounding, distance = state.bounds.w_rounding, most_x
    if constants.is_driven:
        rounding = constants.period_maps.error(most_w, most_forced)
        rounding = rounding + constants.output_rounding(most_w)
        w_rounding, distance = np.maximum(w_rounding, rounding), most_x + most_w
    length = 2 * window_length(state.window)
    radius = constants.error.radius(length, most_w, most_x, w_rounding, distance)
    return CachedRadius(
        w=most_w,
        x=most_x,
        forced=most_forced,
        square=4 * float(state.window.dot(state.window)),
        shift_rounding=state.bounds.shift_rounding,
        w_rounding=w_rounding,
        radius=radius + state.bounds.shift_rounding,
    )
