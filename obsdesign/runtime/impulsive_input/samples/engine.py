"""Few samples per time constant: the finite-memory operator of the paper on samples.

With samples t_o < t_1 <= ... <= t_N = t_o + tau, a guess of x(t_o) with covariance P, and an onset
t anywhere between samples,

    e_k = y_k - C x_free(t_k) = C e^{A (t_k - t_o)} eps_o + g C e^{A (t_k - t)} H 1[t_k >= t] + v_k

holds exactly: nothing is interpolated. All samples of a window serve as features (any N distinct
exponents would span the same). Between impulses a Kalman filter without process noise runs on the
samples. A window fires when its likelihood ratio is large and largest in its oldest interval; the
impulse is then fitted as a posterior over all onsets that the samples allow (`refit`): at this
sampling the likelihood has kinks, and a linearised deviation is far too small.
An extension of (18) of Mattsson and Medvedev; in the limit of all taps a fixed-lag
likelihood-ratio test.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.impulsive_input.gains import SamplesGains
from obsdesign.runtime.base import Estimate
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.impulsive_input.event import (
    MISFIT,
    OPEN,
    Event,
    missing_sample,
    onset_statistics,
    with_event,
)
from obsdesign.runtime.impulsive_input.initial import Initial
from obsdesign.runtime.impulsive_input.residuals import birge_ratio
from obsdesign.runtime.impulsive_input.samples.filter import Filtered, Row, SampledPlant
from obsdesign.runtime.impulsive_input.samples.live import SampledLive
from obsdesign.runtime.impulsive_input.samples.onset import Cells, Fit, OnsetModel
from obsdesign.runtime.impulsive_input.samples.open_rows import OpenRows
from obsdesign.runtime.impulsive_input.samples.refit import EARLIER, Refit
from obsdesign.runtime.impulsive_input.samples.steady_input import STEADY, Steady, SteadyInputs
from obsdesign.runtime.impulsive_input.samples.uncertain_state import UncertainState
from obsdesign.runtime.impulsive_input.significance import LEAST_ADVANTAGE, least_ratio
from obsdesign.runtime.status import status_of

_CLOSED_INTERVALS = 0.3  # intervals before the end of a window in which no onset is looked for
_MOST_BEFORE = 512  # rows before a window that are kept
_LEAST_TAIL_SAMPLES = 2  # samples of an incomplete window at the end of a record


@dataclass(frozen=True)
class SamplesEngine:
    """Parameters of the discrete operator: gains, and the model of a window."""

    gains: SamplesGains
    model: OnsetModel

    @classmethod
    def from_gains(cls, gains: SamplesGains) -> SamplesEngine:
        """The engine of a design's gains."""
        return cls(gains, OnsetModel(SampledPlant.from_gains(gains), bool(gains.nonnegative)))

    @cached_property
    def open_rows(self) -> OpenRows:
        """How rows come in."""
        return OpenRows(self.gains, self.model)

    @cached_property
    def uncertain(self) -> UncertainState:
        """Which rows rest on a weight that is hardly known."""
        return UncertainState(self.gains)

    @property
    def least_ratio(self) -> float:
        """Least likelihood ratio of an impulse: larger where there are more onsets to choose."""
        return least_ratio(self.gains.window / self.gains.sample_period)

    # --- rows in, rows out ----------------------------------------------------------------------

    @np.errstate(all="ignore")  # rows that are not finite have a status
    def extended(
        self, live: Initial | SampledLive, t: Matrix, y: Matrix, u: Matrix
    ) -> tuple[Initial | SampledLive, list[Estimate]]:
        """After further rows; a window is evaluated once it is complete."""
        decided: list[Estimate] = []
        for k in range(len(t)):
            if isinstance(live, Initial):
                live = self.open_rows.begun(live, float(t[k]), y[k], u[k])
                continue
            live = self.open_rows.scaled(live, y[k])
            row = self.open_rows.row(float(t[k]), y[k], u[k], live.level)
            while len(live.rows) > 1 and row.t > self._end(live, row.t):
                live, rows = self._evaluated(live)
                decided += rows
            live = self.open_rows.appended(live, row)
            if row.t >= self._end(live, row.t, -1.0):
                live, rows = self._evaluated(live)
                decided += rows
        return live, decided

    def prediction(self, live: Initial | SampledLive) -> Matrix:
        """The filter over all rows that are open, without further impulses."""
        return live.x if isinstance(live, Initial) else live.rows[-1].x

    @np.errstate(all="ignore")
    def tail(self, live: Initial | SampledLive) -> tuple[Estimate, ...]:
        """Rows that are open; impulses that an incomplete window shows are provisional."""
        if isinstance(live, Initial):
            return ()
        estimates: list[Estimate] = []
        while len(live.rows) > _LEAST_TAIL_SAMPLES:
            live, rows = self._evaluated(live, provisional=True)
            estimates += rows
        estimates += [self._estimate(live, at.row, at.x, is_open=True) for at in live.rows]
        return tuple(estimates)

    def _end(self, live: SampledLive, t: float, sign: float = 1.0) -> float:
        """End of the window, with the tolerance of a stamp t on one side or (sign) the other.

        After a gap in the rows it reaches as far behind it as it would.
        """
        first, second = live.rows[0].row.t, live.rows[1].row.t
        window = self.gains.window
        begin = max(first, second - self.gains.sample_period)
        return begin + window + sign * time_tolerance(window, t)

    def _estimate(self, live: SampledLive, row: Row, x: Matrix, *, is_open: bool) -> Estimate:
        """The estimate of a row; is_open: a further sample could have changed it."""
        missing = missing_sample(self.gains.sample_period, live.first, row.t)
        reasons = [] if row.y is not None else [*missing]
        reasons += live.history.doubts_at(row.t)
        reasons += [OPEN] if is_open else []
        return Estimate(row.t, x=x, status=status_of(reasons, x))

    # --- windows --------------------------------------------------------------------------------

    def _evaluated(
        self, live: SampledLive, provisional: bool = False
    ) -> tuple[SampledLive, list[Estimate]]:
        """Fire, or go on by one row."""
        live = self.open_rows.opened(live)
        first, second = live.rows[:2]
        period = self.gains.sample_period
        interval = max(second.row.t - first.row.t, period)
        before, last = live.rows[-2].row.t, live.rows[-1].row.t
        fit = self.model.posterior(
            live.cells, live.cells.grid.before(last - _CLOSED_INTERVALS * (last - before))
        )
        top = int(np.argmax(fit.ratio))
        oldest = first.row.t + interval
        oldest -= time_tolerance(interval, oldest)
        if fit.ratio[top] > self.least_ratio and fit.grid.onsets[top] < oldest:
            return self._fired(live, interval, provisional)
        earlier = max(period, self.gains.shortest_dwell - self.gains.window)  # see `refit`
        since = second.row.t - earlier - time_tolerance(earlier, second.row.t)
        cut = bisect_left(live.before, since, key=lambda at: at.row.t)
        cut = max(cut, len(live.before) + 1 - _MOST_BEFORE)
        residuals = live.residuals_with(live.before[:cut])
        rows = [self._estimate(live, first.row, first.x, is_open=provisional)]
        history = self.uncertain.continued(live.history, first.row.t, second)
        return replace(
            live,
            rows=live.rows[1:],
            guess=self.open_rows.guess_after(live),
            cells=live.cells.without_first(),
            before=(*live.before[cut:], first),
            history=replace(history, residuals=residuals),
            steady=live.steady.after(self.model.plant, second.row, second.cost),
        ), rows

    # --- an impulse -------------------------------------------------------------------------------

    def _fired(
        self, live: SampledLive, interval: float, provisional: bool
    ) -> tuple[SampledLive, list[Estimate]]:
        """The impulse of this window, its rows, and a window that begins at its end."""
        refit = self._refit(live, interval)
        fit, rows, first = refit.fit, refit.rows, refit.first
        known, count = (*live.before, *live.rows), len(live.before)
        steady = self._followed(live, known[first + 1 : count + 1], fit.cost)
        rival = steady.long.cost(self.model.nonnegative) - steady.long.rival
        is_ahead = rival >= LEAST_ADVANTAGE
        freedom = sum(row.y is not None for row in rows) * self.gains.p - 2
        residuals = live.residuals_with(known[: first + 1]).joined(fit.cost, freedom)
        history = replace(live.history, residuals=residuals)
        event = history.judged(
            _event(fit, freedom), self.gains.shortest_dwell, cost=fit.cost, freedom=freedom
        )
        doubts = [*self.uncertain.doubts(event), *self._doubts(live, refit)]
        doubts += [] if is_ahead else [STEADY]
        doubts += ["provisional: the record ends inside its window"] if provisional else []
        event = replace(event, doubts=(*event.doubts, *doubts))
        means, last = self.model.collapsed(fit, refit.cells, refit.start, rows)
        since = live.rows[0].row.t
        history = self.uncertain.continued(history, since, last).after(event, since, rows[-1].t)
        live = replace(live, history=history)
        decided = [
            self._estimate(live, at.row, mean, is_open=provisional)
            for at, mean in list(zip(known[first:], means, strict=True))[count - first : -1]
        ]
        long = steady.short if is_ahead else steady.long
        return replace(
            live,
            rows=(last,),
            cells=Cells.empty(len(last.x)),
            before=(),
            steady=SteadyInputs(long, Steady.begin(last)),
        ), with_event(decided, event)

    def _followed(
        self, live: SampledLive, refitted: tuple[Filtered, ...], cost: float
    ) -> SteadyInputs:
        """The steady inputs up to the end of the window.

        refitted: rows up to its first one that the fit explains too; cost: what it leaves of all.
        """
        share = (cost - sum(at.cost for at in refitted)) / (len(live.rows) - 1)
        steady = live.steady
        for at in live.rows[1:]:
            steady = steady.after(self.model.plant, at.row, share)
        return steady

    def _refit(self, live: SampledLive, interval: float) -> Refit:
        """The posterior over onsets, in any case from a period before the window's start on."""
        known, count, period = (
            (*live.before, *live.rows),
            len(live.before),
            self.gains.sample_period,
        )
        times = [at.row.t for at in known]
        since = times[count] - period - time_tolerance(period, times[count])
        until = max(live.rows[:3][-1].row.t, times[count] + 2 * interval)
        covered = bisect_left(times, since), min(bisect_left(times, until), len(times) - 1)
        return Refit.over(self.model, known, covered, interval)

    def _doubts(self, live: SampledLive, refit: Refit) -> list[str]:
        """That the impulse may have come before all rows that are known, where it may."""
        begin = max(live.first, live.history.earliest + self.gains.shortest_dwell)
        is_first = refit.start.row.t <= begin + time_tolerance(self.gains.window, begin)
        return [] if is_first or not refit.may_be_earlier else [EARLIER]


def _event(fit: Fit, freedom: int) -> Event:
    """The event of a fit; freedom: degrees of freedom of what it leaves of the samples.

    An onset stands for those within half a step of it, and its weight for theirs.
    """
    p, onsets = fit.probability, fit.grid.onsets
    t, t_std = onset_statistics(onsets, p, float(onsets[1] - onsets[0]))
    weight = float(p @ fit.weights)
    within = np.gradient(fit.weights) ** 2 / 12
    variance = float(p @ ((fit.weights - weight) ** 2 + within + 1 / fit.precision))
    return Event(
        t=t,
        weights=np.array([weight]),
        t_std=t_std,
        weights_std=np.array([math.sqrt(variance)]),
        doubts=(MISFIT,) if birge_ratio(fit.cost, freedom) > 1 else (),
    )
