"""The part of a plant that an impulsive observer has to correct, in floats.

The smallest subspace V, invariant under A and G, whose quotient decays for all spacings: subspaces
with a decaying quotient are closed under intersection, and strong observability is inherited by
invariant subspaces, so that if any V serves, the smallest one does. Inside V the unobservable part
is left uncorrected as well.

Every decision has a margin: eigenvalues count as decaying below QUOTIENT_RATE per impulse only, and
ranks are decided in coordinates in which maps have entries of like size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.units import balance

_RANK = 1e-8
_SPACINGS, _WORDS = 5, 3
# entries so close to a multiple of 2^-10 are taken for it: bases of plants with simple numbers
_GRAIN, _CLOSE = 2.0**-10, 1e-11


@dataclass(frozen=True)
class Parts:
    """basis (n, n) = [hidden, core, rest], first: columns of hidden; size: those of the core."""

    basis: Matrix
    first: int
    size: int


@np.errstate(all="ignore")
def corrected_part(
    plant: tuple[Matrix, Matrix, Matrix], ends: tuple[float, float], factor: float
) -> Parts:
    """Basis in which A and G are block upper triangular, the middle block to be corrected.

    factor: per impulse, below which what is left alone counts as decaying.
    """
    (A, G, C), (low, high) = plant, ends
    n = len(A)
    units = balance(np.stack([np.abs(A) * high, G]))
    A, G = units[:, None] * A / units, units[:, None] * G / units
    C = C / units
    V = _refined(_growing(A, G, low, high, factor), (A, G), None)
    observed = _hull(np.linalg.qr(C.T)[0] if C.any() else np.zeros((n, 0)), (A.T, G.T), C.T)
    hidden = _refined(_intersection(_complement(observed), V), (A, G), C)
    core = _beyond(hidden, V)
    whole = _simple(np.hstack([hidden, core]))
    middle = _independent_of(hidden, whole, core.shape[1])
    complement = _independent_of(V, np.eye(n), n - V.shape[1])
    basis = np.hstack([_simple(hidden), middle, complement]) / units[:, None]
    return Parts(basis, hidden.shape[1], core.shape[1])


def _growing(A: Matrix, G: Matrix, low: float, high: float, factor: float) -> Matrix:
    """Orthonormal basis of the smallest joint-invariant subspace with a decaying quotient."""
    V = np.zeros((len(A), 0))
    while V.shape[1] < len(A):
        W = _complement(V)
        grown = _growing_directions(W.T @ A @ W, W.T @ G @ W, low, high, factor)
        if not grown.shape[1]:
            return V
        V = _hull(np.hstack([V, W @ grown]), (A, G), None)
    return V


def _growing_directions(A: Matrix, G: Matrix, low: float, high: float, factor: float) -> Matrix:
    """Generalised eigenspaces of words in e^{A delta} G that do not shrink by `factor` a letter."""
    from scipy.linalg import schur  # slow to import

    letters = [G @ expm(A * delta) for delta in np.linspace(low, high, _SPACINGS)]
    growing = np.zeros((len(A), 0))
    if not np.isfinite(letters).all():
        return np.eye(len(A))  # overflow: every direction counts as growing
    for length in range(1, _WORDS + 1):
        for word in _words(length):
            M = np.linalg.multi_dot([letters[i] for i in word]) if length > 1 else letters[word[0]]
            if not np.isfinite(M).all():
                return np.eye(len(A))
            limit = factor**length
            _, Q, count = schur(
                M, output="real", sort=lambda re, im, limit=limit: np.hypot(re, im) >= limit
            )
            growing = _span(np.hstack([growing, Q[:, :count]]))
    return growing


def _words(length: int) -> Iterator[tuple[int, ...]]:
    ends = (0, _SPACINGS // 2, _SPACINGS - 1)
    return product(range(_SPACINGS) if length == 1 else ends, repeat=length)


def _hull(V: Matrix, maps: tuple[Matrix, ...], first: Matrix | None) -> Matrix:
    """Orthonormal basis of the smallest subspace with V that all maps leave invariant."""
    basis = _span(V if first is None else first)
    while True:
        images = [X @ basis / max(float(np.linalg.norm(X)), 1e-300) for X in maps]
        larger = _span(np.hstack([basis, *images]))
        if larger.shape[1] == basis.shape[1]:
            return basis
        basis = larger


def _refined(V: Matrix, maps: tuple[Matrix, ...], zero: Matrix | None) -> Matrix:
    """The subspace V + W X next to span V that is invariant (and that `zero` maps to 0).

    One Newton step of the equations W' F (V + W X) = X V' F V, which hold up to squares of what
    is already small.
    """
    n, d = V.shape
    if d in (0, n):
        return V
    W = _complement(V)
    rows, right = [], []
    for F in maps:
        rows.append(np.kron(W.T @ F @ W, np.eye(d)) - np.kron(np.eye(n - d), (V.T @ F @ V).T))
        right.append(-(W.T @ F @ V).reshape(-1))
    if zero is not None:
        rows.append(np.kron(zero @ W, np.eye(d)))
        right.append(-(zero @ V).reshape(-1))
    step = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=1e-10)[0]
    turned: Matrix = np.linalg.qr(V + W @ step.reshape(n - d, d))[0]
    return turned


def _span(V: Matrix) -> Matrix:
    if not V.shape[1]:
        return V
    U, sizes, _ = np.linalg.svd(V, full_matrices=False)
    return U[:, sizes > _RANK * max(float(sizes.max(initial=0.0)), 1e-300)]


def _complement(V: Matrix) -> Matrix:
    """Orthonormal basis of what is orthogonal to the columns, which are orthonormal."""
    if not V.shape[1]:
        return np.eye(len(V))
    return np.linalg.svd(V)[0][:, V.shape[1] :]


def _intersection(U: Matrix, V: Matrix) -> Matrix:
    if not U.shape[1] or not V.shape[1]:
        return np.zeros((len(U), 0))
    left, cosines, _ = np.linalg.svd(U.T @ V)
    common: Matrix = U @ left[:, : int(np.sum(cosines > 1 - _RANK))]
    return common


def _beyond(U: Matrix, V: Matrix) -> Matrix:
    """Orthonormal basis of the part of span V that is orthogonal to span U, U inside V."""
    if not U.shape[1]:
        return V
    inside = V - U @ (U.T @ V)
    Q = np.linalg.svd(inside, full_matrices=False)[0]
    return Q[:, : V.shape[1] - U.shape[1]]


def _simple(V: Matrix) -> Matrix:
    """The same span with an identity at well-chosen rows, entries near simple numbers made so."""
    from scipy.linalg import qr  # slow to import

    if not V.shape[1]:
        return V
    _, order = qr(V.T, mode="r", pivoting=True)
    rows = np.sort(order[: V.shape[1]])
    W = V @ np.linalg.inv(V[rows])
    W[rows] = np.eye(V.shape[1])
    nearest = np.round(W / _GRAIN) * _GRAIN
    return np.where(np.abs(W - nearest) < _CLOSE, nearest, W)


def _independent_of(V: Matrix, columns: Matrix, count: int) -> Matrix:
    """Those `count` of the columns that are least inside span V."""
    from scipy.linalg import qr  # slow to import

    Q = _span(V)
    outside = columns - Q @ (Q.T @ columns)
    _, order = qr(outside, mode="r", pivoting=True)
    return columns[:, np.sort(order[:count])]
