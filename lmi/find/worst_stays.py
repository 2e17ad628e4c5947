"""The worst cycle of modes and stays: the one whose product has the largest spectral radius.

Two modes in turn are tried on a fine grid of their two stays: peaks of the radius are narrow.
Longer cycles come from a beam search over few stays. Gradient steps then move the stays. Floats
only: `lmi.refute.stays` proves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import to_float
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import finite_spectral_radii
from lmi.find.product_growth import growth_loss
from lmi.modes import Modes, StayWord
from lmi.time_budget import UNLIMITED, TimeBudget

# points of the grid of two stays; fewer of them for large matrices
_PAIR_POINTS, _PAIR_WORK = 200, 640_000
_LETTERS, _WIDTH, _LONGEST = 9, 150, 8
_POLISHED = 6


@dataclass(frozen=True)
class GrowingWord:
    """A cycle, and the spectral radius of its product (float)."""

    word: StayWord
    radius: float


def worst_stays(
    modes: Modes, seeds: Sequence[tuple[int, float]] = (), *, budget: TimeBudget = UNLIMITED
) -> GrowingWord | None:
    """The cycle with the largest growth for each of its stays; None where there is no cycle.

    seeds: (mode, stay) to try besides a grid's. Infinite ranges are cut where nothing is left.
    """
    search = _Search.from_modes(modes)
    candidates = [*search.pairs(), *search.beam(seeds)]
    candidates.sort(key=lambda entry: -entry[0])
    best: GrowingWord | None = None
    for _, word in candidates[:_POLISHED]:
        if best is not None and budget.remaining() < 0:
            break
        tried = search.polished(word)
        if best is None or search.growth(tried.word) > search.growth(best.word):
            best = tried
    return best


def followed(modes: Modes, word: StayWord) -> GrowingWord:
    """The cycle with the same modes and the largest growth near this one, for other ranges."""
    search = _Search.from_modes(modes)
    clipped = tuple(
        (i, float(min(max(theta, search.ends[i][0]), search.ends[i][1]))) for i, theta in word
    )
    return search.polished(clipped)


def _primitive(word: StayWord) -> StayWord:
    """The shortest word of which this one is a repetition: it grows alike."""
    k = len(word)
    return next(word[:p] for p in range(1, k + 1) if k % p == 0 and word[:p] * (k // p) == word)


@dataclass(frozen=True)
class _Search:
    modes: Modes
    flows: Array
    entry: Array
    ends: tuple[tuple[float, float], ...]

    @classmethod
    def from_modes(cls, modes: Modes) -> _Search:
        flows, entry = (np.array([to_float(M) for M in own]) for own in (modes.flows, modes.entry))
        ends = tuple(
            (low, last) for (low, _), last in zip(modes.stays, modes.horizons, strict=True)
        )
        return cls(modes, flows, entry, ends)

    def maps(self, mode: int, thetas: Array) -> Array:
        """e^{F theta} G of a mode, (k, n, n)."""
        return np.asarray(expm(self.flows[mode] * thetas[:, None, None]) @ self.entry[mode])

    def points(self, mode: int, count: int) -> Array:
        """Stays of a grid: half of them within two turns of the fastest mode after the shortest."""
        low, last = self.ends[mode]
        speed = float(np.abs(np.linalg.eigvals(self.flows[mode])).max())
        near = min(last, low + 4 * np.pi / max(speed, 1e-300))
        return np.unique(
            [*np.linspace(low, near, count // 2), *np.linspace(near, last, count - count // 2)]
        )

    def pairs(self) -> list[tuple[float, StayWord]]:
        """The best cycles of two modes on a grid of both stays, by growth per stay."""
        n, following = self.flows.shape[-1], self.modes.following
        count = max(min(_PAIR_POINTS, int((_PAIR_WORK / n**3) ** 0.5 * 2)), 20)
        best: list[tuple[float, StayWord]] = []
        for i in range(len(self.modes)):
            for j in (j for j in following[i] if j > i and i in following[j]):
                first, second = (self.points(k, count) for k in (i, j))
                products = self.maps(j, second)[:, None] @ self.maps(i, first)[None]
                radii = finite_spectral_radii(products)
                for row, column in _peaks(radii):
                    word = ((i, float(first[column])), (j, float(second[row])))
                    best.append((float(radii[row, column]) ** 0.5, word))
        return sorted(best, key=lambda entry: -entry[0])[: 2 * _POLISHED]

    def beam(self, seeds: Sequence[tuple[int, float]]) -> list[tuple[float, StayWord]]:
        """Cycles of few stays, largest norms kept at each length; the fastest growing of each."""
        letters = [
            (i, float(theta))
            for i, (low, last) in enumerate(self.ends)
            for theta in np.unique([*np.linspace(low, last, _LETTERS), *(
                min(max(t, low), last) for mode, t in dict.fromkeys(seeds) if mode == i)])
        ]  # fmt: skip
        mode_of = np.array([i for i, _ in letters])
        maps = np.concatenate([self.maps(i, np.array([theta])) for i, theta in letters])
        allowed = np.array([[b in self.modes.following[a] for b in mode_of] for a in mode_of])
        words, products = np.arange(len(letters))[:, None], maps
        candidates: list[tuple[float, StayWord]] = []
        for length in range(1, _LONGEST + 1):
            closed = allowed[words[:, -1], words[:, 0]]
            growth = np.where(closed, finite_spectral_radii(products) ** (1.0 / length), 0.0)
            for k in np.argsort(-growth)[:2]:
                if closed[k]:
                    candidates.append((float(growth[k]), tuple(letters[x] for x in words[k])))
            keep = np.argsort(-np.linalg.norm(products, axis=(1, 2)))[:_WIDTH]
            word, letter = np.nonzero(allowed[words[keep, -1]])
            products = maps[letter] @ products[keep[word]]
            words = np.concatenate([words[keep[word]], letter[:, None]], axis=1)
            if not len(words):
                break
        return candidates

    def growth(self, word: StayWord) -> float:
        """Growth for each stay of a cycle, a float."""
        return float(np.exp(-self._loss(word, np.array([theta for _, theta in word]))[0]))

    def polished(self, word: StayWord) -> GrowingWord:
        """Projected quasi-Newton ascent of the radius in all stays at once."""
        from scipy.optimize import minimize

        start = np.array([theta for _, theta in word])
        bounds = [self.ends[i] for i, _ in word]
        result = minimize(
            lambda x: self._loss(word, x), start, jac=True, bounds=bounds, method="L-BFGS-B",
            options={"maxiter": 100, "ftol": 1e-15, "gtol": 1e-12},
        )  # fmt: skip
        better = tuple(
            (i, float(min(max(theta, low), last)))
            for (i, _), theta, (low, last) in zip(word, result.x, bounds, strict=True)
        )
        best = _primitive(max(word, better, key=self.growth))
        return GrowingWord(best, self.growth(best) ** len(best))

    def _loss(self, word: StayWord, thetas: Array) -> tuple[float, Array]:
        """-log rho / length and its gradient."""
        maps = [
            self.maps(i, np.array([theta]))[0] for (i, _), theta in zip(word, thetas, strict=True)
        ]
        # M = e^{F theta} G: dM = F M
        return growth_loss(maps, lambda i, before: (self.flows[word[i][0]], before[i + 1]))


def _peaks(values: Array) -> list[tuple[int, int]]:
    """The highest local maxima of a table, its edges included."""
    padded = np.pad(values, 1, constant_values=-np.inf)
    rows, columns = values.shape
    shifts = [(a, b) for a in (0, 1, 2) for b in (0, 1, 2) if (a, b) != (1, 1)]
    is_peak = np.all([values >= padded[a : a + rows, b : b + columns] for a, b in shifts], axis=0)
    places = np.argwhere(is_peak)
    order = np.argsort(-values[is_peak])[: 2 * _POLISHED]
    return [(int(places[k][0]), int(places[k][1])) for k in order]
