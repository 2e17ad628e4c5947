"""Parameters and dwell times under which a product of maps grows fastest: bang-bang words.

Signs on a grid of time come from `lmi.find.parameter_signs`; the switching times of the best are
then moved by gradients. Floats only: `lmi.refute.parameter_words` proves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.exponential import expm
from lmi.families import horizon
from lmi.find.parameter_signs import Signs, SignSearch
from lmi.find.product_growth import growth_loss
from lmi.parameters import AffineFamily, Point
from lmi.refute.parameter_words import Stay
from lmi.time_budget import UNLIMITED, TimeBudget

_JUMPS = (1, 2, 3)
_POLISHED = 5
# pieces of constant p in each stay, whose switching times are moved
_PIECES = 8
# durations are multiples of this many bits of the longest stay, so that their sums are exact
_BITS = 34
_ENOUGH = 1 + 1e-6
_SEED = 20163  # the search repeats itself exactly


@dataclass(frozen=True)
class BangBang:
    """A word of stays, and its growth per jump (float); of a flow without jumps that of a cycle."""

    word: tuple[Stay, ...]
    growth: float


def worst_switching(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> BangBang | None:
    """The fastest growing word of few jumps; stops early above a growth of one.

    None where floats overflow. With high infinite, flows without jumps are words as well.
    """
    rng, best = np.random.default_rng(_SEED), None
    for search in _searches(family, low, high):
        for signs in search.best(rng, _POLISHED):
            if best is not None and (best.growth > _ENOUGH or budget.remaining() < 0):
                return best
            tried = _Polish(search, _stays(search, signs)).polished()
            if tried is not None and (best is None or tried.growth > best.growth):
                best = tried
    return best


def followed(family: AffineFamily, low: float, high: float, word: Sequence[Stay]) -> BangBang:
    """The word with the same parameters and the largest growth near this one, for other ranges."""
    has_jumps = word[0].jump is not None
    search = next(s for s in _searches(family, low, high)[::-1] if s.has_jumps == has_jumps)
    fitted = tuple(_fitted(stay, search.ends) for stay in word)
    polished = _Polish(replace(search, jumps=len(word)), fitted).polished()
    return polished or BangBang(fitted, 0.0)


def _searches(family: AffineFamily, low: float, high: float) -> list[SignSearch]:
    A, G = family.floats()
    constant = np.array(family.is_constant, dtype=bool)
    last = high if math.isfinite(high) else low + horizon(A[0])
    searches = [SignSearch(A, G, constant, (low, last), jumps) for jumps in _JUMPS]
    if math.isinf(high):
        # cycles of a flow take part of a turn of a mode, or its time constant, or a few of them
        speeds = np.unique(np.round(np.abs(np.linalg.eigvals(A[0])), 12))
        for speed in speeds[speeds > 0]:
            ends = (0.5 / float(speed), 4 * math.pi / float(speed))
            searches.append(SignSearch(A, G, constant, ends, jumps=1, has_jumps=False))
    return searches


def _stays(search: SignSearch, signs: Signs) -> tuple[Stay, ...]:
    """A start as a word: equal p in a row are one piece."""
    stays = []
    for theta, p in zip(signs.thetas[0], signs.p[0], strict=True):
        step = float(theta) / (len(p) - 1)
        runs = itertools.groupby(tuple(row) for row in p[1:].tolist())
        pieces = [(point, step * len(list(run))) for point, run in runs]
        jump = tuple(p[0].tolist()) if search.has_jumps else None
        stays.append(Stay(jump, tuple(_merged(pieces))))
    return tuple(stays)


def _merged(pieces: list[tuple[Point, float]]) -> list[tuple[Point, float]]:
    """At most _PIECES of them: the shortest join the longer one of their neighbours."""
    pieces = list(pieces)
    while len(pieces) > _PIECES:
        k = min(range(len(pieces)), key=lambda i: pieces[i][1])
        near = [i for i in (k - 1, k + 1) if 0 <= i < len(pieces)]
        into = max(near, key=lambda i: pieces[i][1])
        pieces[into] = (pieces[into][0], pieces[into][1] + pieces[k][1])
        del pieces[k]
    return pieces


def _fitted(stay: Stay, ends: tuple[float, float]) -> Stay:
    """The same parameters, with a dwell time in the range."""
    total = sum(duration for _, duration in stay.flow)
    wanted = min(max(total, ends[0]), ends[1])
    share = wanted / total if total > 0 else 0.0
    flow = tuple((p, duration * share) for p, duration in stay.flow)
    if total == 0 and wanted > 0:
        flow = ((stay.flow[0][0], wanted), *flow[1:])
    return Stay(stay.jump, flow)


@dataclass(frozen=True)
class _Polish:
    """A word whose durations are moved, all at once, within the range of dwell times."""

    search: SignSearch
    word: tuple[Stay, ...]

    def polished(self) -> BangBang | None:
        """The best of the word and of a quasi-Newton ascent from it; None where floats overflow."""
        from scipy.optimize import minimize

        low, last = self.search.ends
        start = np.array([duration for stay in self.word for _, duration in stay.flow])
        sums = np.array([[float(k == j) for j, stay in enumerate(self.word) for _ in stay.flow]
                         for k in range(len(self.word))])  # fmt: skip
        candidates = [start]
        if last > 0:
            both, ends = np.concatenate([sums, -sums]), np.repeat([low, -last], len(sums))
            room = {"type": "ineq", "fun": lambda d: both @ d - ends, "jac": lambda d: both}
            result = minimize(
                self._loss, start, jac=True, bounds=[(0.0, last)] * len(start), method="SLSQP",
                constraints=[room], options={"maxiter": 60, "ftol": 1e-12},
            )  # fmt: skip
            if np.isfinite(result.x).all():
                candidates.append(result.x)
        words = [self._exact(durations) for durations in candidates]
        rated = [BangBang(word, self._growth(word)) for word in words]
        best = max(rated, key=lambda entry: entry.growth)
        return best if math.isfinite(best.growth) and best.growth > 0 else None

    def _growth(self, word: Sequence[Stay]) -> float:
        durations = np.array([duration for stay in word for _, duration in stay.flow])
        fixed = replace(self, word=tuple(word))
        return math.exp(-fixed._loss(durations)[0])

    def _loss(self, durations: Array) -> tuple[float, Array]:
        """-log of the growth per jump, and its gradient."""
        A, G = self.search.A, self.search.G
        flows, maps, k = [], [], 0
        for stay in self.word:
            entry = np.eye(len(G[0])) if stay.jump is None else _at(G, stay.jump)
            for p, _ in stay.flow:
                flows.append(_at(A, p))
                with np.errstate(all="ignore"):
                    maps.append(expm(flows[-1] * max(float(durations[k]), 0.0)) @ entry)
                entry, k = np.eye(len(G[0])), k + 1
        share = len(maps) / len(self.word)
        value, slope = growth_loss(maps, lambda i, before: (flows[i], before[i + 1]))
        return value * share, slope * share

    def _exact(self, durations: Array) -> tuple[Stay, ...]:
        """The word with these durations, rounded so that their sums are dwell times exactly."""
        low, last = self.search.ends
        unit = 2.0 ** (math.frexp(last)[1] - _BITS) if last > 0 else 1.0
        stays, k = [], 0
        for stay in self.word:
            own = np.maximum(durations[k : k + len(stay.flow)], 0.0)
            k += len(stay.flow)
            rounded, total = np.round(own / unit) * unit, float(own.sum())
            total = min(max(round(total / unit) * unit, low), last)
            longest = int(np.argmax(rounded))
            rounded[longest] += total - float(rounded.sum())
            pieces = [(p, float(t)) for (p, _), t in zip(stay.flow, rounded, strict=True)]
            kept = [piece for piece in pieces if piece[1] > 0] or pieces[:1]
            stays.append(Stay(stay.jump, tuple(kept)))
        return tuple(stays)


def _at(parts: Array, p: Point) -> Array:
    """A(p) or G(p) in floats."""
    return np.asarray(parts[0] + np.tensordot(np.array(p), parts[1:], 1))
