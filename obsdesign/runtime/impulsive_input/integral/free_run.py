"""The observer's free run between two restarts, and the features of every window along it.

    xhat' = A xhat + K (y - C xhat) + B u + b_mid    exact for a residual linear between samples
    R_i(t_o) = int over [t_o, t_o + tau] of e^{lambda_i (t_o + tau - theta)} (y - C xhat) d theta

Since no impulse is added during a search, the residual is one signal, and R follows from its
running integrals I(t): R = I(t_o + tau) - e^{lambda tau} I(t_o). They decay for lambda < 0; for
lambda >= 0 the same is done backwards in time, where they decay too. Steps may differ.

Recursions over the rows of a record by doubling, and running integrals against kernels.
"""

from __future__ import annotations

import itertools
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.exponential import expm
from obsdesign.equations.estimation_error import flow_error_matrix
from obsdesign.equations.impulsive_input.features import kernel_weights
from obsdesign.runtime.base import Vector
from obsdesign.runtime.flow_response import responses
from obsdesign.runtime.step_cache import cached_step
from obsdesign.runtime.time_stamps import time_tolerance, time_tolerances

# (a, b, h): the cells between rows a, a + 1, ..., b all have the length h
Run = tuple[int, int, float]


def accumulated(flow: Rows, forced: Rows, start: Rows) -> Rows:
    """x_j = flow x_{j-1} + forced_j, all j by doubling: x = sum of flow^i forced_{j-i}."""
    x = forced.copy()
    x[0] += flow @ start
    return doubled(flow, x)


def doubled(flow: Rows, x: Rows) -> Rows:
    """x_j + flow x_{j-1} + flow^2 x_{j-2} + ..., in place; x (L, n), or (L, k, n) of rows."""
    power, reach = flow, 1
    while reach < len(x):
        x[reach:] = x[reach:] + x[:-reach] @ power.T
        power, reach = power @ power, 2 * reach
    return x


def running_integrals(times: Rows, runs: list[Run], error: Rows, lams: Vector, start: Rows) -> Rows:
    """Running integrals at times[1:], (L, p, k), from `start` at times[0]; all lams decay."""
    sums = np.empty((len(times) - 1, error.shape[1], len(lams)))
    at = start
    for a, b, h in runs:
        newer, older = kernel_weights(lams, h)
        pieces = error[a + 1 : b + 1, :, None] * newer + error[a:b, :, None] * older
        factor, reach = np.exp(lams * h), 1
        pieces[0] += factor * at
        while reach < len(pieces):
            pieces[reach:] = pieces[reach:] + factor * pieces[:-reach]
            factor, reach = factor * factor, 2 * reach
        sums[a:b] = pieces
        at = pieces[-1]
    return sums


def integrals_at(t: Rows, error: Rows, integrals: Rows, lams: Vector, times: Rows) -> Rows:
    """Running integrals at any times of a track, the residual linear between its rows."""
    last = len(t) - 1
    cell = np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(last - 1, 0))
    width = t[np.minimum(cell + 1, last)] - t[cell]
    share = (times - t[cell]) / np.where(width > 0, width, 1.0)
    # a window may end on a row: time stamps are decimal
    share = np.where(np.abs(share) < 1e-6, 0.0, np.where(np.abs(share - 1) < 1e-6, 1.0, share))
    cell, share = (
        np.where(share == 1, np.minimum(cell + 1, last), cell),
        np.where(share == 1, 0.0, share),
    )
    found = integrals[cell]
    between = np.flatnonzero(share)
    if len(between):
        at, v = cell[between], (share * width)[between]
        newer, older = kernel_weights(lams, v)
        part = share[between][:, None]
        there = error[at] + part * (error[at + 1] - error[at])
        found[between] = (
            np.exp(lams * v[:, None])[:, None, :] * integrals[at]
            + newer[:, None, :] * there[:, :, None]
            + older[:, None, :] * error[at][:, :, None]
        )
    return found


Rows = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Track:
    """Measured rows of a free run: times t (L,), y (L, p), forcing (L, n), xhat (L, n).

    forcing: B u + b_mid up to the next row, or the constant that moves the plant as far until then;
    integrals (L, p, k): running integrals I of the residual for the k exponents below zero.
    """

    t: Rows
    y: Rows
    forcing: Rows
    x: Rows
    integrals: Rows

    def without(self, rows: int) -> Track:
        """The track from row `rows` on."""
        return Track(*(getattr(self, name)[rows:] for name in self.__slots__))


