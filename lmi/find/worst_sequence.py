"""The worst sequence of dwell times: products of maps whose spectral radius is largest.

A beam search over a few dwell times proposes words, and so do long repeats of one dwell time
followed by repeats of another; gradient steps move their dwell times. The growth per jump is
rho(M(theta_k) ... M(theta_1))^(1/k). Floats only: `lmi.refute.spectral` proves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from lmi.arithmetic.spectrum import finite_spectral_radii
from lmi.families import Edge
from lmi.find.product_growth import growth_loss
from lmi.time_budget import UNLIMITED, TimeBudget

_UNIFORM = 7
_WIDTH = 120
_LONGEST = 10
_FINE = 60  # with little jitter, letters must be close together, but not more of them
_POLISHED = 6
_RANDOM_STARTS = 4
# Repeats: each number up to _MANY with up to _FEW of the other, one of so many partners, and powers
# of two up to 2^_DOUBLINGS, with so many numbers tried near the best
_MANY, _FEW, _PARTNERS, _DOUBLINGS, _BETWEEN = 48, 2, 25, 7, 12
# longer words repeat a few dwell times, which are moved together
_FREE = 2 * _LONGEST
_RANDOM_LENGTHS = (2, 3, 4, 5, 6)


@dataclass(frozen=True)
class Word:
    """Dwell times in the order in which they pass, and the growth per jump they cause (float)."""

    thetas: tuple[float, ...]
    growth: float


def worst_word(
    edge: Edge,
    L: Array,
    seeds: Sequence[float],
    rng: np.random.Generator,
    *,
    enough: float = 1.0,
    jitter: float = math.inf,
    budget: TimeBudget = UNLIMITED,
) -> Word:
    """The word with the largest growth found; stops early above `enough`.

    L: lower triangular, the search measures maps in the norm of P = L L'. seeds: dwell times to
    try besides uniform ones. jitter: largest change from one dwell time to the next, in the word
    repeated without end. An infinite range is cut at `edge.last`.
    """
    low, high = edge.low, edge.last
    count = _UNIFORM if high > low else 1
    if high > low and jitter < (high - low) / count:
        count = min(math.ceil(2 * (high - low) / max(jitter, 1e-300)) + 1, _FINE)
    letters = np.unique(np.clip([*np.linspace(low, high, count), *seeds], low, high))
    words = _beam(edge, L, letters, jitter)
    if jitter > 0 and len(letters) > 1:
        words = sorted([*words, *_repeats(edge, letters, jitter)], key=lambda word: -word.growth)
    best = words[0]
    lengths = _RANDOM_LENGTHS if high > low else ()
    starts = [Word(tuple(_random(rng, low, high, k, jitter)), 0.0)
              for k in lengths for _ in range(_RANDOM_STARTS)]  # fmt: skip
    for word in [*words[:_POLISHED], *starts]:
        if best.growth > enough or budget.remaining() < 0:
            break
        best = max(best, polished(edge, word, jitter), key=lambda candidate: candidate.growth)
    return replace(best, thetas=_primitive(best.thetas))


def _primitive(thetas: tuple[float, ...]) -> tuple[float, ...]:
    """The shortest word of which this one is a repetition: it grows alike."""
    k = len(thetas)
    periods = (p for p in range(1, k + 1) if k % p == 0)
    return next(thetas[:p] for p in periods if thetas[:p] * (k // p) == thetas)


def _random(
    rng: np.random.Generator, low: float, high: float, length: int, jitter: float
) -> list[float]:
    """Dwell times in the range; all within one `jitter` of each other."""
    if jitter < high - low:
        low = float(rng.uniform(low, high - jitter))
        high = low + jitter
    return [float(theta) for theta in rng.uniform(low, high, length)]


def _beam(edge: Edge, L: Array, letters: Array, jitter: float) -> list[Word]:
    """Words over the letters, longest norms kept at each length; the fastest growing first."""
    maps = L.T @ edge.maps(letters) @ np.linalg.inv(L).T
    near = np.abs(letters[:, None] - letters) <= jitter
    products, words = maps, np.arange(len(letters))[:, None]
    candidates: list[Word] = []
    for length in range(1, _LONGEST + 1):
        closed = near[words[:, -1], words[:, 0]]
        growth = np.where(closed, finite_spectral_radii(products) ** (1.0 / length), 0.0)
        top = np.argsort(-growth)[:_POLISHED]
        candidates += [Word(tuple(letters[words[k]].tolist()), float(growth[k])) for k in top]
        keep = np.argsort(-np.linalg.norm(products, axis=(1, 2)))[:_WIDTH]
        letter, word = np.nonzero(near[:, words[keep, -1]])
        products = maps[letter] @ products[keep[word]]
        words = np.concatenate([words[keep[word]], letter[:, None]], axis=1)
    return sorted(candidates, key=lambda word: -word.growth)


def _repeats(edge: Edge, letters: Array, jitter: float) -> list[Word]:
    """Words theta^i eta^j, theta an extremal letter: an end, or the one of the largest radius.

    A map that turns may take many jumps to bring a state to where another map stretches it, with
    sharp resonances: small numbers are all tried, with many eta. Larger ones are powers of two.
    """
    maps = edge.maps(letters)
    first = {0, len(letters) - 1, int(np.argmax(finite_spectral_radii(maps)))}
    partners = np.unique([*letters, *np.linspace(edge.low, edge.last, _PARTNERS)])
    others = edge.maps(partners)
    words = []
    for a in sorted(first):
        near = np.abs(partners - letters[a]) <= jitter
        words += _resonances(maps[a], float(letters[a]), others[near], partners[near])
    for a, b in itertools.combinations(sorted(first), 2):
        if abs(letters[a] - letters[b]) <= jitter:
            growth, i, j = _best_counts(maps[a], maps[b])
            words.append(_word(float(letters[a]), i, float(letters[b]), j, growth))
    return words


def _word(theta: float, i: int, eta: float, j: int, growth: float) -> Word:
    return Word((theta,) * i + (eta,) * j, growth)


def _resonances(M: Array, theta: float, others: Array, partners: Array) -> list[Word]:
    """The best words theta^i eta^j, i up to _MANY and j up to _FEW, of different i."""
    i = np.arange(1, _MANY + 1)
    powers, sizes = _powers(M, i)
    best: dict[int, Word] = {}
    for j in range(1, _FEW + 1):
        with np.errstate(all="ignore"):
            radii = finite_spectral_radii(np.linalg.matrix_power(others, j)[:, None] @ powers)
            growth = np.nan_to_num(np.exp((np.log(radii) + sizes) / (i + j)))
        for k, eta in enumerate(growth.argmax(axis=0)):
            word = _word(theta, int(i[k]), float(partners[eta]), j, float(growth[eta, k]))
            best[k] = max(best.get(k, word), word, key=lambda word: word.growth)
    return sorted(best.values(), key=lambda word: -word.growth)[:_POLISHED]


def _best_counts(A: Array, B: Array) -> tuple[float, int, int]:
    """Largest rho(B^j A^i)^(1 / (i + j)), i and j powers of two, then all integers near them."""
    counts = [1 << np.arange(_DOUBLINGS + 1)] * 2
    for _ in range(2):
        i, j = (np.ravel(k) for k in np.meshgrid(*counts))
        (first, size_a), (second, size_b) = _powers(A, i), _powers(B, j)
        with np.errstate(all="ignore"):
            growth = (np.log(finite_spectral_radii(second @ first)) + size_a + size_b) / (i + j)
        k = int(np.argmax(np.where(np.isfinite(growth), growth, -np.inf)))
        counts = [np.unique(np.linspace(3 * m // 4, 3 * m // 2, _BETWEEN).round()).astype(int)
                  for m in (i[k], j[k])]  # fmt: skip
        counts = [m[m > 0] for m in counts]
    return float(np.exp(growth[k])), int(i[k]), int(j[k])


def _powers(M: Array, exponents: Array) -> tuple[Array, Array]:
    """(M^k / e^size, size) for each exponent, sizes such that nothing overflows."""
    n, bits = len(M), int(exponents.max()).bit_length()
    results = np.tile(np.eye(n), (len(exponents), 1, 1))
    sizes, square, size = np.zeros(len(exponents)), M, 0.0
    for bit in range(bits):
        norm = float(np.linalg.norm(square))
        if not 0 < norm < np.inf:
            return results * 0, sizes
        square, size = square / norm, size + math.log(norm)
        used = (exponents >> bit) & 1 == 1
        results[used] = square @ results[used]
        sizes[used] += size
        square, size = square @ square, 2 * size
    return results, sizes


def polished(edge: Edge, word: Word, jitter: float = math.inf) -> Word:
    """Projected quasi-Newton ascent of log rho(product) / length in all dwell times at once."""
    from scipy.optimize import minimize

    word = replace(word, growth=_growth(edge, np.array(word.thetas)))
    if edge.last == edge.low:
        return word
    thetas = np.array(word.thetas)
    start, index = (thetas, np.arange(len(thetas)))
    if len(thetas) > _FREE:
        start, index = np.unique(thetas, return_inverse=True)
    spread = np.eye(len(start))[index]
    bounds = [(edge.low, edge.last)] * len(start)
    how: NewEntries = {"method": "L-BFGS-B", "options": {"maxiter": 40}}
    if jitter < edge.last - edge.low:
        change = np.roll(spread, -1, axis=0) - spread
        both = np.concatenate([change, -change])
        room = {"type": "ineq", "fun": lambda x: jitter - both @ x, "jac": lambda x: -both}
        how = {"method": "SLSQP", "options": {"maxiter": 40}, "constraints": [room]}

    def loss(x: Array) -> tuple[float, Array]:
        value, slope = _loss(edge, spread @ x)
        return value, slope @ spread

    result = minimize(loss, start, jac=True, bounds=bounds, **how)
    thetas = _within(np.clip(spread @ result.x, edge.low, edge.last), jitter)
    better = Word(tuple(float(theta) for theta in thetas), _growth(edge, thetas))
    return max(word, better, key=lambda candidate: candidate.growth)


def _growth(edge: Edge, thetas: Array) -> float:
    return float(np.exp(-_loss(edge, thetas)[0]))


def _within(thetas: Array, jitter: float) -> Array:
    """Drawn together until no step exceeds `jitter`: solvers and rounding overstep a little."""
    step = float(np.abs(thetas - np.roll(thetas, 1)).max())
    if step <= jitter:
        return thetas
    centre = float(thetas.mean())
    return np.asarray(centre + (thetas - centre) * (jitter / step) * (1 - 1e-12))


def _loss(edge: Edge, thetas: Array) -> tuple[float, Array]:
    """-log rho(M_k ... M_1) / k and its gradient."""
    maps, slopes = edge.with_slopes(thetas)
    return growth_loss(list(maps), lambda i, before: (slopes[i], before[i]))
