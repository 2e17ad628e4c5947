"""A Kalman filter for the plants of this package: the usual alternative, and nothing proved.

    x[k+1] = e^{Ah} x[k] + (int e^{As} ds) (B u[k] + b[k] + D d[k]),   d[k+1] = d[k] + noise
             in discrete time A x[k] + B u[k] + b[k] + D d[k]
    x+     = G x- + E w + c (+ H g)                                     at jumps
    y      = C x + v

Bounded b and c are taken as independent from row to row and uniform in their bounds, unknown inputs
d as random walks, impulses at unknown times as white noise. The variances of the last two have to
be given: with the right ones the filter is better than an observer that assumes nothing, with wrong
ones worse.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation.parameter_courses import nominal_plant
from obsdesign.equations.time_grid import rounded_steps
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime.base import Sample

# without any noise of y, so much of its size: a filter needs some
_LEAST_NOISE = 1e-6
_ROUNDING = 2.0**-50
# logarithms of the variances that are tried, and on how many rows at most
_TRIED, _MOST_ROWS = np.arange(-6.0, 7.0), 1500


# (of z, of u, what is added, its covariance)
_Maps = tuple[Matrix, Matrix, Matrix, Matrix]


@dataclass(frozen=True)
class Filtered:
    """Estimates at each row after its measurement and jump: t (rows,), x (rows, n), d (rows, q)."""

    t: Matrix
    x: Matrix
    d: Matrix
    log_likelihood: float


@dataclass(frozen=True)
class _Moments:
    """Of [x; d]: mean and covariance."""

    z: Matrix
    P: Matrix


def kalman_filter(
    plant: Plant,
    samples: Iterable[Sample],
    *,
    walk: float = 0.0,
    initial: ArrayLike | None = None,
    initial_variance: ArrayLike = 25.0,
) -> Filtered:
    """Filter a record.

    walk: variance that unknown inputs d gain per unit of time, and that impulses add to H g;
    initial: x at the first row, 0 by default, d being 0; initial_variance: of x, (n,) or one
    number, and the largest of them of each of d. Of a measurement what is there is used.
    The noise of y is output.noise_std, and uniform in output.noise_bound. Parameters are in the
    middle of their ranges.
    """
    rows, plant = list(samples), nominal_plant(plant)
    n, q = plant.n, 0 if plant.flow.D is None else plant.flow.D.shape[1]
    variance = np.broadcast_to(np.asarray(initial_variance, dtype=np.float64), n)
    now = _Moments(np.zeros(n + q), np.diag([*variance, *np.full(q, variance.max())]))
    if initial is not None:
        now.z[:n] = initial
    plants = [plant.in_mode(k) for k in range(len(plant.modes))] or [plant]
    steps = [_Steps(own, walk) for own in plants]
    place = _place(plant, rows[0].mode if rows else None)
    R, means, log_likelihood = _noise(plant, rows), [], 0.0
    u = np.zeros(0 if plant.flow.B is None else plant.flow.B.shape[1])
    after = plant.sees_after
    for k, row in enumerate(rows):
        if k:
            now = steps[place].flow(now, row.t - rows[k - 1].t, u)
        for there in (~after, after) if row.jump else (np.ones(plant.p, bool),):
            if row.jump and there is after:
                now = steps[place].jump(now, row)
            now, gained = _measured(now, row, plants[place], R, there)
            log_likelihood += gained
        now, place = _entered(now, plant, place, row.mode)
        u = u if row.u is None else np.asarray(row.u, dtype=np.float64)
        means.append(now.z)
    states = np.array(means).reshape(len(rows), n + q)
    return Filtered(np.array([row.t for row in rows]), states[:, :n], states[:, n:], log_likelihood)


def _place(plant: Plant, mode: str | None) -> int:
    """The place of a mode among those of a plant; the first without a name."""
    names = [one.name for one in plant.modes]
    return names.index(mode) if mode in names else 0


def _entered(
    now: _Moments, plant: Plant, place: int, mode: str | None
) -> tuple[_Moments, int]:  # fmt: skip
    """The moments after a row's change of mode, and the place of the mode; None: no change."""
    following = place if mode is None else _place(plant, mode)
    G = None if following == place else plant.modes[following].entry_map
    if G is None:
        return now, following
    move = np.eye(len(now.z))
    move[: len(G), : len(G)] = G
    return _Moments(move @ now.z, move @ now.P @ move.T), following


