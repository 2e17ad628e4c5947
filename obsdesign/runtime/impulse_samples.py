"""Few samples per time constant: the finite-memory operator of Mattsson and Medvedev on samples.

With samples t_o < t_1 <= ... <= t_N = t_o + tau, a guess of x(t_o) with covariance P, and an onset
t anywhere between samples,

    e_k = y_k - C x_free(t_k) = C e^{A (t_k - t_o)} eps_o + g C e^{A (t_k - t)} H 1[t_k >= t] + v_k

holds exactly: nothing is interpolated. All samples of a window serve as features (any N distinct
exponents would span the same). Between impulses a Kalman filter without process noise runs on the
samples. A window fires when its likelihood ratio is large and largest in its oldest interval; the
impulse is then fitted in a window that begins one sample earlier, as a posterior over a grid of
onsets: at this sampling the likelihood has kinks, and a linearised deviation is far too small.
An extension of (18) of the paper; in the limit of all taps a fixed-lag likelihood-ratio test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm
from obsdesign.runtime.base import Estimate, Vector
from obsdesign.runtime.impulse_estimate import Event, chi_squared_limit, noise_deviation
from obsdesign.runtime.impulse_onset import ONSETS, Fit, OnsetModel, Row

Array = NDArray[Any]

_LEAST_RATIO = 12.0  # twice the log-likelihood ratio from which an impulse counts
_LATEST = 0.3  # intervals before the end of a window in which no onset is looked for
_FEWEST = 2  # samples of an incomplete window at the end of a record


@dataclass(frozen=True, slots=True)
class SampledLive:
    """rows: from the window's start on; x, P: the filter there, with its sample used.

    before: (row, x, P) one row earlier, None right after a restart: where a refit may begin.
    level: largest |y| so far.
    """

    t: float
    x: Vector
    P: Array | None
    u: Vector
    rows: tuple[Row, ...] = ()
    before: tuple[Row, Vector, Array] | None = None
    last_event: float = -math.inf
    doubt: tuple[float, float, str] = (math.inf, -math.inf, "")
    level: Any = 0.0


@dataclass(frozen=True)
class SamplesEngine:
    """Parameters of the discrete operator: the model of a window, noise, window and dwell time."""

    model: OnsetModel
    noise: tuple[Vector, Vector]
    window: float
    dwell: float
    period: float

    @classmethod
    def from_gains(cls, gains: Any) -> SamplesEngine:
        """From a design's gains."""
        A = gains["A"]
        model = OnsetModel(
            A, gains.get("B", np.zeros((len(A), 0))), gains["C"], gains["H"],
            (gains["flow_lower"] + gains["flow_upper"]) / 2,
            bool(gains.get("nonnegative", False)),
        )  # fmt: skip
        noise = gains["noise_std"], gains["noise_cv"]
        return cls(model, noise, float(gains["window"]), float(gains["dwell_time"][0]),
            float(gains["period"]),
        )  # fmt: skip

    # --- rows in, rows out ----------------------------------------------------------------------

    def begin(self, t: float, x: Vector, covariance: Array | None) -> SampledLive:
        """Nothing seen yet."""
        return SampledLive(t, x, covariance, np.zeros(self.model.B.shape[1]))

    def extended(
        self, live: SampledLive, t: Array, y: Array, u: Array
    ) -> tuple[SampledLive, list[Estimate]]:
        """After further rows; a window is evaluated once it is complete."""
        decided: list[Estimate] = []
        for k in range(len(t)):
            seen = bool(np.isfinite(y[k]).all())
            std, cv = self.noise
            level = np.maximum(live.level, np.abs(y[k])) if seen else live.level
            live = replace(live, level=level)
            spread = noise_deviation(std, cv, y[k], level) if seen else std
            row = Row(float(t[k]), y[k] if seen else None, u[k], spread)
            if not live.rows:
                live = self._first(live, row)
                continue
            live = replace(live, rows=(*live.rows, row))
            while self._complete(live):
                live, rows = self._evaluated(live, len(live.rows))
                decided += rows
        return live, decided

    def prediction(self, live: SampledLive) -> Vector:
        """The filter over all rows that are open, without further impulses."""
        if not live.rows:
            return live.x
        x, P = live.x, live.P
        assert P is not None
        for one, other in zip(live.rows, live.rows[1:], strict=False):
            x, P = self.model.filtered(x, P, one, other)
        return x

    def tail(self, live: SampledLive) -> tuple[Estimate, ...]:
        """Rows that are open; impulses that an incomplete window shows are provisional."""
        found: list[Estimate] = []
        while len(live.rows) > _FEWEST:
            live, rows = self._evaluated(live, len(live.rows), provisional=True)
            found += rows
        x, P = live.x, live.P
        for k, row in enumerate(live.rows):
            if k:
                assert P is not None
                x, P = self.model.filtered(x, P, live.rows[k - 1], row)
            found.append(self._estimate(live, row, x))
        return tuple(row._replace(status=_joined(row.status, "unresolved")) for row in found)

    def _first(self, live: SampledLive, row: Row) -> SampledLive:
        x = self.model.free(live.t, live.x, live.u, row.t)
        P = live.P
        if P is None:
            size = self._guess(x, row)
            P = np.diag(size**2)
        flow = expm(self.model.A * (row.t - live.t))
        x, P = self.model.updated(x, flow @ P @ flow.T, row)
        return replace(live, t=row.t, x=x, P=P, u=row.u, rows=(row,))

    def _guess(self, x: Vector, row: Row) -> Vector:
        """Deviations of a first guess: an impulse as large as the first measurement."""
        count = 64
        span = np.linspace(0.0, self.window, count + 1)
        states = expm(self.model.A * span[:, None, None]) @ self.model.H  # (k, n, 1)
        shown = float(np.abs(self.model.C @ states).max()) or 1.0
        level = float(np.abs(row.y).max()) if row.y is not None else 1.0
        miss = float(np.abs(row.y - self.model.C @ x).max()) if row.y is not None else 0.0
        sizes = np.abs(states).max(axis=(0, 2)) * max(level / 2, miss) / shown
        return np.asarray(np.maximum(sizes, 1e-6 * (float(sizes.max()) or 1.0)))

    def _complete(self, live: SampledLive) -> bool:
        return len(live.rows) > 1 and live.rows[-1].t >= self._end(live) - 1e-9 * self.window

    def _end(self, live: SampledLive) -> float:
        """End of the window; after a gap in the rows it reaches as far behind it as it would."""
        return max(live.rows[0].t, live.rows[1].t - self.period) + self.window

    def _estimate(
        self, live: SampledLive, row: Row, x: Vector, events: tuple[Event, ...] = ()
    ) -> Estimate:
        status = "ok" if row.y is not None else "missing sample"
        if live.doubt[0] <= row.t <= live.doubt[1]:
            status = _joined(status, live.doubt[2])
        return Estimate(row.t, x=x, events=events, status=status)

    # --- windows --------------------------------------------------------------------------------

    def _evaluated(
        self, live: SampledLive, available: int, provisional: bool = False
    ) -> tuple[SampledLive, list[Estimate]]:
        """Fire, or go on by one row."""
        rows = live.rows[:available]
        if not provisional:
            end = self._end(live) + 1e-9 * self.window
            rows = tuple(row for row in rows if row.t <= end)
        assert live.P is not None
        first, second = rows[0].t, rows[1].t
        last = rows[-1].t - _LATEST * (rows[-1].t - rows[-2].t)
        fit = self.model.fitted(rows, live.x, live.P, first, last, second - first)
        top = int(np.argmax(fit.ratio))
        if fit.ratio[top] > _LEAST_RATIO and fit.onsets[top] < second:
            return self._fired(live, rows, provisional)
        decided = [self._estimate(live, rows[0], live.x)]
        x, P = self.model.filtered(live.x, live.P, rows[0], rows[1])
        return replace(
            live, rows=live.rows[1:], x=x, P=P, before=(rows[0], live.x, live.P)
        ), decided

    # --- an impulse -------------------------------------------------------------------------------

    def _fired(
        self, live: SampledLive, rows: tuple[Row, ...], provisional: bool
    ) -> tuple[SampledLive, list[Estimate]]:
        x, P, start = live.x, live.P, rows
        assert P is not None
        if live.before is not None:
            row, x, P = live.before
            start = (row, *rows)
        interval = rows[1].t - rows[0].t
        end = rows[2].t if len(rows) > 2 else rows[1].t
        fit = self.model.fitted(start, x, P, start[0].t, end - interval / ONSETS, interval)
        fit = self.model.refined(start, x, P, fit)
        event = self._event(live, fit, start, provisional)
        doubt = live.doubt
        if event.status != "ok":
            doubt = (rows[0].t, rows[-1].t, event.status)
        live = replace(live, doubt=doubt)
        means, x, P = self.model.collapsed(fit, start, x, P)
        decided, given = [], False
        for row, mean in zip(start, means, strict=True):
            if row.t < rows[0].t or row is rows[-1]:
                continue  # given already, or the next window's first row
            last = row is rows[-2]
            events = (event,) if not given and (row.t >= event.t or last) else ()
            given = given or bool(events)
            decided.append(self._estimate(live, row, mean, events))
        rest = live.rows[len(rows) - 1 :]
        following = replace(live, rows=rest, x=x, P=P, before=None, last_event=event.t)
        return following, decided

    def _event(
        self, live: SampledLive, fit: Fit, rows: tuple[Row, ...], provisional: bool
    ) -> Event:
        p, step = fit.probability, float(fit.onsets[1] - fit.onsets[0])
        t = float(p @ fit.onsets)
        weight = float(p @ fit.weights)
        t_std = math.sqrt(float(p @ (fit.onsets - t) ** 2) + step**2 / 12)
        spread = float(p @ (fit.weights**2 + 1 / fit.precision)) - weight**2
        status = "ok"
        samples = sum(row.y is not None for row in rows[1:]) * len(self.model.C)
        if fit.cost > chi_squared_limit(samples - 2):
            status = "does not fit one impulse in the window"
        if t - live.last_event < self.dwell * (1 - 1e-9):
            status = _joined(status, f"dwell time {t - live.last_event:.9g} below {self.dwell:.9g}")
        if provisional:
            status = _joined(status, "provisional: the record ends inside its window")
        return Event(t, np.array([weight]), t_std, np.array([math.sqrt(max(spread, 0.0))]), status)


def _joined(status: str, more: str) -> str:
    return more if status == "ok" else f"{status}; {more}"
