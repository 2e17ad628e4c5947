"""Cuts of windows, at dwell times that the multipliers of a failed search separate.

When no P fits the windows, the dual masses of the active dwell times say which ones a window
would have to tell apart. Every offset that a window knows, and the next one on either side, is
scored by how well a cut separates the masses: (m1 m2 / (m1 + m2)) |mean1 - mean2|.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.find.windows import Cutting, Links, Windows
from lmi.window_memory import AUTO, Memory

# windows whose best cut scores this share of the best of all are cut in the same round
_SHARE, _MOST = 0.15, 40
# masses below this share of the largest are rounding
LEAST_MASS_SHARE = 1e-6
# no cell is thinner than this share of the range
_THINNEST = 1e-4


@dataclass(frozen=True)
class Limits:
    """past, future: how many dwell times back and ahead windows may look."""

    past: float = math.inf
    future: float = math.inf

    @classmethod
    def from_memory(cls, memory: Memory) -> Limits:
        """So many dwell times on either side; AUTO: as many as it takes."""
        return cls() if memory == AUTO else cls(memory, memory)


def cuttings(
    windows: Windows,
    links: Links,
    owners: Indices,
    thetas: Matrix,
    masses: Matrix,
    *,
    last: float,
    limits: Limits,
) -> list[Cutting]:
    """Cuts of different windows, best first; none when no cut separates anything.

    owners, thetas, masses: (k,) edge, dwell time and dual mass of each active inequality. last:
    where an infinite range ends for this purpose.
    """
    strong = masses > LEAST_MASS_SHARE * masses.max(initial=0.0)
    evidence = _Evidence(windows, links, owners[strong], thetas[strong], masses[strong], last)
    best: dict[int, tuple[float, Cutting]] = {}
    for window in range(len(windows)):
        for offset in _offsets(windows, window, limits):
            score, where = evidence.best_cut(window, offset)
            if score > best.get(window, (0.0,))[0]:
                best[window] = score, Cutting(window, offset, where)
    ranked = sorted(best.values(), key=lambda entry: -entry[0])
    return [cutting for score, cutting in ranked if score >= _SHARE * ranked[0][0]][:_MOST]


def _offsets(windows: Windows, window: int, limits: Limits) -> range:
    past, future = windows.depths(window)
    return range(-int(min(past + 1, limits.past)), int(min(future + 1, limits.future)))


@dataclass(frozen=True)
class _Evidence:
    windows: Windows
    links: Links
    owners: Indices
    thetas: Matrix
    masses: Matrix
    last: float

    def best_cut(self, window: int, offset: int) -> tuple[float, float]:
        """(score, where) of the best cut of a window in one offset; score 0: there is none."""
        values, masses = self._weighted_thetas(window, offset)
        if len(values) < 2:
            return 0.0, math.nan
        values, group = np.unique(values, return_inverse=True)
        masses = np.bincount(group, masses).astype(np.float64)
        below, moment = np.cumsum(masses)[:-1], np.cumsum(masses * values)[:-1]
        above, moment_above = masses.sum() - below, (masses * values).sum() - moment
        scores = below * above / (below + above) * np.abs(moment / below - moment_above / above)
        low, high = self.windows.interval(window, offset)
        high = min(high, self.last)
        thinnest = _THINNEST * (self.last - self.windows.low)
        where = [_short(a, b) for a, b in itertools.pairwise(values)]
        fits = (np.array(where) > low + thinnest) & (np.array(where) < high - thinnest)
        if not fits.any():
            return 0.0, math.nan
        k = int(np.argmax(np.where(fits, scores, -1.0)))
        return float(scores[k]), float(where[k])

    def _weighted_thetas(self, window: int, offset: int) -> tuple[Matrix, Matrix]:
        """Dwell times at this offset of this window, and the masses they carry.

        The next map's theta is known as such. Other dwell times are known up to the interval that
        the window before, or after, gives them.
        """
        past = offset < 0
        ends = self.links.target if past else self.links.source
        mine = np.flatnonzero(ends[self.owners] == window)
        owners = self.owners[mine]
        if offset in (-1, 0):
            return self.thetas[mine], self.masses[mine]
        others = (self.links.source if past else self.links.target)[owners]
        shifted = offset + 1 if past else offset - 1
        known = self.windows.knows(shifted)[others]
        column = (offset + 1 if past else offset) - self.windows.first
        owners = owners[known]
        upper = np.minimum(self.links.upper[owners, column], self.last)
        return (self.links.lower[owners, column] + upper) / 2, self.masses[mine][known]


def _short(low: float, high: float) -> float:
    """A number with few binary digits in the middle of [low, high]."""
    step = 2.0 ** math.floor(math.log2(max(high - low, 1e-300) / 4))
    return round((low + high) / 2 / step) * step
