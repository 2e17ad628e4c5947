"""The window of a finite-time observer: its state, and how samples and jumps change it.

A state is never changed: every function returns a new one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.finite_time.rows import approx_determinacy, least_squares_gain
from obsdesign.runtime.base import Vector, vector
from obsdesign.runtime.finite_time.constants import WindowConstants
from obsdesign.runtime.finite_time.error_radius import window_length
from obsdesign.runtime.finite_time.known_inputs import KnownInput
from obsdesign.runtime.finite_time.tape import Tape

# rounding of y - C w, as a part of w
OUTPUT_ROUNDING = 2.0**-48
# the scaled rows of an incomplete window must be that far from losing rank
_DETERMINED = 1e-11
# with bounds w is replaced when it is that much larger than the estimate
_LARGEST_RATIO = 2.0


class CachedRadius(NamedTuple):
    """A radius that holds as long as everything it depends on stays below the entries here.

    w, x, forced: absolute values; square: squared length of the window; shift_rounding: the array
    itself; w_rounding: the one that enters the radius.
    """

    w: Vector
    x: Vector
    forced: Vector
    square: float
    shift_rounding: Vector
    w_rounding: Vector
    radius: Vector


class FiniteTimeState(NamedTuple):  # a frozen dataclass of this size costs more than the step
    """Everything the next step needs, just after time t.

    x: estimate; w: known response; drive: contribution of the input u to (w, C w) in a period;
    window: (k p,) residuals y - C w, oldest first, NaN where a sample is missing; known: known
    inputs of (14) as printed; filled: instants in the window, missing: those without a sample;
    since_shift: instants since w was shifted onto the estimate; last_instant: its time; full: was x
    taken from a full window, False with gaps, None not yet; |state - centre| <= radius;
    w_rounding: rounding of w per step; shift_rounding: that of the residuals when w was shifted;
    anchor_time, periods_since_anchor: an instant, and how many periods ago it was; tape, tape_end:
    where the window may grow; cached_radius: the last one; moderate: x, w and the residuals are
    below `MODERATE`.
    """

    t: float
    x: Vector
    w: Vector
    u: Vector
    drive: Vector
    window: Vector
    known: KnownInput | None
    filled: int
    missing: int
    since_shift: int
    last_instant: float | None
    full: bool | None
    centre: Vector
    radius: Vector
    w_rounding: Vector
    shift_rounding: Vector
    anchor_time: float
    periods_since_anchor: int
    started: bool
    tape: Tape | None = None
    tape_end: int = 0
    cached_radius: CachedRadius | None = None
    moderate: bool = False


def initial_state(
    constants: WindowConstants, t: float, guess: Vector, u: Vector
) -> FiniteTimeState:
    """State at time t with an empty window, whose estimate is a guess."""
    n = constants.n
    zero = np.zeros(n)
    return FiniteTimeState(
        t=t,
        x=guess,
        w=zero,
        u=u,
        drive=constants.driven(u),
        window=np.full(constants.k * constants.p, np.nan),
        known=None if constants.inputs is None else KnownInput.zero(n, constants.k),
        filled=0,
        missing=0,
        since_shift=0,
        last_instant=None,
        full=None,
        centre=guess,
        radius=np.full(n, np.inf),
        w_rounding=zero,
        shift_rounding=zero,
        anchor_time=t,
        periods_since_anchor=0,
        started=False,
    )


def flowed(constants: WindowConstants, state: FiniteTimeState, t: float) -> FiniteTimeState:
    """The state after the flow to time t, without a sample."""
    h = t - state.t
    if h <= 0:
        return state._replace(t=t)
    maps = constants.maps(h, max(abs(t), abs(state.t)))
    forced = constants.forced(state.u)
    x = maps.flow @ state.x + maps.once @ forced
    w = maps.flow @ state.w + maps.once @ forced
    known = state.known
    if known is not None and constants.inputs is not None:
        known = constants.inputs.advanced(known, forced, h, maps)
    if not constants.has_bounds:
        return state._replace(t=t, x=x, w=w, known=known)
    rounding = maps.error(state.w, forced) + OUTPUT_ROUNDING * np.abs(w)
    return state._replace(
        t=t,
        x=x,
        w=w,
        known=known,
        centre=maps.flow @ state.centre + maps.once @ forced,
        radius=maps.spread(state.radius) + maps.error(state.centre, forced),
        w_rounding=np.maximum(state.w_rounding, rounding),
    )


def sampled(
    constants: WindowConstants, state: FiniteTimeState, y: Vector | None
) -> FiniteTimeState:
    """The state after a sampling instant: estimate from the window, then take in the sample."""
    if state.known is not None and constants.inputs is not None and state.filled:
        state = state._replace(known=constants.inputs.closed(state.known))
    if state.filled == constants.k:
        state = _estimated(constants, state)
    return pushed(constants, state, y)


def pushed(constants: WindowConstants, state: FiniteTimeState, y: Vector | None) -> FiniteTimeState:
    """The state with a sample, or the lack of one, as the newest entry of its window."""
    p, C = constants.p, constants.gains.C
    # (14) as printed works on the measurements themselves
    base = np.zeros(constants.n) if state.known is not None else state.w
    fresh = np.full(p, np.nan) if y is None else y - C @ base
    is_gap_leaving = state.filled == constants.k and bool(np.isnan(state.window[0]))
    return state._replace(
        window=np.concatenate([state.window[p:], fresh]),
        filled=min(state.filled + 1, constants.k),
        missing=state.missing + (y is None) - is_gap_leaving,
        known=None if state.known is None else state.known.opened(),
        tape=None,
    )


def emptied(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    """The state with an empty window, its estimate kept."""
    n = constants.n
    return state._replace(
        window=np.full_like(state.window, np.nan),
        filled=0,
        missing=0,
        since_shift=0,
        last_instant=None,
        full=None,
        w=np.zeros(n),
        known=None if state.known is None else KnownInput.zero(n, constants.k),
        w_rounding=np.zeros(n),
        shift_rounding=np.zeros(n),
        tape=None,
    )


def jumped(
    constants: WindowConstants, state: FiniteTimeState, w: ArrayLike | None
) -> FiniteTimeState:
    """The state after a jump with input w; its window is empty, as older samples do not apply."""
    gains = constants.gains
    if gains.G is None:
        raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
    forced = gains.jump_drift
    if gains.E is not None:
        inputs = gains.E.shape[1]
        forced = forced + gains.E @ (np.zeros(inputs) if w is None else vector(w, inputs, "w"))
    x = gains.G @ state.x + forced
    radius = np.full(constants.n, np.inf)
    return emptied(constants, state)._replace(x=x, centre=x, radius=radius)


# --- the estimate from a full window ----------------------------------------------------------


def _estimated(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    if state.missing:
        x = _incomplete_estimate(constants, state)
        state = state._replace(full=False, since_shift=state.since_shift + 1)
        return _shifted(constants, state if x is None else state._replace(x=x))
    G = constants.gains.window_gain
    if state.known is not None and constants.inputs is not None:
        x = G @ state.window + constants.inputs.known_part(state.known)
        return state._replace(x=x, full=True)
    x = constants.reproduced_state @ state.w + G @ state.window
    if constants.has_bounds:
        w, distance = np.abs(state.w), np.abs(x - state.w)
        length = window_length(state.window)
        radius = constants.error.radius(length, w, np.abs(x), state.w_rounding, distance)
        state = state._replace(centre=x, radius=radius + state.shift_rounding)
    state = state._replace(x=x, full=True, since_shift=state.since_shift + 1)
    return _shifted(constants, state)


def _incomplete_estimate(constants: WindowConstants, state: FiniteTimeState) -> Vector | None:
    """Least squares on the samples that are there; None if they do not determine the state."""
    if constants.gains.deviations is None:
        return None
    is_there = np.isfinite(state.window)
    rows = constants.rows[is_there]
    if approx_determinacy(rows, constants.scales) < _DETERMINED:
        return None
    deviations = np.tile(constants.gains.deviations, constants.k)[is_there]
    gain = least_squares_gain(rows, deviations)
    return np.asarray(state.w + constants.last @ (gain @ state.window[is_there]))


def _shifted(constants: WindowConstants, state: FiniteTimeState) -> FiniteTimeState:
    """Once per window, replace w by a response through the estimate: w may grow where x does not.

    With bounds only if it has grown: the shift rounds the residuals (`shift_rounding`).
    """
    if state.since_shift < constants.k or not constants.is_driven or state.known is not None:
        return state
    has_grown = np.abs(state.w).max() > _LARGEST_RATIO * np.abs(state.x).max()
    if constants.has_bounds and not has_grown:
        return state._replace(since_shift=0, shift_rounding=np.zeros(constants.n))
    if constants.start_gain is None:
        change, w = state.x - state.w, state.x
    else:  # back in time fast modes would explode: from the window's start instead
        change = constants.start_gain @ np.nan_to_num(state.window)
        w = state.w + constants.last @ change
    if constants.has_bounds:
        window, rounding = constants.error.shifted(state.window, change, w)
    else:
        window, rounding = state.window - constants.rows @ change, state.shift_rounding
    return state._replace(w=w, window=window, shift_rounding=rounding, since_shift=0, tape=None)
