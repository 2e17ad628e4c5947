"""Noise in the features of a window: where it enters, and what it makes of fit and state.

A sample enters the residual twice: directly, and through K by the estimates after it, so that the
residual of a window is not white. Features and the error at the last row are linear in
independent sources, the error at the first row and the noise of each sample,

    R = b g + V F a + N' v,      error = U g + flow F a + Z' v,      a, v of unit covariance,

whose coefficients are those of the observer as samples drive it: their covariances are exact. They
are made white by a QR factorisation of the coefficients; no covariance is formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.equations.impulsive_input.gains import IntegralGains
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.integral.recursions import accumulated, doubled
from obsdesign.runtime.impulsive_input.whitening import Weighted

_EQUAL_TIMES = 1e-12  # of the window: times closer than this are one


@dataclass(frozen=True, eq=False)
class Responses:
    """What states and samples of a window leave in its features, and at its last row.

    Of unit states x - xhat at the first row: V (r, n), flow (n, n). Of unit states that the plant
    is moved by just before a row: onsets (rows, r, n), states (rows, n, n); before it, and in the
    cell that ends there, samples do not show them. Of errors of one sample: noise (rows, p, r),
    ends (rows, p, n).

    The error at a row is without that of the row's own sample, which the next window counts: so
    the first sample adds what it does through the estimate of its own row, and the last one nothing
    to the error at its row.
    """

    V: Matrix
    flow: Matrix
    onsets: Matrix
    states: Matrix
    noise: Matrix
    ends: Matrix

    @classmethod
    def from_run(cls, run: FreeRun, times: Matrix, taps: Matrix) -> Responses:
        """Those of an observer with rows at `times`; taps (rows, p, r): features of residuals."""
        C, n, (rows, p, size) = run.gains.C, run.gains.n, taps.shape
        noise = np.zeros((rows, size + n, p))
        noise[:, :size] = taps.transpose(0, 2, 1)
        shown = noise @ C
        shown[-1, size:] = np.eye(n)
        left, kicks = np.empty_like(shown), np.empty((rows, n, n))
        left[-1], kicks[0] = shown[-1], np.eye(n)
        cells = run.runs(times)
        for a, b, h in reversed(cells):
            maps = run.maps(h)
            backwards = shown[a:b][::-1].copy()
            backwards[0] += left[b] @ maps.error
            left[a:b] = doubled(maps.error.T, backwards)[::-1]
            kicks[a + 1 : b + 1] = np.eye(n) - maps.newer @ C
            noise[a:b] -= left[a + 1 : b + 1] @ maps.older
            noise[a + 1 : b + 1] -= left[a + 1 : b + 1] @ maps.newer
        noise[0] -= left[0] @ run.maps(cells[0][2]).newer  # of a cell before like the first one
        noise[-1, size:] = 0.0
        moved_on, sources = left @ kicks, noise.transpose(0, 2, 1)
        return cls(
            V=left[0, :size], flow=left[0, size:], onsets=moved_on[:, :size],
            states=moved_on[:, size:], noise=sources[:, :, :size], ends=sources[:, :, size:],
        )  # fmt: skip

    def impulses(
        self, gains: IntegralGains, times: Matrix, onsets: Matrix
    ) -> tuple[Matrix, Matrix]:
        """(features (G, r, q), states (G, n, q)) of impulses of weight 1 at onsets (G,)."""
        cells = first_rows(times, onsets, gains.window)
        late = np.maximum(times[cells] - onsets, 0.0)
        jumps = expm(gains.A * late[:, None, None]) @ gains.H
        return self.onsets[cells] @ jumps, self.states[cells] @ jumps

    def sources(self, root: Matrix, spread: Matrix) -> Matrix:
        """Coefficients of all sources, (n + rows p, r); root (n, n): F; spread (rows, p)."""
        noise = (self.noise * spread[:, :, None]).reshape(spread.size, -1)
        return np.vstack([(self.V @ root).T, noise])


def first_rows(times: Matrix, onsets: Matrix, tau: float) -> Indices:
    """Rows of a window of length tau at which the samples first show each onset (G,)."""
    rows = np.searchsorted(times, onsets - _EQUAL_TIMES * tau)
    return np.clip(rows, 1, len(times) - 1)


@dataclass(frozen=True, eq=False)
class WindowNoise:
    """Features of unit noise, and what they tell of the sources.

    features: R (r,) and the map T of the features that `responses` has. root (n, n): F; spread
    (rows, p): deviations of samples; known (n + rows p, r): rows of the sources in the features,
    orthonormal columns; after (n + rows p, n): sources in the error at the last row.
    """

    features: Weighted
    responses: Responses
    root: Matrix
    spread: Matrix
    known: Matrix
    after: Matrix

    @classmethod
    def from_features(
        cls, features: Weighted, responses: Responses, root: Matrix, spread: Matrix
    ) -> WindowNoise:
        """Of features R = T f, f those of `responses`; root (n, n): F of P = F F' at first."""
        R, T = features
        known, upper = np.linalg.qr(responses.sources(root, spread) @ T.T)
        ends = (responses.ends * spread[:, :, None]).reshape(spread.size, -1)
        after = np.vstack([(responses.flow @ root).T, ends])
        white = np.linalg.solve(upper.T, np.column_stack([R, T]))
        white_features = Weighted(white[:, 0], white[:, 1:])
        return cls(white_features, responses, root, spread, known, after)

    @property
    def gain(self) -> Matrix:
        """(n, r): of white features, the error at the last row that they make likely."""
        return np.asarray(self.after.T @ self.known)

    def covariance(self) -> Matrix:
        """Of the error at the last row, (n, n), given the features of a known impulse."""
        unknown = self.after - self.known @ (self.known.T @ self.after)
        return np.asarray(unknown.T @ unknown)

    def sources(self, remainder: Matrix) -> tuple[Matrix, Matrix]:
        """(error (n,) at the first row, noise (rows, p)) that white features (r,) make likely."""
        unit, n = self.known @ remainder, len(self.root)
        return self.root @ unit[:n], self.spread * unit[n:].reshape(self.spread.shape)


