"""The observer of Mattsson and Medvedev along a record: search, evaluate, add, restart.

Rows wait in a `Track` from the last restart, or from the first row that is still open, on. When a
search fires at t_o, the impulse of that window is added, everything up to t_o + tau is decided,
and a new search begins there: no sample is used twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.deviations import square_root
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.impulsive_input.initial import Initial
from obsdesign.runtime.impulsive_input.integral.addition import compared, with_impulse
from obsdesign.runtime.impulsive_input.integral.covariance import first_covariance, propagated
from obsdesign.runtime.impulsive_input.integral.evaluate import Decision, Evaluator, Window
from obsdesign.runtime.impulsive_input.integral.first_state import (
    confused_until,
    first_state,
    has_none,
)
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.live import IntegralLive
from obsdesign.runtime.impulsive_input.integral.noise_level import Scores, Whitener
from obsdesign.runtime.impulsive_input.integral.rows import Rows
from obsdesign.runtime.impulsive_input.integral.scan import Scan
from obsdesign.runtime.impulsive_input.integral.search import NoisyRows, Rule, smoothed
from obsdesign.runtime.impulsive_input.significance import LEAST_DEVIATIONS, exact_floor
from obsdesign.runtime.impulsive_input.whitening import noise_deviation, noise_level, usual_size

_SMOOTHING = 0.05  # half width of the moving average, of the window
# part of |R| that a rise or a drop must have; without noise only interpolation disturbs it
_NOISY_SHARE, _EXACT_SHARE = 0.05, 1e-3


@dataclass(frozen=True)
class IntegralEngine:
    """Parameters: the free run, its rows, the evaluation of a window, the noise of windows.

    units (p,): in which outputs are taken in, None for y as it is.
    """

    run: FreeRun
    rows: Rows
    evaluator: Evaluator
    whitener: Whitener
    units: Matrix | None = None

    @classmethod
    def from_gains(cls, gains: IntegralGains) -> IntegralEngine:
        """The engine of a design's gains."""
        run = FreeRun.from_gains(gains.in_output_units())
        evaluator = Evaluator.from_run(run)
        return cls(run, Rows(run), evaluator, Whitener(evaluator), gains.output_units)

    # --- rows in, rows out --------------------------------------------------------------------

    @np.errstate(over="ignore", invalid="ignore")  # the status of a row names what is not finite
    def extended(
        self, live: Initial | IntegralLive, t: Matrix, y: Matrix, u: Matrix
    ) -> tuple[Initial | IntegralLive, list[Estimate]]:
        """Rows before the first measurement are predicted; then rows wait for their window."""
        decided: list[Estimate] = []
        y = y if self.units is None else y / self.units
        measured = np.asarray(np.isfinite(y).all(axis=1))
        start = 0
        if isinstance(live, Initial):
            start = int(np.argmax(measured)) if measured.any() else len(t)
            live, decided = self.rows.unmeasured(live, t[:start], u[:start])
            if start == len(t):
                return live, decided
            live = self.rows.begun(live, float(t[start]), y[start], u[start])
            start += 1
        live = self.rows.appended(live, t[start:], y[start:], u[start:], measured[start:])
        live, rows = self._with_first_state(live)
        decided += rows
        live, fired = self._searched(live)
        while fired:
            live, rows = self._evaluated(live)
            decided += rows
            live, fired = self._searched(live)
        live, rows = self._dropped(live)
        return live, decided + rows

    def prediction(self, live: Initial | IntegralLive) -> Matrix:
        """The estimate at the last row, as far as it is known."""
        if isinstance(live, Initial):
            return live.x
        return list(self.rows.predictions(live))[-1][1]

    def tail(self, live: Initial | IntegralLive) -> tuple[Estimate, ...]:
        """Rows that are not decided."""
        return () if isinstance(live, Initial) else self.rows.tail(live)

    def _dropped(self, live: IntegralLive) -> tuple[IntegralLive, list[Estimate]]:
        """Give out rows in front that no impulse can change any more."""
        track, front, half = live.track, live.scan.search.front, self._half(live)
        if half > 0 and front > 0:  # the moving average still looks back
            front = int(np.searchsorted(track.t, track.t[front] - 1.01 * half))
        if front <= 0:
            return live, []
        rows = self.rows.decided_rows(live, front)
        return live.with_track(track.from_row(front), live.scan.from_row(front)), rows

    # --- search -------------------------------------------------------------------------------

    def _searched(self, live: IntegralLive) -> tuple[IntegralLive, bool]:
        """The state after the search went on as far as windows are complete, and if it fired."""
        live = self._with_values(live)
        scan, times = live.scan, live.track.t
        first = scan.search.position
        if scan.rule is None or first >= len(scan.values):
            return live, False
        means = smoothed(times, scan.values, first, self._half(live))
        rows = NoisyRows(times, scan.sigmas, scan.matched)
        search, fired = scan.rule.advance(scan.search, means.tolist(), first, rows, self.run.tau)
        return replace(live, scan=replace(scan, search=search)), fired

    def _with_values(self, live: IntegralLive) -> IntegralLive:
        """A value for every window that is complete; the rule, when the first one is."""
        ready, done = self._ready(live.track), len(live.scan.values)
        if ready <= done:
            return live
        if live.scan.rule is None:
            live = self._prepared(live)
        R, scan = self.run.features(live.track, done, ready), live.scan
        if self.run.gains.noisy:
            return replace(live, scan=self._in_noise(live, R))
        values = np.linalg.norm(R, axis=1) if scan.position is None else scan.position.values(R)
        return replace(live, scan=scan.extended(Scores(values, *np.zeros((2, len(R))))))

    def _ready(self, track: Track) -> int:
        """How many rows begin a window that is complete."""
        tau, last = self.run.tau, float(track.t[-1])
        latest = last - tau + time_tolerance(tau, last)
        return int(np.searchsorted(track.t, latest, side="right"))

    def _with_first_state(self, live: IntegralLive) -> tuple[IntegralLive, list[Estimate]]:
        """The state fitted to the first rows, in noise, where the first window has no impulse."""
        is_first = live.scan.rule is None and live.history.t == -math.inf
        if not (is_first and self.run.gains.noisy and self._ready(live.track)):
            return live, []
        live, track = self._prepared(live), live.track
        window, P = self._window_and_covariance(live, 0)
        row = len(window.t) // 2
        if not (window.spread.all() and row and has_none(self.evaluator, window, P)):
            return live, []
        fitted = first_state(self.run, track, row, window.spread[:row], square_root(P))
        x = np.concatenate([fitted.x, track.x[row + 1 :]])
        live = replace(live, track=replace(track, x=x))
        decided = self.rows.decided_rows(live, row)
        live = replace(live, covariance=fitted.covariance, since=float(track.t[row]))
        return live.with_track(self.run.restarted(track, row, x[row]), live.scan), decided

    def _in_noise(self, live: IntegralLive, R: Matrix) -> Scan:
        """The scan with values for the windows of features R, in the noise of each."""
        scan, track, first = live.scan, live.track, len(live.scan.values)
        admitted = live.history.earliest + self.run.gains.shortest_dwell
        oldest = track.t[first : first + len(R)] + self.run.tau - admitted
        variances = self.whitener.variances(track, first, first + len(R))
        known, noise, k = np.asarray((variances > 0).all(axis=1)), scan.noise, 0
        scores = np.zeros((3, len(R)))  # at rest there is nothing to judge by
        while k < len(R):
            if not known[k]:
                k += int(np.argmax(np.append(known[k:], True)))
                continue
            if noise is None or not noise.reaches(variances[k : k + 1])[0]:
                noise = self.whitener.level(self._window(track, first + k), variances[k])
            alike = known[k:] & noise.reaches(variances[k:])
            stretch = slice(k, k + int(np.argmin(np.append(alike, False))))
            scores[:, stretch] = noise.scored(R[stretch], variances[stretch], oldest[stretch])
            k = stretch.stop
        scores[2] /= live.history.residuals.ratio  # deviations are as large as residuals say
        return replace(scan.extended(Scores(*scores)), noise=noise)

    def _prepared(self, live: IntegralLive) -> IntegralLive:
        """Rule and covariance for a search that begins, from its first window."""
        window, gains = self._window(live.track, 0), self.run.gains
        if live.history.t == -math.inf:
            live = self._begun(live, window)
        is_position, position, threshold = gains.rule == "position", None, gains.threshold
        if gains.noisy:
            rule = Rule(0.0, _NOISY_SHARE, LEAST_DEVIATIONS if is_position else threshold)
            return replace(live, scan=replace(live.scan, rule=rule))
        size = float(np.linalg.norm(window.taps.T @ window.y))
        if is_position:
            position, size = self.whitener.exact_position(window)
        floor = exact_floor(size, live.largest)
        rule = Rule(floor, _EXACT_SHARE, floor if is_position else threshold)
        return replace(live, scan=replace(live.scan, rule=rule, position=position))

    def _begun(self, live: IntegralLive, window: Window) -> IntegralLive:
        """The state at the first window: covariance of the error, and what it hides."""
        x, P = live.track.x[0], live.covariance
        P = first_covariance(self.run, window.y, x) if P is None else P
        if window.spread.all():
            live = replace(live, confused_until=confused_until(self.evaluator, window, P))
        return replace(live, covariance=P)

    def _window(self, track: Track, row: int) -> Window:
        """The window that begins at a row."""
        end = float(track.t[row]) + self.run.tau
        stop = min(int(np.searchsorted(track.t, end, "left")) + 1, len(track.t))
        # time stamps are decimal: a row that all but ends the window is its last one
        if stop - row > 2 and end - track.t[stop - 2] < 1e-6 * (track.t[stop - 1] - end):
            stop -= 1
        times, y = track.t[row:stop], track.y[row:stop]
        return Window(
            t=times,
            y=y,
            error=self.run.residual(track, row, stop),
            taps=self.evaluator.taps(times),
            spread=noise_deviation(
                self.run.gains, y, noise_level(np.abs(y).max(axis=0)), usual_size(y)
            ),
        )

    def _half(self, live: IntegralLive) -> float:
        """Half width of the moving average of |R|; zero without noise."""
        gains = self.run.gains
        is_smooth = live.scan.rule is None or not gains.noisy or gains.rule == "position"
        return 0.0 if is_smooth else _SMOOTHING * self.run.tau

    # --- an impulse ---------------------------------------------------------------------------

    def _evaluated(self, live: IntegralLive) -> tuple[IntegralLive, list[Estimate]]:
        """The state after the window that fired, with its impulse or without one."""
        live, window, P = self._old_enough(live)
        search, values = live.scan.search, live.scan.values
        decision = self._decision(live, window, P)
        if decision is not None:
            return with_impulse(self.rows, live, decision, window)
        value = float(values[min(search.position, len(values)) - 1])
        search = search.given_up(value, float(window.t[0]) + _SMOOTHING * self.run.tau)
        return replace(live, scan=replace(live.scan, search=search)), []

    def _old_enough(self, live: IntegralLive) -> tuple[IntegralLive, Window, Matrix]:
        """The state with the row of the window to evaluate, the window, P at its first row.

        At a maximum of |R| that noise made too early an impulse may be younger than the margin:
        then it is evaluated a margin later, or where the search stands.
        """
        search, gains, times = live.scan.search, self.run.gains, live.track.t
        window, P = self._window_and_covariance(live, search.top)
        later = int(np.searchsorted(times, times[search.top] + gains.margin))
        later = min(later, search.position - 1)
        is_peak = gains.rule == "peak" and later > search.top and window.spread.any()
        if not (is_peak and self.evaluator.may_be_younger(window, P)):
            return live, window, P
        live = replace(live, scan=replace(live.scan, search=replace(search, top=later)))
        return live, *self._window_and_covariance(live, later)

    def _window_and_covariance(self, live: IntegralLive, row: int) -> tuple[Window, Matrix]:
        """The window that begins at a row, and the covariance of the error there."""
        window, P = self._window(live.track, row), live.covariance
        P = np.zeros((self.run.gains.n, self.run.gains.n)) if P is None else P
        elapsed = max(float(window.t[0]) - live.since, 0.0)
        return window, propagated(self.run, P, elapsed, window.t, window.spread)

    def _decision(self, live: IntegralLive, window: Window, P: Matrix) -> Decision | None:
        """The impulse of a window, None where nothing counts; P: covariance at its first row."""
        search = live.scan.search
        if self.evaluator.gls:
            return self.evaluator.weighted(window, P, search.at_start)
        R = self.run.features(live.track, search.top, search.top + 1)[0]
        decision = self.evaluator.plain(R, window, P, search.at_start)
        if decision is None:
            return None
        return replace(decision, event=compared(self.run, decision, window, P))
