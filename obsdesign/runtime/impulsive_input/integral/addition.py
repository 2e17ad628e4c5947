"""Addition of a fitted impulse to the record: its doubts, and the rows that it settles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.deviations import square_root
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.impulsive_input.event import CONFUSED, MISFIT, Event
from obsdesign.runtime.impulsive_input.integral.evaluate import Decision, Window
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.live import IntegralLive
from obsdesign.runtime.impulsive_input.integral.rows import Rows
from obsdesign.runtime.impulsive_input.integral.scan import Scan
from obsdesign.runtime.impulsive_input.integral.window_noise import misfit
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit

_MAX_MISFIT_SHARE = 0.05  # of the residual: what an impulse may leave of it where there is no noise


def compared(run: FreeRun, decision: Decision, window: Window, P: Matrix) -> Event:
    """The event, doubted where the output of the impulse misses the residual; plain norm.

    Features hardly show it. Two impulses in a window, a steady input, or an error of the state
    at its start, beyond its covariance P, leave a difference.
    """
    gains, error, spread = run.gains, window.error, window.spread
    event, fit = decision.event, decision.fit
    shown = run.impulse_error(window.t, fit.t, gains.H @ fit.weights)
    remainder = error - shown @ gains.C.T
    if spread.any():
        state = gains.H @ fit.weights
        weights_std = np.zeros(gains.directions) if event.weights_std is None else event.weights_std
        moves = np.column_stack([gains.A @ state * (event.t_std or 0.0), gains.H * weights_std])
        left, whole = (
            misfit(run, (window.t, each, spread), square_root(P), fit.t, moves)
            for each in (remainder, error)
        )
        noise = chi_squared_limit(remainder.size)
    else:
        left, whole, noise = float((remainder**2).sum()), float((error**2).sum()), 0.0
    if left > noise + _MAX_MISFIT_SHARE**2 * whole:
        return replace(event, doubts=(*event.doubts, MISFIT))
    return event


def with_impulse(
    rows: Rows, live: IntegralLive, decision: Decision, window: Window
) -> tuple[IntegralLive, list[Estimate]]:
    """The state after the impulse was added, and the rows up to the end of its window."""
    run, track, scan = rows.run, live.track, live.scan
    top = scan.search.top
    restart = top + len(window.t) - 1
    residuals = live.history.residuals.joined(decision.cost, decision.freedom)
    history = replace(live.history, residuals=residuals)
    event = decision.event
    if event.t <= live.confused_until:
        event = replace(event, doubts=(*event.doubts, CONFUSED))
    event = history.judged(
        event, run.gains.shortest_dwell, cost=decision.cost, freedom=decision.freedom
    )
    history = history.after(event, float(window.t[0]), float(window.t[-1]))
    x = _corrected(run, track, slice(top, restart + 1), decision)
    live = replace(live, track=replace(track, x=x), history=history)
    decided = rows.decided_rows(live, restart, event=event)
    largest = max(live.largest, float(scan.values[top : scan.search.position].max(initial=0.0)))
    live = replace(live, covariance=decision.covariance, since=float(window.t[-1]), largest=largest)
    return live.with_track(run.restarted(track, restart, x[restart]), Scan()), decided


def _corrected(run: FreeRun, track: Track, window: slice, decision: Decision) -> Matrix:
    """Estimates at all rows, with the impulse and the correction in those of the window."""
    x, times, fit = track.x.copy(), track.t[window], decision.fit
    x[window] += run.impulse_error(times, fit.t, run.gains.H @ fit.weights)
    if decision.correction is not None:
        x[window] += decision.correction
    return x