def tuned_walk(
    plant: Plant,
    samples: Sequence[Sample],
    *,
    initial: ArrayLike | None = None,
    initial_variance: ArrayLike = 25.0,
) -> float:
    """The walk, a power of ten, of maximum likelihood; 0 where no input or impulse is unknown."""
    unknown_impulses = any(event.H is not None for event in plant.events)
    if plant.flow.D is None and not unknown_impulses:
        return 0.0
    rows = samples[:_MOST_ROWS]

    def likelihood(walk: float) -> float:
        filtered = kalman_filter(
            plant, rows, walk=walk, initial=initial, initial_variance=initial_variance
        )
        return filtered.log_likelihood

    tried = [(likelihood(walk), walk) for walk in np.power(10.0, _TRIED).tolist()]
    return float(max(tried)[1])


def _noise(plant: Plant, rows: Sequence[Sample]) -> Matrix:
    output = plant.outputs
    y = np.array([row.y for row in rows if row.y is not None], dtype=np.float64)
    size = np.nan_to_num(np.sqrt(np.nanmean(y**2, axis=0))) if y.size else np.ones(plant.p)
    bound = 0.0 if output.noise_radius is None else output.noise_radius
    variance = output.noise_std**2 + bound**2 / 3 + (output.noise_cv * size) ** 2
    least = (_LEAST_NOISE * np.where(size > 0, size, 1.0)) ** 2
    return np.diag(np.maximum(variance, least))


def _measured(
    now: _Moments, row: Sample, plant: Plant, R: Matrix, used: NDArray[np.bool_]
) -> tuple[_Moments, float]:
    """The moments after what there is of a measurement, and its log-likelihood; used (p,)."""
    if row.y is None:
        return now, 0.0
    centre = plant.outputs.noise_centre
    y = np.asarray(row.y, dtype=np.float64) - (0.0 if centre is None else centre)
    there = np.isfinite(y) & used
    if not there.any():
        return now, 0.0
    return _update(now, y[there], plant.outputs.C[there], R[np.ix_(there, there)])


def _update(now: _Moments, y: Matrix, C: Matrix, R: Matrix) -> tuple[_Moments, float]:
    """The moments after a measurement, and its log-likelihood."""
    output = np.hstack([C, np.zeros((len(C), len(now.z) - C.shape[1]))])
    S = output @ now.P @ output.T + R
    S += _ROUNDING * float(S.diagonal().max()) * np.eye(len(y))  # or rounding makes it singular
    residual = y - output @ now.z
    gain = np.linalg.solve(S, output @ now.P).T
    kept = np.eye(len(now.z)) - gain @ output
    P = kept @ now.P @ kept.T + gain @ R @ gain.T  # symmetric and positive, whatever the rounding
    size = np.linalg.slogdet(S)[1] + len(y) * np.log(2 * np.pi)
    log_likelihood = -0.5 * float(residual @ np.linalg.solve(S, residual) + size)
    return _Moments(now.z + gain @ residual, P), log_likelihood