@dataclass(frozen=True)
class FreeRun:
    """The parameters of a free run; steps of equal length share their matrices."""

    A: Rows
    K: Rows
    C: Rows
    B: Rows
    drift: Vector
    exponents: Vector
    tau: float
    period: float | None = None
    _steps: OrderedDict[float, tuple[Any, ...]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @cached_property
    def D(self) -> Rows:
        """A - K C: the error between impulses."""
        return np.asarray(flow_error_matrix(self.A, self.K, self.C))

    @property
    def _falling(self) -> NDArray[np.bool_]:
        return np.asarray(self.exponents < 0)

    def begin(self, t: float, y: Rows, forcing: Rows, x: Rows) -> Track:
        """A track of one row, where the estimate is x."""
        zeros = np.zeros((1, len(self.C), int(self._falling.sum())))
        return Track(np.array([t]), y[None], forcing[None], x[None], zeros)

    def restarted(self, track: Track, row: int, x: Rows) -> Track:
        """The track from `row` on, run again with the estimate x there."""
        first = self.begin(float(track.t[row]), track.y[row], track.forcing[row], x)
        rest = track.without(row + 1)
        return self.extended(first, rest.t, rest.y, rest.forcing)

    def extended(self, track: Track, t: Rows, y: Rows, forcing: Rows) -> Track:
        """The track with further rows."""
        if len(t) == 0:
            return track
        times = np.concatenate([track.t[-1:], t])
        ys = np.concatenate([track.y[-1:], y])
        forced = np.concatenate([track.forcing[-1:], forcing])
        ends = self._runs(times)
        x = self._estimates(times, ends, ys, forced, track.x[-1])
        error = ys - np.concatenate([track.x[-1:], x]) @ self.C.T
        lams = self.exponents[self._falling]
        sums = running_integrals(times, ends, error, lams, track.integrals[-1])
        parts = zip(
            (track.t, track.y, track.forcing, track.x, track.integrals),
            (t, y, forcing, x, sums),
            strict=True,
        )
        return Track(*(np.concatenate(pair) for pair in parts))

    def features(self, track: Track, first: int, last: int) -> Rows:
        """R for the windows that start at rows first..last - 1, (last - first, p m)."""
        starts = track.t[first:last]
        error = track.y - track.x @ self.C.T
        falling, lams = self._falling, self.exponents
        R = np.empty((len(starts), len(self.C), len(lams)))
        if falling.any():
            down = lams[falling]
            ending = integrals_at(track.t, error, track.integrals, down, starts + self.tau)
            R[:, :, falling] = ending - np.exp(down * self.tau) * track.integrals[first:last]
        if not falling.all():
            up = lams[~falling]
            stop = min(int(np.searchsorted(track.t, starts[-1] + self.tau)) + 2, len(track.t))
            times, back = -track.t[first:stop][::-1], error[first:stop][::-1]
            zeros = np.zeros((len(self.C), len(up)))
            sums = running_integrals(times, self._runs(times), back, -up, zeros)
            sums = np.concatenate([zeros[None], sums])
            near = integrals_at(times, back, sums, -up, -starts)
            far = integrals_at(times, back, sums, -up, -(starts + self.tau))
            R[:, :, ~falling] = near - np.exp(-up * self.tau) * far  # scaled by e^{-lambda tau}
        return R.reshape(len(starts), -1)

    def _estimates(self, times: Rows, ends: list[Run], y: Rows, forced: Rows, at: Vector) -> Rows:
        """xhat at times[1:] from `at` at times[0], with outputs y and other inputs `forced`."""
        x = np.empty((len(times) - 1, len(self.A)))
        for a, b, h in ends:
            maps = self._maps(h)
            flow, older, newer, held = maps[:4]
            driven = y[a:b] @ older.T + y[a + 1 : b + 1] @ newer.T + forced[a:b] @ held.T
            x[a:b] = accumulated(flow, driven, at)
            at = x[b - 1]
        return x

    def coasting(self, times: Rows, since: float, x: Vector) -> Rows:
        """e^{D (t - since)} x at increasing times t, (k, n)."""
        return self._coasted(self.D, times, since, x)

    def impulse_error(self, times: Rows, since: float, x: Vector) -> Rows:
        """x - xhat at the rows of a window after an impulse that moves the plant by x, (k, n).

        As this observer makes it from samples; close to e^{D (t - since)} x.
        """
        error = np.zeros((len(times), len(self.A)))
        after = times >= since - time_tolerance(self.tau, since)
        if after.any():
            error[after] = self._coasted(self.A, times[after], since, x)
        y, nothing = error @ self.C.T, np.zeros_like(error)
        error[1:] -= self._estimates(times, self._runs(times), y, nothing, nothing[0])
        return error

    def onset_features(self, times: Rows, taps: Rows) -> Rows:
        """M, (rows, p m, n): features of unit states that appear at a row, as samples show them.

        An impulse v before row c leaves M_c e^{A v} H g; before it, and in the cell that ends at c,
        the samples know nothing of it. taps (rows, m) make features of the residual.
        """
        n, p, m = len(self.A), len(self.C), taps.shape[1]
        shown = (self.C[None, :, None, :] * taps[:, None, :, None]).reshape(len(times), p * m, n)
        found, kicks = np.empty_like(shown), np.empty((len(times), n, n))
        found[-1], kicks[0] = shown[-1], np.eye(n)
        for a, b, h in reversed(self._runs(times)):
            maps = self._maps(h)
            backwards = shown[a:b][::-1].copy()
            backwards[0] += found[b] @ maps[4]
            found[a:b] = doubled(maps[4].T, backwards)[::-1]
            kicks[a + 1 : b + 1] = np.eye(n) - maps[2] @ self.C
        return np.asarray(found @ kicks)

    def plant_step(self, since: float, until: float) -> tuple[Rows, Rows]:
        """(e^{A h}, its integral over h) for h = until - since."""
        maps = self._maps(until - since)
        return maps[5], maps[6]

    def _coasted(self, X: Rows, times: Rows, since: float, x: Vector) -> Rows:
        found = np.empty((len(times), len(x)))
        found[0] = expm(X * float(times[0] - since)) @ x
        for a, b, h in self._runs(times):
            flow = expm(X * h)
            found[a + 1 : b + 1] = accumulated(flow, np.zeros((b - a, len(x))), found[a])
        return found

    def _runs(self, times: Rows) -> list[Run]:
        """Runs of cells of the same length, as far as time stamps can tell."""
        if len(times) < 2:
            return []
        steps = np.diff(times)
        slack = time_tolerances(steps, times[1:])
        cuts = np.flatnonzero(np.abs(np.diff(steps)) > slack[1:] + slack[:-1]) + 1
        ends = itertools.pairwise([0, *cuts.tolist(), len(steps)])
        return [(a, b, self._length(times, a, b)) for a, b in ends]

    def _length(self, times: Rows, first: int, last: int) -> float:
        """The period where stamps agree with it, else the mean: they round it once, not each cell.

        The period, since it is the same whatever part of a record is looked at.
        """
        mean = float(times[last] - times[first]) / (last - first)
        if self.period is None:
            return mean
        slack = time_tolerance(self.period, float(np.abs(times[[first, last]]).max()))
        return self.period if abs(mean - self.period) <= slack else mean

    def _maps(self, h: float) -> tuple[Any, ...]:
        return cached_step(self._steps, h, self._step)

    def _step(self, h: float) -> tuple[Any, ...]:
        """xhat+ = flow xhat + older y + newer y+ + held (B u + b_mid) over a step h.

        The residual r = y - C xhat is linear over the step; r+ depends on xhat+:
        (I + R K C) xhat+ = (e^{A h} - (S - R) K C) xhat + (S - R) K y + R K y+ + S (B u + b_mid),
        S and R the responses to a unit step and a unit ramp.
        """
        flow, once, ramp = responses(self.A, h)
        older, newer = (once - ramp) @ self.K, ramp @ self.K
        whole = np.hstack([flow - older @ self.C, older, newer, once])
        solved = np.linalg.solve(np.eye(len(flow)) + newer @ self.C, whole)
        n, p = self.K.shape
        cuts = np.cumsum([n, p, p])
        parts = np.split(solved, cuts, axis=1)
        error = flow - parts[1] @ self.C - parts[2] @ self.C @ flow  # x - xhat over the step
        return parts[0], parts[1], parts[2], parts[3], error, flow, once
