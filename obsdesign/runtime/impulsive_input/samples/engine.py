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
from bisect import bisect_left
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.runtime.base import Estimate, Vector, status_of
from obsdesign.runtime.impulsive_input.event import MISFIT, Event, short_dwell
from obsdesign.runtime.impulsive_input.residuals import LARGER, Residuals, birge_ratio
from obsdesign.runtime.impulsive_input.samples.filter import (
    Filtered,
    Row,
    SampledPlant,
    square_root,
)
from obsdesign.runtime.impulsive_input.samples.onset import ONSETS, Cells, Fit, OnsetModel
from obsdesign.runtime.impulsive_input.samples.steady_input import STEADY, Steady
from obsdesign.runtime.impulsive_input.whitening import noise_deviation
from obsdesign.runtime.time_stamps import time_tolerance

Array = NDArray[Any]

# twice the log-likelihood ratio from which an impulse counts, in a window of four samples; each
# doubling of the onsets that noise may choose from adds 2 ln 2
_LEAST_RATIO, _FEW = 12.0, 4
_LATEST = 0.3  # intervals before the end of a window in which no onset is looked for
# what a steady input must leave more than impulses do: what they must be worth against nothing
_AHEAD = _LEAST_RATIO
_MOST_ONSETS = 4000  # of a window
_FEWEST = 2  # samples of an incomplete window at the end of a record


@dataclass(frozen=True, slots=True)
class SampledLive:
    """t, x, P, u: before the first row. rows: the filter from the window's start on.

    cells: what the rows after that start say of onsets. before: the filter at rows of one period
    before it, empty right after a restart: where a refit may begin. steady: what explains the
    samples without impulses. level: largest |y| so far. residuals: of final rows and windows.
    """

    t: float
    x: Vector
    P: Array | None
    u: Vector
    cells: Cells
    rows: tuple[Filtered, ...] = ()
    before: tuple[Filtered, ...] = ()
    steady: tuple[Steady, ...] = ()
    last_event: float = -math.inf
    last_std: float = 0.0
    doubt: tuple[float, float, str] = (math.inf, -math.inf, "")
    level: Array = field(default_factory=lambda: np.zeros(()))
    residuals: Residuals = field(default_factory=Residuals)


