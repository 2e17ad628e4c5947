"""The window of a finite-time observer: how samples and jumps change its state.

A state is never changed: every function returns a new one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import raised
from obsdesign.equations.finite_time.rows import SINGULAR, approx_determinacy, least_squares_gain
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.runtime.finite_time.error_radius import window_length
from obsdesign.runtime.finite_time.known_inputs import KnownInput
from obsdesign.runtime.finite_time.state import Filling, FiniteTimeState, HeldInput, StateBounds
from obsdesign.runtime.jump import corrected_jump, no_jumps

# with bounds w is replaced when it is that much larger than the estimate
_LARGEST_RATIO = 2.0


def held_input(constants: WindowConstants, u: Matrix) -> HeldInput:
    """The known input u (m,) with what follows from it."""
    return HeldInput(u, constants.driven(u), constants.forced_size(u))


_EMPTY = Filling(instants=0, missing=0, full=None, moderate=False)


def initial_state(
    constants: WindowConstants, t: float, guess: Matrix, u: Matrix
) -> FiniteTimeState:
    """State at time t with an empty window, whose estimate is a guess."""
    n = constants.n
    return FiniteTimeState(
        t=t,
        x=guess,
        w=np.zeros(n),
        held=held_input(constants, u),
        window=np.full(constants.k * constants.p, np.nan),
        known=None if constants.inputs is None else KnownInput.zero(n, constants.k),
        filling=_EMPTY,
        bounds=_unbounded(n, guess),
        since_shift=0,
        last_instant=None,
        anchor_time=t,
        periods_since_anchor=0,
        started=False,
    )


def _unbounded(n: int, centre: Matrix) -> StateBounds:
    return StateBounds(centre, np.full(n, np.inf), np.zeros(n), np.zeros(n), np.zeros(n), None)


def flowed(
    constants: WindowConstants,
    state: FiniteTimeState,
    t: float,
    remaining: float,
    slack: float = 0.0,
) -> FiniteTimeState:
    """The state after the flow to time t, without a sample.

    remaining: time to the next instant; slack: of the length, as instants may be off their stamps.
    """
    h, size = t - state.t, max(abs(t), abs(state.t))
    if h <= 0:
        return state
    maps = constants.maps(h, size, slack)
    forced = constants.forced(state.held.u)
    x = maps.flow @ state.x + maps.once @ forced
    w = maps.flow @ state.w + maps.once @ forced
    known = state.known
    if known is not None and constants.inputs is not None:
        known = constants.inputs.advanced(known, forced, h, maps)
    if not constants.has_bounds:
        return state._replace(t=t, x=x, w=w, known=known)
    bounds = state.bounds
    push = state.held.size
    bounds = bounds._replace(
        centre=maps.flow @ bounds.centre + maps.once @ forced,
        radius=maps.spread(bounds.radius) + maps.error(bounds.centre, push),
    )
    if state.last_instant is not None and constants.is_driven:  # w is free until the first sample
        error = maps.error(state.w, push)
        if remaining > 0:
            error = constants.maps(remaining, size + remaining).carried(error)
        bounds = bounds._replace(w_error=raised(bounds.w_error + error, 1))
    return state._replace(t=t, x=x, w=w, known=known, bounds=bounds)


def sampled(
    constants: WindowConstants, state: FiniteTimeState, y: Matrix | None
) -> FiniteTimeState:
    """The state after a sampling instant: estimate from the window, then take in the sample."""
    if state.known is not None and constants.inputs is not None and state.filling.instants:
        state = state._replace(known=constants.inputs.closed(state.known))
    if constants.has_bounds:
        bounds = state.bounds  # what w gathered in the period counts from now on
        most = np.maximum(bounds.w_rounding, bounds.w_error + constants.output_rounding(state.w))
        bounds = bounds._replace(w_rounding=most, w_error=np.zeros(constants.n))
        state = state._replace(bounds=bounds)
    if state.filling.instants == constants.k:
        state = _estimated(constants, state)
    return pushed(constants, state, y)


def pushed(constants: WindowConstants, state: FiniteTimeState, y: Matrix | None) -> FiniteTimeState:
    """The state with a sample, or the lack of one, as the newest entry of its window."""
    p, C = constants.p, constants.gains.C
    # (14) as printed works on the measurements themselves
    base = np.zeros(constants.n) if state.known is not None else state.w
    fresh = np.full(p, np.nan) if y is None else y - C @ base
    filling = state.filling
    is_gap_leaving = filling.instants == constants.k and bool(np.isnan(state.window[0]))
    filling = filling._replace(
        instants=min(filling.instants + 1, constants.k),
        missing=filling.missing + (y is None) - is_gap_leaving,
    )
    return state._replace(
        window=np.concatenate([state.window[p:], fresh]),
        filling=filling,
        known=None if state.known is None else state.known.opened(),
        tape=None,
    )


def emptied(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    """The state with an empty window, its estimate kept."""
    n = constants.n
    return state._replace(
        w=np.zeros(n),
        window=np.full_like(state.window, np.nan),
        known=None if state.known is None else KnownInput.zero(n, constants.k),
        filling=_EMPTY,
        bounds=_unbounded(n, state.bounds.centre)._replace(radius=state.bounds.radius),
        since_shift=0,
        last_instant=None,
        tape=None,
    )


def jumped(
    constants: WindowConstants, state: FiniteTimeState, w: ArrayLike | None
) -> FiniteTimeState:
    """The state after a jump with input w; its window is empty, as older samples do not apply."""
    gains = constants.gains
    if gains.G is None:
        raise no_jumps()
    x = corrected_jump(gains, state.x, w)
    return emptied(constants, state)._replace(x=x, bounds=_unbounded(constants.n, x))


# --- the estimate from a full window ----------------------------------------------------------


def _estimated(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    is_full = not state.filling.missing
    state = state._replace(filling=state.filling._replace(full=is_full))
    if not is_full:
        x = _incomplete_estimate(constants, state)
        state = state._replace(since_shift=state.since_shift + 1)
        return _shifted(constants, state if x is None else state._replace(x=x))
    G = constants.gains.window_gain
    if state.known is not None and constants.inputs is not None:
        x = G @ state.window + constants.inputs.known_part(state.known)
        return state._replace(x=x)
    x = constants.reproduced_state @ state.w + G @ state.window
    if constants.has_bounds:
        w, distance, bounds = np.abs(state.w), np.abs(x - state.w), state.bounds
        length = window_length(state.window)
        radius = constants.error.radius(length, w, np.abs(x), bounds.w_rounding, distance)
        bounds = bounds._replace(centre=x, radius=radius + bounds.shift_rounding)
        state = state._replace(bounds=bounds)
    return _shifted(constants, state._replace(x=x, since_shift=state.since_shift + 1))


def _incomplete_estimate(constants: WindowConstants, state: FiniteTimeState) -> Matrix | None:
    """Least squares on the samples that are there; None if they do not determine the state."""
    if constants.gains.deviations is None:
        return None
    is_there = np.isfinite(state.window)
    rows = constants.rows[is_there]
    if approx_determinacy(rows, constants.scales) < SINGULAR:
        return None
    deviations = np.tile(constants.gains.deviations, constants.k)[is_there]
    gain = least_squares_gain(rows, deviations)
    return np.asarray(state.w + constants.last @ (gain @ state.window[is_there]))


def _shifted(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    """Replace w, once per window, by a response through the estimate, so that it cannot grow.

    With bounds only if it has grown: the shift rounds the residuals (`shift_rounding`).
    """
    if state.since_shift < constants.k or not constants.is_driven or state.known is not None:
        return state
    has_grown = np.abs(state.w).max() > _LARGEST_RATIO * np.abs(state.x).max()
    if constants.has_bounds and not has_grown:
        bounds = state.bounds._replace(shift_rounding=np.zeros(constants.n))
        return state._replace(since_shift=0, bounds=bounds)
    if constants.start_gain is None:
        change, w = state.x - state.w, state.x
    else:  # back in time fast modes would explode: from the window's start instead
        change = constants.start_gain @ np.nan_to_num(state.window)
        w = state.w + constants.last @ change
    bounds = state.bounds
    if constants.has_bounds:
        window, rounding = constants.error.shifted(state.window, change, w)
        rounded = np.maximum(bounds.w_rounding, constants.output_rounding(w))
        bounds = bounds._replace(shift_rounding=rounding, w_rounding=rounded)
    else:
        window = state.window - constants.rows @ change
    return state._replace(w=w, window=window, bounds=bounds, since_shift=0, tape=None)
