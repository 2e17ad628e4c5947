"""Estimates in floats of what an error, or a state, comes to, for searches of gains.

    e' = F e + E d between jumps,   e+ = H e + K d at jumps,   |d| <= 1

Without jumps int_0^inf |e^(Fs) E| 1 ds. With jumps some sequences of dwell times are followed
backwards from jump to jump, signs and all, up to

    e = e^(F theta) H e- + e^(F theta) K d + int_0^theta e^(Fs) E d ds

at times theta after one; and norms |T e| that contract from jump to jump, as those proofs use them.
`lmi.bounds.driven_jumps` proves bounds that are somewhat larger.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius

# the flow: cells of this part of 1 / ||F||, so many of each length, each length twice the last
_REACH, _CELLS_LOG2, _STAGES, _DECAY = 0.05, 6, 40, 14.0
# a flow that does not decay is followed in cells no longer than this part of 1 / ||F||
_LONGEST, _MOST_CELLS = 0.8, 4096
# dwell times that are followed; jumps; what may be left of an error after so many of them, and
# what it may have grown to before
_DWELL_TIMES, _JUMPS, _LEFT, _GROWN = 5, 200, 1e-4, 1e8
# norms: parts of what the middle dwell time contracts by, which they leave out; doublings of the
# sum of their powers; how often bounds just before jumps follow from earlier ones
_SHARES, _DOUBLINGS, _REPEATS = (0.5, 0.9, 0.99), 12, 20
# sizes of states that hardly differ from zero count as this part of the largest
_LEAST = 1e-9
# times after a jump at which the error is looked at
_INSTANTS = 32


@dataclass(frozen=True)
class _Flow:
    """e^(Fs) in the middle of cells of time: flows (N, n, n), lengths and times (N,) of cells."""

    flows: Matrix
    lengths: Matrix
    times: Matrix

    def integrals(self, E: Matrix, T: Matrix | None = None) -> Matrix:
        """Integrals of |T e^(Fs) E| over each cell, (N, n, k); without T of |e^(Fs) E|."""
        states = self.flows @ E if T is None else T @ (self.flows @ E)
        result: Matrix = np.abs(states) * self.lengths[:, None, None]
        return result


def settled_bounds(F: Matrix, E: Matrix) -> Matrix:
    """Integrals of |e^(Fs) E| 1 over s >= 0, (n,); infinite where F is not Hurwitz."""
    flow = _flow(F, math.inf)
    if flow is None:
        return np.full(len(F), np.inf)
    result: Matrix = flow.integrals(E).sum(axis=(0, 2))
    return result


def estimated_bounds(
    flow: tuple[Matrix, Matrix], jump: tuple[Matrix, Matrix], ends: tuple[float, float]
) -> Matrix:
    """What |e| comes to, (n,): (F, E), (H, K), and shortest and longest dwell time.

    Infinite where it does not decay from jump to jump.
    """
    system = SampledJumps.from_matrices(flow, jump, ends)
    return np.full(len(flow[0]), np.inf) if system is None else system.bounds()


@dataclass(frozen=True)
class SampledJumps:
    """A driven error at some dwell times.

    flow: up to the longest one; flows (k, n, n): e^(F theta) at dwell times; added (N, n): what d
    adds between jumps up to the ends of cells, until (k, n): up to dwell times.
    """

    flow: _Flow
    flows: Matrix
    added: Matrix
    until: Matrix
    E: Matrix
    H: Matrix
    K: Matrix

    @staticmethod
    def from_matrices(
        flow: tuple[Matrix, Matrix], jump: tuple[Matrix, Matrix], ends: tuple[float, float]
    ) -> SampledJumps | None:
        """(F, E), (H, K), and shortest and longest dwell time; None where nothing is bounded."""
        (F, E), (H, K), (low, high) = flow, jump, ends
        decay = -_abscissa(F)
        end = min(high, low + _DECAY / decay) if decay > 0 else high
        course = _flow(F, end)
        if course is None or not np.isfinite(H).all():
            return None
        added = np.cumsum(course.integrals(E).sum(axis=2), axis=0)
        dwell_times = np.linspace(low, end, _DWELL_TIMES)
        flows, onwards = [expm(F * low)], expm(F * (dwell_times[1] - low))
        for _ in dwell_times[1:]:
            flows.append(onwards @ flows[-1])
        until = np.array([np.interp(dwell_times, course.times, row) for row in added.T]).T
        return SampledJumps(course, np.array(flows), added, until, E, H, K)

    def bounds(self) -> Matrix:
        """What |e| comes to, (n,); infinite where it does not decay from jump to jump."""
        shown = _spread(len(self.flow.times))
        later = self.flow.flows[shown]
        kicked = np.abs(self.K).sum(axis=1)
        views = np.concatenate([np.eye(len(self.H))[None], self.H[None], later @ self.H])
        adding = np.abs(later @ self.K).sum(axis=2) + self.added[shown]
        since = np.vstack([0 * kicked, kicked, adding])
        known = _before_jumps(self._maps, self._between, views)
        if known is None:
            return np.full(len(self.H), np.inf)
        for T in self.norms():
            known = np.minimum(known, self._within(T, views, known[0]))
        result: Matrix = (known + since).max(axis=0)
        return result

    def norms(self) -> list[Matrix]:
        """T (n, n) of norms |T e|: the map of the middle dwell time contracts in them."""
        sizes = self._between.max(axis=0)
        sizes = np.maximum(sizes, _LEAST * sizes.max() or 1.0)
        M = self._maps[len(self._maps) // 2] * sizes / sizes[:, None]
        radius, norms = spectral_radius(M), list[Matrix]()
        for share in _SHARES if radius < 1 else ():
            P, power = np.eye(len(M)), M / (1 - share * (1 - radius))
            for _ in range(_DOUBLINGS):
                P, power = P + power.T @ P @ power, power @ power
            try:
                norms.append(np.linalg.cholesky(P).T / sizes)
            except np.linalg.LinAlgError:  # it overflows
                continue
        return norms

    def contraction(self, T: Matrix) -> float:
        """What |T e| contracts by from jump to jump without d; infinite where it overflows."""
        maps = T @ self._maps @ np.linalg.inv(T)
        if not np.isfinite(maps).all():
            return math.inf
        return float(np.linalg.norm(maps, 2, axis=(1, 2)).max())

    @cached_property
    def _maps(self) -> Matrix:
        """From jump to jump, (k, n, n), for each dwell time."""
        result: Matrix = self.flows @ self.H
        return result

    @cached_property
    def _between(self) -> Matrix:
        """What d adds from jump to jump, (k, n)."""
        result: Matrix = np.abs(self.flows @ self.K).sum(axis=2) + self.until
        return result

    def _within(self, T: Matrix, views: Matrix, before: Matrix) -> Matrix:
        """The largest |X e-|, (v, n), for views X, by a norm; before (n,): a bound of |e-|."""
        gamma, back = self.contraction(T), np.linalg.inv(T)
        if not gamma < 1:
            return np.full(views.shape[:2], np.inf)
        pushed = self.flow.integrals(self.E, T).sum(axis=(0, 2))
        kicked = np.abs(T @ self.flows @ self.K).sum(axis=2).max(axis=0)
        radius = float(np.linalg.norm(pushed + kicked)) / (1 - gamma)
        turned = radius * np.linalg.norm(self._maps @ back, axis=2)
        r = np.minimum(before, radius * np.linalg.norm(back, axis=1))
        for _ in range(_REPEATS):
            reached = np.minimum(np.abs(self._maps) @ r, turned) + self._between
            r = np.minimum(r, reached.max(axis=0))
        result: Matrix = np.minimum(
            np.abs(views) @ r, radius * np.linalg.norm(views @ back, axis=2)
        )
        return result


def _spread(count: int) -> Matrix:
    """Numbers below a count, at most `_INSTANTS` of them, the last one included."""
    return np.unique(np.linspace(0, count - 1, _INSTANTS).round()).astype(np.int64)


def _before_jumps(maps: Matrix, added: Matrix, views: Matrix) -> Matrix | None:
    """The largest |X e-|, (v, n), for views X (v, n, n), over sequences of dwell times.

    None where some error does not decay. maps (k, n, n): from jump to jump, for each dwell time;
    added (k, n): what d adds.
    """
    sequences = _sequences(len(maps))
    (v, n, _), s = views.shape, len(sequences)
    product, rows = np.tile(np.eye(n), (s, 1, 1)), views.reshape(v * n, n)
    total = np.zeros((v, n, s))
    for place in range(_JUMPS):
        chosen = sequences[:, place]
        columns = product.transpose(1, 0, 2).reshape(n, s * n)  # one product for all views
        effect = np.abs(rows @ columns).reshape(v, n, s, n) * added[chosen]
        total = total + effect.sum(axis=3)
        product = product @ maps[chosen]
        size = float(np.abs(product).max(initial=0.0))
        if not size < _GROWN:
            return None
        if size < _LEFT:
            result: Matrix = total.max(axis=2)
            return result
    return None


def _sequences(count: int) -> Matrix:
    """Numbers of dwell times, jump by jump: each one for ever, two in turn, and drawn ones."""
    numbers = range(count)
    words = [*((i, i) for i in numbers), *itertools.permutations(numbers[:: count - 1 or 1], 2)]
    periodic = [list(itertools.islice(itertools.cycle(word), _JUMPS)) for word in words]
    drawn = np.random.default_rng(0).integers(0, count, (2, _JUMPS))
    return np.vstack([np.array(periodic), drawn])


def _flow(F: Matrix, end: float) -> _Flow | None:
    """The flow up to a time, where it is infinite until it has decayed; None where it does not."""
    size, decay = float(np.abs(F).sum(axis=1).max()), -_abscissa(F)
    if not np.isfinite(size) or (math.isinf(end) and not decay > 0):
        return None
    unit = np.eye(len(F))
    if size == 0 or end == 0:
        return _Flow(unit[None], np.array([end]), np.array([end]))
    longest = math.inf if decay > 0 else max(_LONGEST / size, end / _MOST_CELLS)
    length, time, start = min(_REACH / size, end), 0.0, unit
    flows, lengths, half = list[Matrix](), list[Matrix](), expm(F * length / 2)
    for _ in itertools.count() if math.isfinite(end) else range(_STAGES):
        whole = half @ half
        states, onwards = (half @ start)[None], whole
        for _ in range(_CELLS_LOG2):
            states, onwards = np.concatenate([states, onwards @ states]), onwards @ onwards
        flows.append(states)
        lengths.append(np.full(len(states), length))
        start, time = onwards @ start, time + length * len(states)
        if time >= end or (math.isinf(end) and decay * time > _DECAY):
            break
        if 2 * length <= longest:
            length, half = 2 * length, whole
    spans = np.concatenate(lengths)
    times = np.cumsum(spans)
    kept = times - spans < end
    return _Flow(np.concatenate(flows)[kept], spans[kept], times[kept])


def _abscissa(F: Matrix) -> float:
    return float(np.linalg.eigvals(F).real.max()) if np.isfinite(F).all() else math.inf
