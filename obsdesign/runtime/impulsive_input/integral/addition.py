"""Addition of a fitted impulse to the record: its doubts, and the rows that it settles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.impulsive_input.event import MISFIT, Event
from obsdesign.runtime.impulsive_input.integral.covariance import added_by_noise
from obsdesign.runtime.impulsive_input.integral.evaluate import Decision, Window
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.live import IntegralLive
from obsdesign.runtime.impulsive_input.integral.rows import Rows
from obsdesign.runtime.impulsive_input.integral.search import Scan
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit
from obsdesign.runtime.time_stamps import time_tolerance

_MAX_MISFIT_SHARE = 0.05  # of the residual: what an impulse may leave of it where there is no noise


def compared(run: FreeRun, decision: Decision, window: Window) -> Event:
    """The event, doubted where the output of the impulse misses the residual; plain norm.

    Features hardly show it. Two impulses in a window, a steady input, or an error of the state
    at its start leave a difference.
    """
    gains, error, spread = run.gains, window.error, window.spread
    event, fit = decision.event, decision.fit
    shown = run.impulse_error(window.t, fit.t, gains.H @ fit.weights)
    remainder = error - shown @ gains.C.T
    size = float(np.abs(spread).max()) or 1.0
    noise = size**2 * chi_squared_limit(remainder.size) if spread.any() else 0.0
    if (remainder**2).sum() > noise + (_MAX_MISFIT_SHARE * np.linalg.norm(error)) ** 2:
        return replace(event, doubts=(MISFIT,))
    return event


def with_impulse(
    rows: Rows, live: IntegralLive, decision: Decision, window: Window
) -> tuple[IntegralLive, list[Estimate]]:
    """The state after the impulse was added, and the rows up to the end of its window."""
    run, track, scan = rows.run, live.track, live.scan
    tau, top = run.tau, scan.search.top
    t_o = float(track.t[top])
    restart = int(np.searchsorted(track.t, t_o + tau - time_tolerance(tau, t_o + tau), "left"))
    restart = min(restart, len(track.t) - 1)
    residuals = live.history.residuals.joined(decision.cost, decision.freedom)
    history = replace(live.history, residuals=residuals)
    event = history.judged(
        decision.event, run.gains.shortest_dwell, cost=decision.cost, freedom=decision.freedom
    )
    history = history.after(event, t_o, float(track.t[restart]))
    x = _corrected(run, track, slice(top, restart + 1), decision)
    live = replace(live, track=replace(track, x=x), history=history)
    decided = rows.decided_rows(live, restart, event=event)
    P = decision.covariance
    if P is not None:
        P = P + added_by_noise(run, tau, window.t, window.spread)
    largest = max(live.largest, float(scan.values[top : scan.search.position].max(initial=0.0)))
    live = replace(live, covariance=P, since=t_o + tau, largest=largest)
    return live.with_track(run.restarted(track, restart, x[restart]), Scan()), decided


def _corrected(run: FreeRun, track: Track, window: slice, decision: Decision) -> Matrix:
    """Estimates at all rows, with the impulse and the correction at t_o in those of the window."""
    x, times, fit = track.x.copy(), track.t[window], decision.fit
    x[window] += run.impulse_error(times, fit.t, run.gains.H @ fit.weights)
    if decision.correction.any():
        x[window] += run.coasting(times, float(times[0]), decision.correction)
    return x
