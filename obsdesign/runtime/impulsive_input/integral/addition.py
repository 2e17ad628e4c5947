"""An impulse that was decided joins the record: whether it fits, and which rows it settles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Estimate
from obsdesign.runtime.impulsive_input.event import MISFIT, Event, short_dwell
from obsdesign.runtime.impulsive_input.integral.covariance import added_by_noise
from obsdesign.runtime.impulsive_input.integral.evaluate import Decision
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.rows import IntegralLive, Rows
from obsdesign.runtime.impulsive_input.integral.search import Search
from obsdesign.runtime.impulsive_input.residuals import LARGER, Residuals, birge_ratio
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit
from obsdesign.runtime.time_stamps import time_tolerance

Array = NDArray[Any]

_MISFIT = 0.05  # of the residual: what an impulse may leave of it where there is no noise


def widened(event: Event, decision: Decision, residuals: Residuals) -> Event:
    """The event with deviations for the residuals of its window, and of the record so far."""
    own, whole = birge_ratio(decision.cost, decision.freedom), residuals.ratio
    ratio = max(own, whole)
    if ratio == 1 or event.t_std is None or event.weights_std is None:
        return event
    words = [event.status] if event.status != "ok" else []
    words += [LARGER] if whole > 1 else []
    return replace(
        event, t_std=ratio * event.t_std, weights_std=ratio * event.weights_std,
        status="; ".join(words),
    )  # fmt: skip


@dataclass(frozen=True)
class Addition:
    """The free run, its rows, jump.H (n, q), and the shortest time between impulses."""

    run: FreeRun
    rows: Rows
    H: Array
    dwell: float

    def compared(self, decision: Decision, times: Array, error: Array, spread: Array) -> Decision:
        """Under the plain norm: does the output of the impulse match the residual, but for noise?

        Features hardly tell. Two impulses in a window, a steady input, or an error of the state at
        its start leave a difference.
        """
        event = decision.event
        assert event is not None
        shown = self.run.impulse_error(times, event.t, self.H @ event.weights)
        rest = error - shown @ self.run.C.T
        size = float(np.abs(spread).max()) or 1.0
        noise = size**2 * chi_squared_limit(rest.size) if spread.any() else 0.0
        if (rest**2).sum() > noise + (_MISFIT * np.linalg.norm(error)) ** 2:
            event = replace(event, status=MISFIT)
        return replace(decision, event=event)

    def added(
        self, live: IntegralLive, top: int, decision: Decision, spread: Array
    ) -> tuple[IntegralLive, list[Estimate]]:
        """Add the impulse, give out rows up to the end of the window, begin again there."""
        track, event, tau = live.track, decision.event, self.run.tau
        assert track is not None
        assert event is not None
        t_o = float(track.t[top])
        restart = int(np.searchsorted(track.t, t_o + tau - time_tolerance(tau, t_o + tau), "left"))
        restart = min(restart, len(track.t) - 1)
        x = track.x.copy()
        window = np.arange(top, restart + 1)
        jump = self.H @ event.weights
        residuals = live.residuals.joined(decision.cost, decision.freedom)
        event = widened(event, decision, residuals)
        x[window] += self.run.impulse_error(track.t[window], event.t, jump)
        if decision.correction.any():
            x[window] += self.run.coasting(track.t[window], t_o, decision.correction)
        gap = short_dwell(live.last_event, event.t, self.dwell, live.last_std, event.t_std or 0.0)
        if gap:
            words = gap if event.status == "ok" else f"{event.status}; {gap}"
            event = replace(event, status=words)
        doubt = live.doubt
        if event.status != "ok":
            doubt = (t_o, float(track.t[restart]), event.status)
        whole = replace(live, track=replace(track, x=x), doubt=doubt)
        rows = self.rows.given(whole, restart, event=event, jump=jump)
        P, at = decision.covariance, t_o + tau
        if P is not None:
            P = P + added_by_noise(self.run, track.t[top : top + len(spread)], spread, tau)
        largest = max(live.largest, float(live.norms[top : live.search.position].max(initial=0.0)))
        fresh = self.run.restarted(track, restart, x[restart])
        return replace(
            live, track=fresh, norms=np.zeros(0), search=Search(), rule=None, covariance=P,
            since=at, last_event=event.t, last_std=event.t_std or 0.0, doubt=doubt, largest=largest,
            residuals=residuals,
            absent=self.rows.left(live, float(track.t[restart])),
        ), rows  # fmt: skip
