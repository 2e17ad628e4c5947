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
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.exponential import expm
from obsdesign.runtime.base import Estimate, Vector
from obsdesign.runtime.impulse_estimate import Event, chi_squared_limit
from obsdesign.runtime.luenberger import responses

Array = NDArray[Any]

_LEAST_RATIO = 12.0  # twice the log-likelihood ratio from which an impulse counts
_STEPS = 40  # onsets per interval
_LATEST = 0.3  # intervals before the end of a window in which no onset is looked for
_REFINEMENTS = 12  # of the grid of onsets, tenfold each
_CROWDED = 0.95  # probability of three neighbours from which a grid is too coarse
_FEWEST = 2  # samples of an incomplete window at the end of a record
_CACHED = 64


@dataclass(frozen=True, slots=True)
class Row:
    """One row: time, measurement (None: missing), known input from then on, deviations (p,)."""

    t: float
    y: Vector | None
    u: Vector
    spread: Vector


@dataclass(frozen=True, slots=True)
class SampledLive:
    """rows: from the window's start on; x, P: the filter there, with its sample used.

    before: (row, x, P) one row earlier, None right after a restart: where a refit may begin.
    """

    t: float
    x: Vector
    P: Array | None
    u: Vector
    rows: tuple[Row, ...] = ()
    before: tuple[Row, Vector, Array] | None = None
    last_event: float = -math.inf
    doubt: tuple[float, float, str] = (math.inf, -math.inf, "")


@dataclass(frozen=True)
class Fit:
    """A posterior over onsets: times, probabilities, weights, what remains; shapes (G,)."""

    onsets: Array
    probability: Array
    weights: Array
    precision: Array
    ratio: Array
    cost: float


