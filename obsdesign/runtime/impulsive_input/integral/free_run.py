"""The observer's free run between two restarts, and the features of every window along it.

    xhat' = A xhat + K (y - C xhat) + B u + b_mid    exact for a residual linear between samples
    R_i(t_o) = int over [t_o, t_o + tau] of e^{lambda_i (t_o + tau - theta)} (y - C xhat) d theta

Since no impulse is added during a search, the residual is one signal, and R follows from its
running integrals I(t): R = I(t_o + tau) - e^{lambda tau} I(t_o). They decay for lambda < 0; for
lambda >= 0 the same is done backwards in time, where they decay too. Steps may differ.
"""

from __future__ import annotations

import itertools
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime.clocks.time_stamps import time_tolerance, time_tolerances
from obsdesign.runtime.impulsive_input.integral.recursions import (
    Run,
    accumulated,
    integrals_at,
    running_integrals,
)
from obsdesign.runtime.impulsive_input.plant import HeldPlant
from obsdesign.runtime.state_marks import PAST, Axes
from obsdesign.runtime.step_cache import cached_step


@dataclass(frozen=True, slots=True)
class Track:
    """Measured rows of a free run: times t (L,), y (L, p), forcing (L, n), xhat (L, n).

    forcing: B u + b_mid up to the next row, or the constant that moves the plant as far until then;
    integrals (L, p, k): running integrals I of the residual for the k exponents below zero.
    """

    t: Annotated[Matrix, PAST, Axes("rows")]
    y: Annotated[Matrix, Axes("rows p")]
    forcing: Annotated[Matrix, Axes("rows n")]
    x: Annotated[Matrix, Axes("rows n")]
    integrals: Annotated[Matrix, Axes("rows p k")]

    def from_row(self, row: int) -> Track:
        """The track from a row on."""
        return Track(
            t=self.t[row:],
            y=self.y[row:],
            forcing=self.forcing[row:],
            x=self.x[row:],
            integrals=self.integrals[row:],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class StepMaps:
    """xhat+ = flow xhat + older y + newer y+ + held (B u + b_mid) over a step.

    error (n, n): what the step makes of x - xhat.
    """

    flow: Matrix
    older: Matrix
    newer: Matrix
    held: Matrix
    error: Matrix


@dataclass(frozen=True)
class FreeRun:
    """The observer between impulses; steps of equal length share their matrices."""

    gains: IntegralGains
    plant: HeldPlant
    _steps: OrderedDict[float, StepMaps] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: IntegralGains) -> FreeRun:
        """The free run of a design."""
        return cls(gains, HeldPlant.from_gains(gains))

    @property
    def tau(self) -> float:
        """Length of a window."""
        return self.gains.window

    @cached_property
    def _falling(self) -> Array:
        return np.asarray(self.gains.exponents < 0)

    def begin(self, t: float, y: Matrix, forcing: Matrix, x: Matrix) -> Track:
        """A track of one row, where the estimate is x."""
        zeros = np.zeros((1, self.gains.p, int(self._falling.sum())))
        return Track(t=np.array([t]), y=y[None], forcing=forcing[None], x=x[None], integrals=zeros)

    def restarted(self, track: Track, row: int, x: Matrix) -> Track:
        """The track from `row` on, run again with the estimate x there."""
        first = self.begin(float(track.t[row]), track.y[row], track.forcing[row], x)
        following = track.from_row(row + 1)
        return self.extended(first, following.t, following.y, following.forcing)

    def extended(self, track: Track, t: Matrix, y: Matrix, forcing: Matrix) -> Track:
        """The track with further rows."""
        if len(t) == 0:
            return track
        times = np.concatenate([track.t[-1:], t])
        ys = np.concatenate([track.y[-1:], y])
        forced = np.concatenate([track.forcing[-1:], forcing])
        runs = self.runs(times)
        x = self._estimates(runs, ys, forced, track.x[-1])
        error = ys - np.concatenate([track.x[-1:], x]) @ self.gains.C.T
        lams = self.gains.exponents[self._falling]
        sums = running_integrals(runs, error, lams, track.integrals[-1])
        return Track(
            t=np.concatenate([track.t, t]),
            y=np.concatenate([track.y, y]),
            forcing=np.concatenate([track.forcing, forcing]),
            x=np.concatenate([track.x, x]),
            integrals=np.concatenate([track.integrals, sums]),
        )

    def residual(self, track: Track, first: int = 0, stop: int | None = None) -> Matrix:
        """y - C xhat at rows first .. stop - 1, (k, p)."""
        return track.y[first:stop] - track.x[first:stop] @ self.gains.C.T

    def features(self, track: Track, first: int, last: int) -> Matrix:
        """R for the windows that start at rows first..last - 1, (last - first, p m)."""
        starts, tau = track.t[first:last], self.tau
        error = self.residual(track)
        falling, lams = self._falling, self.gains.exponents
        R = np.empty((len(starts), self.gains.p, len(lams)))
        if falling.any():
            down = lams[falling]
            ending = integrals_at(track.t, error, track.integrals, down, starts + tau)
            R[:, :, falling] = ending - np.exp(down * tau) * track.integrals[first:last]
        if not falling.all():
            up = lams[~falling]
            stop = min(int(np.searchsorted(track.t, starts[-1] + tau)) + 2, len(track.t))
            times, back = -track.t[first:stop][::-1], error[first:stop][::-1]
            zeros = np.zeros((self.gains.p, len(up)))
            sums = running_integrals(self.runs(times), back, -up, zeros)
            sums = np.concatenate([zeros[None], sums])
            near = integrals_at(times, back, sums, -up, -starts)
            far = integrals_at(times, back, sums, -up, -(starts + tau))
            R[:, :, ~falling] = near - np.exp(-up * tau) * far  # scaled by e^{-lambda tau}
        return R.reshape(len(starts), -1)

    def _estimates(self, runs: list[Run], y: Matrix, forced: Matrix, at: Matrix) -> Matrix:
        """xhat at all rows but the first, from `at` there, with outputs y and inputs `forced`."""
        x = np.empty((len(y) - 1, self.gains.n))
        for a, b, h in runs:
            maps = self.maps(h)
            driven = (
                y[a:b] @ maps.older.T + y[a + 1 : b + 1] @ maps.newer.T + forced[a:b] @ maps.held.T
            )
            x[a:b] = accumulated(maps.flow, driven, at)
            at = x[b - 1]
        return x

    def smoothing(self, times: Matrix, start: Matrix, noise: Matrix) -> Matrix:
        """Change of xhat at the rows of a window, (k, n), when errors of it are taken away.

        start (n,): error at the first row, without that of its own sample; noise (k, p): of the
        samples. The last sample acts on the next window.
        """
        runs, none = self.runs(times), np.zeros((len(times), self.gains.n))
        y = np.concatenate([-noise[:-1], 0 * noise[-1:]])
        first = start + self.maps(runs[0][2]).newer @ y[0]
        return np.concatenate([first[None], self._estimates(runs, y, none, first)])

    def impulse_error(self, times: Matrix, since: float, x: Matrix) -> Matrix:
        """x - xhat at the rows of a window after an impulse that moves the plant by x, (k, n).

        As this observer makes it from samples; close to e^{(A - K C) (t - since)} x.
        """
        error = np.zeros((len(times), self.gains.n))
        after = times >= since - time_tolerance(self.tau, since)
        if after.any():
            error[after] = self._coasted(times[after], since, x)
        y, nothing = error @ self.gains.C.T, np.zeros_like(error)
        error[1:] -= self._estimates(self.runs(times), y, nothing, nothing[0])
        return error

    def _coasted(self, times: Matrix, since: float, x: Matrix) -> Matrix:
        """e^{A (t - since)} x at increasing times t, (k, n)."""
        A, states = self.gains.A, np.empty((len(times), len(x)))
        states[0] = expm(A * float(times[0] - since)) @ x
        for a, b, h in self.runs(times):
            flow = expm(A * h)
            states[a + 1 : b + 1] = accumulated(flow, np.zeros((b - a, len(x))), states[a])
        return states

    def runs(self, times: Matrix) -> list[Run]:
        """Runs of cells of the same length, up to the resolution of time stamps."""
        if len(times) < 2:
            return []
        steps = np.diff(times)
        slack = time_tolerances(steps, times[1:])
        cuts = np.flatnonzero(np.abs(np.diff(steps)) > slack[1:] + slack[:-1]) + 1
        ends = itertools.pairwise([0, *cuts.tolist(), len(steps)])
        return [(a, b, self._length(times, a, b)) for a, b in ends]

    def _length(self, times: Matrix, first: int, last: int) -> float:
        """The period where stamps agree with it, else the mean: they round it once, not each cell.

        The period, since it is the same for every part of a record.
        """
        mean, period = float(times[last] - times[first]) / (last - first), self.gains.period
        if period is None:
            return mean
        slack = time_tolerance(period, float(np.abs(times[[first, last]]).max()))
        return period if abs(mean - period) <= slack else mean

    def maps(self, h: float) -> StepMaps:
        """Maps of a step, from the cache if they are there."""
        return cached_step(self._steps, h, self.step_maps)

    def step_maps(self, h: float) -> StepMaps:
        """Maps of a step. The residual r = y - C xhat is linear over a step h; r+ depends on xhat+.

        (I + R K C) xhat+ = (e^{A h} - (S - R) K C) xhat + (S - R) K y + R K y+ + S (B u + b_mid),
        S and R the responses to a unit step and a unit ramp.
        """
        flow, once, ramp = self.plant.step(h)
        K, C = self.gains.K, self.gains.C
        older, newer = (once - ramp) @ K, ramp @ K
        whole = np.hstack([flow - older @ C, older, newer, once])
        solved = np.linalg.solve(np.eye(len(flow)) + newer @ C, whole)
        n, p = K.shape
        step, older, newer, held = np.split(solved, np.cumsum([n, p, p]), axis=1)
        error = flow - older @ C - newer @ C @ flow  # x - xhat over the step
        return StepMaps(flow=step, older=older, newer=newer, held=held, error=error)