@dataclass(frozen=True)
class SamplesEngine:
    """Parameters of the discrete operator: the model of a window, noise, window and dwell time."""

    model: OnsetModel
    noise: tuple[Vector, Vector]
    window: float
    dwell: float
    period: float

    @property
    def least_ratio(self) -> float:
        """What an impulse must explain to count: more where there are more onsets to choose."""
        return _LEAST_RATIO + 2 * math.log(max(self.window / self.period / _FEW, 1.0))

    @classmethod
    def from_gains(cls, gains: Any) -> SamplesEngine:
        """From a design's gains."""
        A = gains["A"]
        plant = SampledPlant(
            A, gains.get("B", np.zeros((len(A), 0))), gains["C"], gains["H"],
            (gains["flow_lower"] + gains["flow_upper"]) / 2,
        )  # fmt: skip
        noise = gains["noise_std"], gains["noise_cv"]
        return cls(
            OnsetModel(plant, bool(gains.get("nonnegative", False))), noise,
            float(gains["window"]), float(gains["dwell_time"][0]), float(gains["period"]),
        )  # fmt: skip

    # --- rows in, rows out ----------------------------------------------------------------------

    def begin(self, t: float, x: Vector, covariance: Array | None) -> SampledLive:
        """Nothing seen yet."""
        inputs = np.zeros(self.model.plant.B.shape[1])
        return SampledLive(t, x, covariance, inputs, Cells.empty(len(x)))

    def extended(
        self, live: SampledLive, t: Array, y: Array, u: Array
    ) -> tuple[SampledLive, list[Estimate]]:
        """After further rows; a window is evaluated once it is complete."""
        with np.errstate(all="ignore"):  # rows that are not finite have a status
            return self._extended(live, t, y, u)

    def _extended(
        self, live: SampledLive, t: Array, y: Array, u: Array
    ) -> tuple[SampledLive, list[Estimate]]:
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
            while len(live.rows) > 1 and row.t > self._end(live, row.t):
                live, rows = self._evaluated(live)
                decided += rows
            live = self._with(live, row)
            if row.t >= self._end(live, row.t, -1.0):
                live, rows = self._evaluated(live)
                decided += rows
        return live, decided

    def prediction(self, live: SampledLive) -> Vector:
        """The filter over all rows that are open, without further impulses."""
        return live.rows[-1].x if live.rows else live.x

    def tail(self, live: SampledLive) -> tuple[Estimate, ...]:
        """Rows that are open; impulses that an incomplete window shows are provisional."""
        with np.errstate(all="ignore"):
            return self._tail(live)

    def _tail(self, live: SampledLive) -> tuple[Estimate, ...]:
        found: list[Estimate] = []
        while len(live.rows) > _FEWEST:
            live, rows = self._evaluated(live, provisional=True)
            found += rows
        found += [self._estimate(live, at.row, at.x) for at in live.rows]
        return tuple(row._replace(status=_joined(row.status, "unresolved")) for row in found)

    def _first(self, live: SampledLive, row: Row) -> SampledLive:
        plant = self.model.plant
        x = plant.free(live.t, live.x, live.u, row.t)
        factor = np.diag(self._guess(x, row)) if live.P is None else square_root(live.P)
        at = plant.start(live.t, live.x, factor, live.u, row)
        return replace(live, rows=(at,), steady=(Steady.begin(at),) * 2)

    def _guess(self, x: Vector, row: Row) -> Vector:
        """Deviations of a first guess: an impulse as large as the first measurement."""
        count, C = 64, self.model.plant.C
        states = self.model.states(np.linspace(0.0, self.window, count + 1))  # (k, n)
        shown = float(np.abs(states @ C.T).max()) or 1.0
        level = float(np.abs(row.y).max()) if row.y is not None else 1.0
        miss = float(np.abs(row.y - C @ x).max()) if row.y is not None else 0.0
        sizes = np.abs(states).max(axis=0) * max(level / 2, miss) / shown
        return np.asarray(np.maximum(sizes, 1e-6 * (float(sizes.max()) or 1.0)))

    def _with(self, live: SampledLive, row: Row) -> SampledLive:
        """One more row in the window."""
        last = live.rows[-1]
        at = self.model.plant.after(last, row)
        cells = self.model.gridded(live.cells.after(at), last.row.t, self.period)
        return replace(live, rows=(*live.rows, at), cells=cells)

    def _end(self, live: SampledLive, t: float, sign: float = 1.0) -> float:
        """End of the window, with the tolerance of a stamp t on one side or (sign) the other.

        After a gap in the rows it reaches as far behind it as it would.
        """
        first, second = live.rows[0].row.t, live.rows[1].row.t
        tolerance = time_tolerance(self.window, t)
        return max(first, second - self.period) + self.window + sign * tolerance

    def _estimate(
        self, live: SampledLive, row: Row, x: Vector, events: tuple[Event, ...] = ()
    ) -> Estimate:
        status = status_of([] if row.y is not None else ["missing sample"], x)
        if live.doubt[0] <= row.t <= live.doubt[1]:
            status = _joined(status, live.doubt[2])
        return Estimate(row.t, x=x, events=events, status=status)

    # --- windows --------------------------------------------------------------------------------

    def _evaluated(
        self, live: SampledLive, provisional: bool = False
    ) -> tuple[SampledLive, list[Estimate]]:
        """Fire, or go on by one row."""
        first, second = live.rows[:2]
        interval = max(second.row.t - first.row.t, self.period)
        before, last = live.rows[-2].row.t, live.rows[-1].row.t
        fit = self.model.posterior(
            live.cells, live.cells.grid.before(last - _LATEST * (last - before))
        )
        top = int(np.argmax(fit.ratio))
        oldest = first.row.t + interval
        oldest -= time_tolerance(interval, oldest)
        if fit.ratio[top] > self.least_ratio and fit.grid.onsets[top] < oldest:
            return self._fired(live, interval, provisional)
        since = second.row.t - self.period - time_tolerance(self.period, second.row.t)
        cut = bisect_left(live.before, since, key=lambda at: at.row.t)
        return replace(
            live, rows=live.rows[1:], cells=live.cells.without_first(),
            before=(*live.before[cut:], first), residuals=_with_rows(live, live.before[:cut]),
            steady=self._followed(live.steady, second.row, second.cost),
        ), [self._estimate(live, first.row, first.x)]  # fmt: skip

    # --- an impulse -------------------------------------------------------------------------------

    def _fired(
        self, live: SampledLive, interval: float, provisional: bool
    ) -> tuple[SampledLive, list[Estimate]]:
        """The impulse of this window, its rows, and a window that begins at its end."""
        known = (*live.before, *live.rows)
        start, rows = known[0], [at.row for at in known[1:]]
        third = live.rows[min(2, len(live.rows) - 1)].row.t
        end = min(max(third, live.rows[0].row.t + 2 * interval), rows[-1].t)
        cells = self.model.window(start, rows, end)
        step = max(interval / ONSETS, (end - start.row.t) / _MOST_ONSETS)  # after a gap: coarser
        count = max(round((end - start.row.t) / step) - 1, 2)
        grid = self.model.at(cells, start.row.t + step * np.arange(count))
        fit = self.model.refined(cells, self.model.posterior(cells, grid))
        steady, ahead = self._ahead(live, fit.cost)
        freedom = sum(row.y is not None for row in rows) * len(self.model.plant.C) - 2
        residuals = _with_rows(live, (start,)).joined(fit.cost, freedom)
        live = replace(live, residuals=residuals)
        event = self._event(live, fit, freedom, ahead >= _AHEAD, provisional)
        doubt = live.doubt
        if event.status != "ok":
            doubt = (live.rows[0].row.t, rows[-1].t, event.status)
        live = replace(live, doubt=doubt)
        means, last = self.model.collapsed(fit, cells, start, rows)
        decided, given = [], False
        for at, mean in list(zip(known, means, strict=True))[len(live.before) : -1]:
            events = (event,) if not given and (at.row.t >= event.t or at is known[-2]) else ()
            given = given or bool(events)
            decided.append(self._estimate(live, at.row, mean, events))
        return replace(
            live, rows=(last,), cells=Cells.empty(len(last.x)), before=(),
            steady=(steady[ahead >= _AHEAD], Steady.begin(last)), last_event=event.t,
            last_std=event.t_std or 0.0,
        ), decided  # fmt: skip

    def _ahead(self, live: SampledLive, cost: float) -> tuple[tuple[Steady, ...], float]:
        """(the steady input up to the end of the window, what it leaves more than the impulses do).

        cost: what the impulse leaves of the samples after the first row that is known.
        """
        again = sum(at.cost for at in (*live.before, live.rows[0])[1:])  # now explained by the fit
        steady, share = live.steady, (cost - again) / (len(live.rows) - 1)
        for at in live.rows[1:]:
            steady = self._followed(steady, at.row, share)
        ahead = steady[0].cost(self.model.nonnegative) - steady[0].rival
        return steady, ahead

    def _followed(self, steady: tuple[Steady, ...], row: Row, rival: float) -> tuple[Steady, ...]:
        return tuple(one.after(self.model.plant, row, rival) for one in steady)

    def _event(
        self, live: SampledLive, fit: Fit, freedom: int, alone: bool, provisional: bool
    ) -> Event:
        """What is told of an impulse; alone: nothing steady explains the samples as well.

        freedom: degrees of freedom of what the fit leaves of the window's samples.
        """
        p, onsets = fit.probability, fit.grid.onsets
        step = float(onsets[1] - onsets[0])
        t = float(p @ onsets)
        weight = float(p @ fit.weights)
        own, whole = birge_ratio(fit.cost, freedom), live.residuals.ratio
        larger = max(own, whole)
        t_std = larger * math.sqrt(float(p @ (onsets - t) ** 2) + step**2 / 12)
        spread = float(p @ (fit.weights**2 + 1 / fit.precision)) - weight**2
        status = "ok"
        if own > 1:
            status = MISFIT
        if whole > 1:
            status = _joined(status, LARGER)
        if gap := short_dwell(live.last_event, t, self.dwell, live.last_std, t_std):
            status = _joined(status, gap)
        if not alone:
            status = _joined(status, STEADY)
        if provisional:
            status = _joined(status, "provisional: the record ends inside its window")
        weight_std = larger * math.sqrt(max(spread, 0.0))
        return Event(t, np.array([weight]), t_std, np.array([weight_std]), status)


def _with_rows(live: SampledLive, rows: tuple[Filtered, ...]) -> Residuals:
    """The residuals with those of rows that no window will use again."""
    found = live.residuals
    for at in rows:
        found = found.joined(at.cost, len(at.surprise))
    return found


def _joined(status: str, more: str) -> str:
    return more if status == "ok" else f"{status}; {more}"