@dataclass(frozen=True)
class SamplesEngine:
    """Parameters of the discrete operator; weight_std: prior deviation of weights, inf for none."""

    A: Array
    B: Array
    C: Array
    H: Array
    drift: Vector
    noise: tuple[Vector, Vector]
    window: float
    dwell: float
    nonnegative: bool
    weight_std: float = math.inf
    _responses: OrderedDict[tuple[float, ...], Array] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Any) -> SamplesEngine:
        """From a design's gains."""
        A = gains["A"]
        return cls(
            A, gains.get("B", np.zeros((len(A), 0))), gains["C"], gains["H"],
            (gains["flow_lower"] + gains["flow_upper"]) / 2,
            (gains["noise_std"], gains["noise_cv"]), float(gains["window"]),
            float(gains["dwell_time"][0]), bool(gains.get("nonnegative", False)),
        )  # fmt: skip

    # --- rows in, rows out ----------------------------------------------------------------------

    def begin(self, t: float, x: Vector, covariance: Array | None) -> SampledLive:
        """Nothing seen yet."""
        return SampledLive(t, x, covariance, np.zeros(self.B.shape[1]))

    def extended(
        self, live: SampledLive, t: Array, y: Array, u: Array
    ) -> tuple[SampledLive, list[Estimate]]:
        """After further rows; a window is evaluated once it is complete."""
        decided: list[Estimate] = []
        for k in range(len(t)):
            seen = bool(np.isfinite(y[k]).all())
            std, cv = self.noise
            spread = np.hypot(std, cv * np.abs(y[k])) if seen else std
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
            x, P = self._filtered(x, P, one, other)
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
                x, P = self._filtered(x, P, live.rows[k - 1], row)
            found.append(self._estimate(live, row, x))
        return tuple(row._replace(status=_joined(row.status, "unresolved")) for row in found)

    def _first(self, live: SampledLive, row: Row) -> SampledLive:
        x = self._free(live.t, live.x, live.u, row.t)
        P = live.P
        if P is None:
            size = self._guess(x, row)
            P = np.diag(size**2)
        flow = expm(self.A * (row.t - live.t))
        x, P = self._updated(x, flow @ P @ flow.T, row)
        return replace(live, t=row.t, x=x, P=P, u=row.u, rows=(row,))

    def _guess(self, x: Vector, row: Row) -> Vector:
        """Deviations of a first guess: an impulse as large as the first measurement."""
        count = 64
        span = np.linspace(0.0, self.window, count + 1)
        states = expm(self.A * span[:, None, None]) @ self.H  # (k, n, 1)
        shown = float(np.abs(self.C @ states).max()) or 1.0
        level = float(np.abs(row.y).max()) if row.y is not None else 1.0
        miss = float(np.abs(row.y - self.C @ x).max()) if row.y is not None else 0.0
        sizes = np.abs(states).max(axis=(0, 2)) * max(level / 2, miss) / shown
        return np.asarray(np.maximum(sizes, 1e-6 * (float(sizes.max()) or 1.0)))

    def _complete(self, live: SampledLive) -> bool:
        end = live.rows[0].t + self.window
        return len(live.rows) > 1 and live.rows[-1].t >= end - 1e-9 * self.window

    def _estimate(
        self, live: SampledLive, row: Row, x: Vector, events: tuple[Event, ...] = ()
    ) -> Estimate:
        status = "ok" if row.y is not None else "missing sample"
        if live.doubt[0] <= row.t <= live.doubt[1]:
            status = _joined(status, live.doubt[2])
        return Estimate(row.t, x=x, events=events, status=status)

    # --- filter ---------------------------------------------------------------------------------

    def _free(self, t: float, x: Vector, u: Vector, until: float) -> Vector:
        if until <= t:
            return x
        flow, once, _ = responses(self.A, until - t)
        return np.asarray(flow @ x + once @ (self.B @ u + self.drift))

    def _filtered(self, x: Vector, P: Array, one: Row, other: Row) -> tuple[Vector, Array]:
        flow = expm(self.A * (other.t - one.t))
        return self._updated(self._free(one.t, x, one.u, other.t), flow @ P @ flow.T, other)

    def _updated(self, x: Vector, P: Array, row: Row) -> tuple[Vector, Array]:
        if row.y is None:
            return x, P
        S = self.C @ P @ self.C.T + np.diag(row.spread**2)
        gain = np.linalg.solve(S, self.C @ P).T
        P = P - gain @ self.C @ P
        return x + gain @ (row.y - self.C @ x), (P + P.T) / 2

    # --- windows --------------------------------------------------------------------------------

    def _evaluated(
        self, live: SampledLive, available: int, provisional: bool = False
    ) -> tuple[SampledLive, list[Estimate]]:
        """Fire, or go on by one row."""
        rows = live.rows[:available]
        if not provisional:
            end = rows[0].t + self.window + 1e-9 * self.window
            rows = tuple(row for row in rows if row.t <= end)
        assert live.P is not None
        first, second = rows[0].t, rows[1].t
        last = rows[-1].t - _LATEST * (rows[-1].t - rows[-2].t)
        fit = self._fit(rows, live.x, live.P, first, last, second - first)
        top = int(np.argmax(fit.ratio))
        if fit.ratio[top] > _LEAST_RATIO and fit.onsets[top] < second:
            return self._fired(live, rows, provisional)
        decided = [self._estimate(live, rows[0], live.x)]
        x, P = self._filtered(live.x, live.P, rows[0], rows[1])
        return replace(
            live, rows=live.rows[1:], x=x, P=P, before=(rows[0], live.x, live.P)
        ), decided

    def _fit(
        self, rows: tuple[Row, ...], x: Vector, P: Array, low: float, high: float, interval: float
    ) -> Fit:
        """Likelihood ratios and posterior over onsets in [low, high), from rows after the first.

        The likelihood of (onset, g) with eps_o ~ (0, P) part of the noise; g ~ (0, weight_std).
        """
        step = interval / _STEPS
        return self._posterior(rows, x, P, low + step * np.arange(round((high - low) / step)))

    def _refined(self, rows: tuple[Row, ...], x: Vector, P: Array, fit: Fit) -> Fit:
        """The posterior on finer and finer grids, while a few onsets hold all of it."""
        for _ in range(_REFINEMENTS):
            top = int(np.argmax(fit.probability))
            if fit.probability[max(top - 1, 0) : top + 2].sum() < _CROWDED:
                break
            low, high = fit.onsets[max(top - 2, 0)], fit.onsets[min(top + 2, len(fit.onsets) - 1)]
            fit = self._posterior(rows, x, P, np.linspace(low, high, _STEPS + 1))
        return fit

    def _posterior(self, rows: tuple[Row, ...], x: Vector, P: Array, onsets: Array) -> Fit:
        _, error, S, _ = self._window(rows, x, P)
        half = np.linalg.cholesky(S)
        b = np.linalg.solve(half, self._responses_at(rows, onsets).T)  # (K p, G)
        e = np.linalg.solve(half, error)
        num, den = e @ b, (b * b).sum(axis=0)
        if self.nonnegative:
            num = np.maximum(num, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(den > 0, num**2 / den, 0.0)
            d = den + self.weight_std**-2
            log_p = np.where((den > 0) & ((num > 0) | (not self.nonnegative)),
                             0.5 * num**2 / d - 0.5 * np.log(d), -math.inf)  # fmt: skip
        p = np.exp(log_p - log_p.max()) if np.isfinite(log_p).any() else np.ones_like(log_p)
        weights = np.where(den > 0, num / np.where(d > 0, d, 1.0), 0.0)
        return Fit(onsets, p / p.sum(), weights, d, ratio, float(e @ e - ratio.max()))

    def _window(
        self, rows: tuple[Row, ...], x: Vector, P: Array
    ) -> tuple[float, Array, Array, Array]:
        """(t_o, residuals (K p,), their covariance without impulse, C e^{A (t - t_o)} (K p, n))."""
        t_o, at, t, u = rows[0].t, x, rows[0].t, rows[0].u
        error, noise, seen = [], [], []
        for row in rows[1:]:
            at, t, u = self._free(t, at, u, row.t), row.t, row.u
            if row.y is not None:
                error.append(row.y - self.C @ at)
                noise.append(row.spread**2)
                seen.append(row.t - t_o)
        if not seen:
            n = len(x)
            return t_o, np.zeros(0), np.zeros((0, 0)), np.zeros((0, n))
        flows = expm(self.A * np.array(seen)[:, None, None])
        shown = (self.C @ flows).reshape(-1, len(x))
        S = np.diag(np.concatenate(noise)) + shown @ P @ shown.T
        return t_o, np.concatenate(error), S, shown

    def _responses_at(self, rows: tuple[Row, ...], onsets: Array) -> Array:
        """C e^{A (t_k - t)} H of an impulse at each onset t, (G, K p)."""
        seen = np.array([row.t for row in rows[1:] if row.y is not None])
        ends = np.concatenate([seen, onsets[:2], onsets[-1:]]) - rows[0].t
        key = (*np.round(ends, 12).tolist(), float(len(onsets)))
        if key not in self._responses:
            ages = seen[None, :] - onsets[:, None]
            live = ages >= -1e-12
            flows = expm(self.A * np.maximum(ages, 0.0)[:, :, None, None])
            found = (self.C @ flows @ self.H)[..., 0] * live[:, :, None]
            self._responses[key] = found.reshape(len(onsets), -1)
            if len(self._responses) > _CACHED:
                self._responses.popitem(last=False)
        return self._responses[key]

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
        fit = self._fit(start, x, P, start[0].t, end - interval / _STEPS, interval)
        fit = self._refined(start, x, P, fit)
        event = self._event(live, fit, start, provisional)
        doubt = live.doubt
        if event.status != "ok":
            doubt = (rows[0].t, rows[-1].t, event.status)
        live = replace(live, doubt=doubt)
        means, x, P = self._collapsed(fit, start, x, P)
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
        samples = sum(row.y is not None for row in rows[1:]) * len(self.C)
        if fit.cost > chi_squared_limit(samples - 2):
            status = "does not fit one impulse in the window"
        if t - live.last_event < self.dwell * (1 - 1e-9):
            status = _joined(status, f"dwell time {t - live.last_event:.9g} below {self.dwell:.9g}")
        if provisional:
            status = _joined(status, "provisional: the record ends inside its window")
        return Event(t, np.array([weight]), t_std, np.array([math.sqrt(max(spread, 0.0))]), status)

    def _collapsed(
        self, fit: Fit, rows: tuple[Row, ...], x: Vector, P: Array
    ) -> tuple[list[Vector], Vector, Array]:
        """(means at the rows, mean and covariance at the last), over the posterior of onsets."""
        t_o, error, S, seen = self._window(rows, x, P)
        gain = np.linalg.solve(S, seen @ P).T
        b = self._responses_at(rows, fit.onsets)  # (G, K p)
        p, g = fit.probability, fit.weights
        eps = gain @ (error[:, None] - b.T * g)  # (n, G): error at t_o for each onset
        means, t, u, free = [], t_o, rows[0].u, x
        moved = eps
        for row in rows:
            free, t, u = self._free(t, free, u, row.t), row.t, row.u
            flow = expm(self.A * (row.t - t_o))
            ages = row.t - fit.onsets
            jumps = expm(self.A * np.maximum(ages, 0.0)[:, None, None]) @ self.H
            jumps = jumps[..., 0].T * (ages >= -1e-12)  # (n, G)
            moved = free[:, None] + flow @ eps + jumps * g
            means.append(moved @ p)
        onto = jumps - flow @ gain @ b.T
        rest = flow @ (P - gain @ seen @ P) @ flow.T
        away = moved - means[-1][:, None]
        covariance = rest + (onto * (p / fit.precision)) @ onto.T + (away * p) @ away.T
        covariance = (covariance + covariance.T) / 2
        # rounding must not leave it indefinite
        floor = 1e-9 * float(np.trace(covariance)) / len(x)
        return means, means[-1], covariance + floor * np.eye(len(x))


def _joined(status: str, more: str) -> str:
    return more if status == "ok" else f"{status}; {more}"
