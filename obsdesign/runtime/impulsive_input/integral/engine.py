"""The observer of Mattsson and Medvedev along a record: search, evaluate, add, restart.

Rows wait in a `Track` from the last restart, or from the first row that is still open, on. When a
search fires at t_o, the impulse of that window is added, everything up to t_o + tau is decided,
and a new search begins there: no sample is used twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.curve import ImpulseCurve
from obsdesign.equations.impulsive_input.features import (
    feature_scales,
    filtered_system,
    window_matrix,
)
from obsdesign.runtime.base import Estimate, Vector, status_of
from obsdesign.runtime.impulsive_input.integral.addition import Addition
from obsdesign.runtime.impulsive_input.integral.covariance import covariance_at, first_covariance
from obsdesign.runtime.impulsive_input.integral.evaluate import Evaluator, Window
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.rows import IntegralLive, Rows
from obsdesign.runtime.impulsive_input.integral.search import Position, Rule, smoothed
from obsdesign.runtime.impulsive_input.whitening import (
    feature_deviation,
    noise_deviation,
    whitened,
)
from obsdesign.runtime.time_stamps import time_tolerance

Array = NDArray[Any]

_FLOOR = 8.0  # |R| must exceed this many deviations of noise
_EXACT_FLOOR = 1e-7  # and this part of what the output itself leaves in R: interpolation, rounding
_AFTER_FLOOR = 3e-6  # and this part of what impulses before it made of it: they are added as found
_LEAST = 6.0  # deviations that an impulse must explain before it is evaluated by its position
_SMOOTHING = 0.05  # half width of the moving average, of the window
# part of |R| that a rise or a drop must have; without noise only interpolation disturbs it
_NOISY_SHARE, _EXACT_SHARE = 0.05, 1e-3


class Engine(Protocol):
    """One way to find impulses along a record; rows come in blocks, y NaN where it is missing."""

    def begin(self, t: float, x: Vector, covariance: Array | None) -> Any:
        """Nothing seen yet, the state guessed as x at t."""

    def extended(self, live: Any, t: Array, y: Array, u: Array) -> tuple[Any, list[Estimate]]:
        """After further rows, and the rows that are decided now."""

    def prediction(self, live: Any) -> Vector:
        """The estimate at the last row, as far as it is known."""

    def tail(self, live: Any) -> tuple[Estimate, ...]:
        """Rows that are not decided."""


@dataclass(frozen=True)
class IntegralEngine:
    """Parameters: the free run, the evaluation of a window, noise, how an impulse is added."""

    run: FreeRun
    rows: Rows
    evaluator: Evaluator
    noise: tuple[Vector, Vector]
    addition: Addition
    threshold: float | None
    positional: bool

    @classmethod
    def from_gains(cls, gains: Any) -> IntegralEngine:
        """From a design's gains."""
        A, C, H, K = (gains[name] for name in ("A", "C", "H", "K"))
        D = flow_error_matrix(A, K, C)
        exponents, tau = np.asarray(gains["exponents"]), float(gains["window"])
        B = gains.get("B", np.zeros((len(A), 0)))
        drift = (gains["flow_lower"] + gains["flow_upper"]) / 2
        scales = feature_scales(exponents, tau)
        F = filtered_system(D, C, exponents, scales)
        evaluator = Evaluator(
            A, D, C, H, exponents, tau, float(gains["margin"]),
            window_matrix(D, C, exponents, tau, scales),
            ImpulseCurve.of(F, H, tau), gains["weighting"] == "gls",
            bool(gains.get("state_correction", False)), bool(gains.get("nonnegative", False)),
        )  # fmt: skip
        run = FreeRun(A, K, C, B, drift, exponents, tau, gains.get("period"))
        rows = Rows(run, gains.get("period"))
        return cls(
            run, rows, evaluator, (gains["noise_std"], gains["noise_cv"]),
            Addition(run, rows, H, float(gains["dwell_time"][0])),
            gains.get("threshold"), gains.get("rule") == "position",
        )  # fmt: skip

    # --- rows in ------------------------------------------------------------------------------

    def begin(self, t: float, x: Vector, covariance: Array | None) -> IntegralLive:
        """Nothing seen yet."""
        return IntegralLive(t, x, np.zeros(self.run.B.shape[1]), covariance, t)

    def extended(
        self, live: IntegralLive, t: Array, y: Array, u: Array
    ) -> tuple[IntegralLive, list[Estimate]]:
        """Rows before the first measurement are predicted; then rows wait for their window."""
        with np.errstate(over="ignore", invalid="ignore"):  # rows that are not finite say so
            return self._extended(live, t, y, u)

    def _extended(
        self, live: IntegralLive, t: Array, y: Array, u: Array
    ) -> tuple[IntegralLive, list[Estimate]]:
        decided: list[Estimate] = []
        seen: Any = np.isfinite(y).all(axis=1)
        start = 0
        if live.first is None:
            live = replace(live, first=float(t[0]))
        if live.track is None:
            start = int(np.argmax(seen)) if seen.any() else len(t)
            for k in range(min(start + 1, len(t))):
                x = self.rows.predicted(live.t, live.x, live.u, float(t[k]))
                live = replace(live, t=float(t[k]), x=x, u=u[k])
                if k < start:
                    reason = self.rows.status(live, live.t)
                    status = status_of([] if reason == "ok" else [reason], x)
                    decided.append(Estimate(live.t, x=x, status=status))
            if start == len(t):
                return live, decided
            track = self.run.begin(live.t, y[start], self.rows.forcing(u[start]), live.x)
            P = live.covariance
            if P is not None and live.t > live.since:  # no measurement corrects it until here
                flow = self.run.plant_step(live.since, live.t)[0]
                P = flow @ P @ flow.T
            live = replace(live, track=track, since=live.t, covariance=P)
            start += 1
        live = self.rows.appended(live, t[start:], y[start:], u[start:], seen[start:])
        return self._searched(live, decided)

    def _dropped(self, live: IntegralLive) -> tuple[IntegralLive, list[Estimate]]:
        """Give out rows in front that no impulse can change any more."""
        assert live.track is not None
        front = live.search.front
        half = self._half(live)
        if half > 0 and front > 0:  # the moving average still looks back
            front = int(np.searchsorted(live.track.t, live.track.t[front] - 1.01 * half))
        if front <= 0:
            return live, []
        rows = self.rows.given(live, front)
        return replace(
            live, track=live.track.without(front), norms=live.norms[front:],
            search=live.search.moved(front),
            absent=self.rows.left(live, float(live.track.t[front])),
        ), rows  # fmt: skip

    def prediction(self, live: IntegralLive) -> Vector:
        """The estimate at the last row, as far as it is known."""
        return self.rows.prediction(live)

    def tail(self, live: IntegralLive) -> tuple[Estimate, ...]:
        """Rows that are not decided."""
        return self.rows.tail(live)

    # --- search -------------------------------------------------------------------------------

    def _searched(
        self, live: IntegralLive, decided: list[Estimate]
    ) -> tuple[IntegralLive, list[Estimate]]:
        while True:
            live = self._with_norms(live)
            if live.rule is None:
                break
            assert live.track is not None
            values = live.norms
            half = self._half(live)
            first = live.search.position
            if first >= len(values):
                break
            means = smoothed(live.track.t, values, first, half)
            times, tau = live.track.t, self.run.tau
            search, fired = live.rule.advance(live.search, means.tolist(), first, times, tau)
            live = replace(live, search=search)
            if not fired:
                break
            live, rows = self._fired(live)
            decided += rows
        if live.track is not None:
            live, rows = self._dropped(live)
            decided += rows
        return live, decided

    def _with_norms(self, live: IntegralLive) -> IntegralLive:
        """|R| for every window that is complete; the rule, when the first one is."""
        track = live.track
        assert track is not None
        tau, last = self.run.tau, float(track.t[-1])
        latest = last - tau + time_tolerance(tau, last)
        ready = int(np.searchsorted(track.t, latest, side="right"))
        done = len(live.norms)
        if ready <= done:
            return live
        R = self.run.features(track, done, ready)
        if live.rule is None:
            live = self._prepared(live)
        new = np.linalg.norm(R, axis=1) if live.position is None else live.position.values(R)
        return replace(live, norms=np.concatenate([live.norms, new]))

    def _prepared(self, live: IntegralLive) -> IntegralLive:
        """Rule and covariance for a search that begins, from its first window."""
        track = live.track
        assert track is not None
        taps, spread, stop = self._window(live, 0)
        sigma = feature_deviation(taps, spread) if spread.any() else 0.0
        size = float(np.linalg.norm(taps.T @ track.y[:stop]))
        before = 0.0 if sigma > 0 else _AFTER_FLOOR * live.largest
        floor = max(_FLOOR * sigma, _EXACT_FLOOR * size, before)
        P = live.covariance
        if self.evaluator.gls and P is None:
            P = first_covariance(self.run, self.evaluator.H, track, stop)
        if self.positional:
            unit = spread if sigma > 0 else np.ones_like(spread)
            T = whitened(taps, track.y[:stop], unit)[1]
            curve = self.evaluator.curve
            b = curve.states[1:, curve.n :]
            position = Position.of(T, curve.ages[1:], b, self.evaluator.oldest)
            own = T @ (taps.T @ track.y[:stop]).T.reshape(-1)
            exact = _EXACT_FLOOR * float(np.linalg.norm(own))
            rule = Rule(0.0, 0.0, 0.0, max(_LEAST if sigma > 0 else 0.0, exact, before))
            return replace(live, rule=rule, position=position, covariance=P)
        share = _NOISY_SHARE if sigma > 0 else _EXACT_SHARE
        rule = Rule(floor, sigma, share, self.threshold)
        return replace(live, rule=rule, covariance=P)

    def _window(self, live: IntegralLive, row: int) -> tuple[Array, Array, int]:
        """(taps, spread of the noise at their rows, one past their last row)."""
        track = live.track
        assert track is not None
        end = float(track.t[row]) + self.run.tau
        stop = min(int(np.searchsorted(track.t, end, "left")) + 1, len(track.t))
        # time stamps are decimal: a row that all but ends the window is its last one
        if stop - row > 2 and end - track.t[stop - 2] < 1e-6 * (track.t[stop - 1] - end):
            stop -= 1
        std, cv = self.noise
        y = track.y[row:stop]
        spread = noise_deviation(std, cv, y, np.abs(y).max(axis=0))
        return self.evaluator.taps(track.t[row:stop]), spread, stop

    def _half(self, live: IntegralLive) -> float:
        noisy = live.rule is not None and live.rule.sigma > 0
        return _SMOOTHING * self.run.tau if noisy else 0.0

    # --- an impulse ---------------------------------------------------------------------------

    def _fired(self, live: IntegralLive) -> tuple[IntegralLive, list[Estimate]]:
        track, search = live.track, live.search
        assert track is not None
        top = search.top
        taps, spread, stop = self._window(live, top)
        error = track.y[top:stop] - track.x[top:stop] @ self.run.C.T
        R = self.run.features(track, top, top + 1)[0]
        times = track.t[top:stop]
        P = covariance_at(self.run, live, times, spread)
        onsets = self.run.onset_features(times, taps)
        window = Window(times, taps, error, spread, onsets)
        decision = self.evaluator.decide(R, window, P, search.at_start)
        if decision is None or decision.event is None:
            value = float(live.norms[min(search.position, len(live.norms)) - 1])
            return replace(live, search=search.given_up(value)), []
        if not self.evaluator.gls:
            decision = self.addition.compared(decision, times, error, spread)
        return self.addition.added(live, top, decision, spread)
