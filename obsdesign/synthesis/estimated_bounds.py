"""Estimates in floats of what an error, or a state, comes to, for searches of gains.

    e' = F e + E d between jumps,   e+ = H e + K d at jumps,   |d| <= 1

Without jumps int_0^inf |e^(Fs) E| 1 ds. With jumps some sequences of dwell times are followed
backwards from jump to jump, signs and all, up to

    e = e^(F theta) H e- + e^(F theta) K d + int_0^theta e^(Fs) E d ds

at times theta after one. `lmi.bounds.driven_jumps` proves bounds that are somewhat larger.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm

# the flow: cells of this part of 1 / ||F||, so many of each length, each length twice the last
_REACH, _CELLS_LOG2, _STAGES, _DECAY = 0.05, 6, 40, 14.0
# a flow that does not decay is followed in cells no longer than this part of 1 / ||F||
_LONGEST, _MOST_CELLS = 0.8, 4096
# dwell times that are followed; jumps; and what may be left of an error after so many of them
_DWELL_TIMES, _JUMPS, _LEFT = 5, 200, 1e-4
# times after a jump at which the error is looked at
_INSTANTS = 32


@dataclass(frozen=True)
class _Flow:
    """e^(Fs) in the middle of cells of time: flows (N, n, n), lengths and times (N,) of cells."""

    flows: Matrix
    lengths: Matrix
    times: Matrix

    def integrals(self, E: Matrix) -> Matrix:
        """Integrals of |e^(Fs) E| over each cell, (N, n, k)."""
        result: Matrix = np.abs(self.flows @ E) * self.lengths[:, None, None]
        return result


def settled_bounds(F: Matrix, E: Matrix) -> Matrix:
    """Integrals of |e^(Fs) E| 1 over s >= 0, (n,); infinite where F is not Hurwitz."""
    flow = _flow(F, math.inf)
    if flow is None:
        return np.full(len(F), np.inf)
    result: Matrix = flow.integrals(E).sum(axis=(0, 2))
    return result


def driven_bounds(
    flow: tuple[Matrix, Matrix], jump: tuple[Matrix, Matrix], ends: tuple[float, float]
) -> Matrix:
    """What |e| comes to, (n,): (F, E), (H, K), and shortest and longest dwell time.

    Infinite where it does not decay from jump to jump.
    """
    (F, E), (H, K) = flow, jump
    infinite = np.full(len(F), np.inf)
    decay = -_abscissa(F)
    low, high = ends
    end = min(high, low + _DECAY / decay) if decay > 0 else high
    course = _flow(F, end)
    if course is None or not np.isfinite(H).all():
        return infinite
    added = np.cumsum(course.integrals(E).sum(axis=2), axis=0)
    dwell_times = np.linspace(low, end, _DWELL_TIMES)
    flows, onwards = [expm(F * low)], expm(F * (dwell_times[1] - low))
    for _ in dwell_times[1:]:
        flows.append(onwards @ flows[-1])
    maps = np.array(flows)
    until = np.array([np.interp(dwell_times, course.times, row) for row in added.T]).T
    kicked = np.abs(K).sum(axis=1)
    shown = _spread(len(course.times))
    views = np.concatenate([np.eye(len(F))[None], H[None], course.flows[shown] @ H])
    adding = np.abs(course.flows[shown] @ K).sum(axis=2) + added[shown]
    since = np.vstack([0 * kicked, kicked, adding])
    known = _before_jumps(maps @ H, np.abs(maps @ K).sum(axis=2) + until, views)
    if known is None:
        return infinite
    result: Matrix = (known + since).max(axis=0)
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
    product = np.tile(np.eye(maps.shape[1]), (len(sequences), 1, 1))
    total = np.zeros((len(views), len(sequences), maps.shape[1]))
    for place in range(_JUMPS):
        chosen = sequences[:, place]
        effect = np.abs(views[:, None] @ product) @ added[chosen][:, :, None]
        total = total + effect[..., 0]
        product = product @ maps[chosen]
        size = float(np.abs(product).max(initial=0.0))
        if not np.isfinite(size):
            return None
        if size < _LEFT:
            result: Matrix = total.max(axis=1)
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