def misfit(
    run: FreeRun, window: tuple[Matrix, Matrix, Matrix], root: Matrix, since: float, moves: Matrix
) -> float:
    """Chi-squared of the residuals of a window that one impulse leaves.

    window: times (rows,), residuals and deviations of the samples, above zero, (rows, p). What K
    made of residuals is undone first: then their noise is that of the samples, that of the error at
    the first row, of covariance F F', root = F (n, n), and that of the impulse at time `since`,
    moves (n, k): states that it may miss there, of unit variance.
    """
    times, error, spread = window
    runs, A, C, K = run.runs(times), run.gains.A, run.gains.C, run.gains.K
    added = np.empty((len(times), run.gains.n))  # to the estimate, by the residuals so far
    first = run.plant.step(runs[0][2])[2] @ K
    added[0] = first @ error[0]
    for a, b, h in runs:
        flow, once, ramp = run.plant.step(h)
        forced = error[a:b] @ ((once - ramp) @ K).T + error[a + 1 : b + 1] @ (ramp @ K).T
        added[a + 1 : b + 1] = accumulated(flow, forced, added[a])
    free = expm(A * (times - times[0])[:, None, None]) @ (root + first @ C @ root)
    late = expm(A * np.maximum(times - since, 0.0)[:, None, None]) @ moves
    states = np.concatenate([free, late * (times >= since)[:, None, None]], axis=2)
    shown = (C @ states / spread[:, :, None]).reshape(spread.size, -1)
    white = np.append((error + added @ C.T) / spread, np.zeros(shown.shape[1]))
    Q = np.linalg.qr(np.vstack([shown, np.eye(shown.shape[1])]))[0]
    return float(((white - Q @ (Q.T @ white)) ** 2).sum())