class _Steps:
    """Prediction of the moments; matrices of equal steps are made once."""

    def __init__(self, plant: Plant, walk: float) -> None:
        flow, n = plant.flow, plant.n
        self.plant, self.walk, self.n = plant, walk, n
        self.D = np.zeros((n, 0)) if flow.D is None else flow.D
        self.B = np.zeros((n, 0)) if flow.B is None else flow.B
        columns = flow.disturbance_columns
        self.middle = columns @ (flow.lower + flow.upper) / 2
        self.covariance = _covariance(columns, flow.lower, flow.upper)
        self.cache: dict[float, _Maps] = {}

    def flow(self, now: _Moments, h: float, u: Matrix) -> _Moments:
        """Over h units of time with u held."""
        key = round(h, 12)
        if key not in self.cache:
            self.cache[key] = self._matrices(h)
        move, known, drift, Q = self.cache[key]
        return _Moments(move @ now.z + known @ u + drift, move @ now.P @ move.T + Q)

    def _matrices(self, h: float) -> _Maps:
        dt = self.plant.flow.dt
        return self._of_flow(h) if dt is None else self._of_steps(rounded_steps(h, dt), dt)

    def _of_steps(self, count: int, dt: float) -> _Maps:
        """Of so many steps of discrete time."""
        n, q = self.D.shape
        once = np.eye(n + q)
        once[:n] = np.hstack([self.plant.flow.A, self.D])
        inputs = np.pad(self.B, ((0, q), (0, 0)))
        own, added = np.pad(self.middle, (0, q)), np.pad(self.covariance, (0, q))
        added[n:, n:] = dt * self.walk * np.eye(q)
        whole: _Maps = (np.eye(n + q), 0.0 * inputs, 0.0 * own, 0.0 * added)
        for bit in bin(count)[2:]:
            whole = _after(whole, whole)
            whole = _after(whole, (once, inputs, own, added)) if bit == "1" else whole
        return whole

    def _of_flow(self, h: float) -> _Maps:
        n, q = self.D.shape
        inputs = np.hstack([self.D, self.B, np.eye(n)])
        block = np.zeros((n + inputs.shape[1],) * 2)
        block[:n] = np.hstack([self.plant.flow.A, inputs]) * h
        whole = expm(block)[:n, n:]
        move = np.eye(n + q)
        move[:n] = np.hstack([expm(self.plant.flow.A * h), whole[:, :q]])
        forced = np.zeros((n + q, whole.shape[1] - q))
        forced[:n] = whole[:, q:]
        known, held = np.split(forced, [self.B.shape[1]], axis=1)
        Q = held @ self.covariance @ held.T
        Q[n:, n:] += h * self.walk * np.eye(q)
        for event in self.plant.events:
            if event.H is not None:
                Q[:n, :n] += h * self.walk * event.H @ event.H.T
        return move, known, held @ self.middle, Q

    def jump(self, now: _Moments, row: Sample) -> _Moments:
        """Through the events of a row."""
        first = 0
        w = None if row.w is None else np.asarray(row.w, dtype=np.float64)
        for k, event in enumerate(self.plant.events):
            last = first + event.inputs
            if k in (row.events or (0,)):
                now = self._event(now, event, None if w is None else w[first:last])
            first = last
        return now

    def _event(self, now: _Moments, jump: Jump, w: Matrix | None) -> _Moments:
        """Through one event with known inputs w."""
        n = self.n
        G = np.eye(len(now.z))
        G[:n, :n] = jump.G
        z = G @ now.z
        z[:n] += jump.disturbance_columns @ (jump.lower + jump.upper) / 2
        if jump.E is not None and w is not None:
            z[:n] += jump.E @ w
        P = G @ now.P @ G.T
        P[:n, :n] += _covariance(jump.disturbance_columns, jump.lower, jump.upper)
        return _Moments(z, P)


def _after(first: _Maps, second: _Maps) -> _Maps:
    """One prediction after another."""
    (move, known, drift, Q), (last, inputs, own, added) = first, second
    return last @ move, last @ known + inputs, last @ drift + own, last @ Q @ last.T + added


def _covariance(columns: Matrix, lower: Matrix, upper: Matrix) -> Matrix:
    """Covariance of columns @ w for independent w, each uniform between its bounds."""
    result: Matrix = (columns * ((upper - lower) ** 2 / 12)) @ columns.T
    return result
