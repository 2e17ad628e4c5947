"""The worst sequence of dwell times: products of maps whose spectral radius is largest.

A beam search over a few dwell times proposes words, gradient steps move their dwell times; the
growth per jump is rho(M(theta_k) ... M(theta_1))^(1/k). Floats only: `lmi.spectral` proves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.families import Edge

Matrix = NDArray[Any]

_UNIFORM = 7
_WIDTH = 120
_LONGEST = 10
_POLISHED = 6
_RANDOM_STARTS = 4
_RANDOM_LENGTHS = (2, 3, 4, 5, 6)


@dataclass(frozen=True)
class Word:
    """Dwell times in the order in which they pass, and the growth per jump they cause (float)."""

    thetas: tuple[float, ...]
    growth: float


def worst_word(
    edge: Edge, L: Matrix, seeds: Sequence[float], rng: np.random.Generator, enough: float = 1.0
) -> Word:
    """The word with the largest growth found; stops early above `enough`.

    L: lower triangular, the search measures maps in the norm of P = L L'. seeds: dwell times to
    try besides uniform ones. An infinite range is cut at `edge.last`.
    """
    low, high = edge.low, edge.last
    uniform = np.linspace(low, high, _UNIFORM if high > low else 1)
    letters = np.unique(np.clip([*uniform, *seeds], low, high))
    words = _beam(edge, L, letters)
    best = words[0]
    lengths = _RANDOM_LENGTHS if high > low else ()
    starts = [Word(tuple(rng.uniform(low, high, k)), 0.0)
              for k in lengths for _ in range(_RANDOM_STARTS)]  # fmt: skip
    for word in [*words[:_POLISHED], *starts]:
        if best.growth > enough:
            break
        polished = _polish(edge, word)
        best = max(best, polished, key=lambda found: found.growth)
    return best


def _beam(edge: Edge, L: Matrix, letters: Matrix) -> list[Word]:
    """Words over the letters, longest norms kept at each length; the fastest growing first."""
    maps = L.T @ edge.maps(letters) @ np.linalg.inv(L).T
    products, words = maps, [(k,) for k in range(len(letters))]
    found: list[Word] = []
    for length in range(1, _LONGEST + 1):
        growth = _radii(products) ** (1.0 / length)
        top = np.argsort(-growth)[:_POLISHED]
        found += [Word(tuple(float(letters[i]) for i in words[k]), float(growth[k])) for k in top]
        keep = np.argsort(-np.linalg.norm(products, axis=(1, 2)))[:_WIDTH]
        products = (maps[:, None] @ products[keep][None]).reshape(-1, *maps.shape[1:])
        words = [(*words[k], i) for i in range(len(letters)) for k in keep]
    return sorted(found, key=lambda word: -word.growth)


def _radii(M: Matrix) -> Matrix:
    return np.asarray(np.abs(np.linalg.eigvals(M)).max(axis=-1, initial=0.0))


def _polish(edge: Edge, word: Word) -> Word:
    """Projected quasi-Newton ascent of log rho(product) / length in all dwell times at once."""
    from scipy.optimize import minimize

    if edge.last == edge.low:
        return word
    bounds = [(edge.low, edge.last)] * len(word.thetas)
    result = minimize(lambda thetas: _loss(edge, thetas), np.array(word.thetas), jac=True,
                      method="L-BFGS-B", bounds=bounds, options={"maxiter": 40})  # fmt: skip
    thetas = np.clip(result.x, edge.low, edge.last)
    polished = Word(tuple(float(theta) for theta in thetas), float(np.exp(-_loss(edge, thetas)[0])))
    return max(word, polished, key=lambda found: found.growth)


def _loss(edge: Edge, thetas: Matrix) -> tuple[float, Matrix]:
    """-log rho(M_k ... M_1) / k and its gradient: d lambda = y* dM x / (y* x)."""
    maps = edge.maps(thetas)
    k, n = len(maps), maps.shape[-1]
    before = [np.eye(n)]
    for M in maps:
        before.append(M @ before[-1])
    values, vectors = np.linalg.eig(before[-1])
    top = int(np.argmax(np.abs(values)))
    value, x = values[top], vectors[:, top]
    if abs(value) < 1e-280:
        return 1e3, np.zeros(k)
    lefts, left_vectors = np.linalg.eig(before[-1].T)
    y = left_vectors[:, int(np.argmin(np.abs(lefts - value)))]
    scale = value * (y @ x)
    if abs(scale) < 1e-280:
        return -float(np.log(abs(value))) / k, np.zeros(k)
    slope, after = np.zeros(k), y
    for i in reversed(range(k)):
        # M = left e^{F theta} H: its derivative is left F e^{F theta} H
        turned = edge.slopes(thetas[i : i + 1])[0]
        slope[i] = float(np.real(after @ turned @ before[i] @ x / scale))
        after = after @ maps[i]
    return -float(np.log(abs(value))) / k, -slope / k
