"""Diagonal scaling of states by powers of two: exact, and undone exactly in certificates.

In coordinates z = D^-1 x, D = diag(sizes), a flow F and jumps H become D^-1 F D and D^-1 H D, and a
certificate of these is one of F and H: P becomes D^-1 P D^-1, all in exact arithmetic. Sizes are
chosen so that rows and columns are of like size where states depend on each other (Osborne's
iteration, in the largest entry). States that depend on others, but not they on them (block
triangular maps), are graded: their unit grows until that coupling is at most one.

Source: E. E. Osborne, On pre-conditioning of matrices, J. ACM 7 (1960), 338-345.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.balls import Exact, exact, pivot_columns, to_float

Matrix = NDArray[Any]

_SWEEPS = 40
_SETTLED = 0.5  # bits: a sweep that changes no unit by more ends the iteration
# Couplings below this many bits need no other units: solvers do not mind
_COARSE = 4
# D^-1 P D^-1 must stay in the range of floats
_LARGEST = 240


def balance(maps: Matrix) -> Matrix:
    """Powers of two d, (n,), for which diag(d) M diag(1/d) is balanced and graded.

    maps: (n, n) or (k, n, n), finite; of several maps the largest entries count.
    """
    bits = -_bits(np.abs(maps).reshape(-1, *maps.shape[-2:]).max(axis=0))
    return np.asarray(np.exp2(np.clip(np.round(bits - bits.max(initial=0.0)), -_LARGEST, 0)))


def _bits(size: Matrix) -> Matrix:
    """Binary logarithms x of units for which size[i, j] 2^(x_j - x_i) is balanced and graded."""
    weights = np.full(size.shape, -np.inf)
    np.log2(size, out=weights, where=size > 0)
    np.fill_diagonal(weights, -np.inf)
    reach = _reachable(weights > -np.inf)
    units, part = np.zeros(len(size)), np.argmax(reach & reach.T, axis=1)
    # a part comes after those that it depends on
    for first in sorted({*part.tolist()}, key=lambda first: int(reach[first].sum())):
        members, others = np.flatnonzero(part == first), np.flatnonzero(part != first)
        units[members] = _osborne(weights[np.ix_(members, members)])
        coupling = weights[np.ix_(members, others)] + units[others] - units[members, None]
        units[members] += max(float(coupling.max(initial=-np.inf)), 0.0)
    return units


def _reachable(edges: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which states each state depends on, at once or through others; itself included."""
    reach = edges | np.eye(len(edges), dtype=bool)
    while True:
        further = reach @ reach
        if (further == reach).all():
            return reach
        reach = further


def _osborne(weights: Matrix) -> Matrix:
    """Units of states all of which depend on each other; in bits, the smallest 0."""
    n = len(weights)
    units = np.zeros(n)
    if n == 1:
        return units
    for _ in range(_SWEEPS):
        largest = 0.0
        for i in range(n):
            row = float((weights[i] + units).max()) - units[i]
            column = float((weights[:, i] - units).max()) + units[i]
            step = (row - column) / 2
            units[i] += step
            largest = max(largest, abs(step))
        if largest <= _SETTLED:
            break
    return np.asarray(units - units.min())


@dataclass(frozen=True)
class Scaling:
    """sizes: powers of two (n,), x = D z, D = diag(sizes)."""

    sizes: Matrix

    @staticmethod
    def of(F: Exact, H: Exact, longest: float) -> Scaling:
        """Sizes that balance a flow F and a jump H, (n, n) exact, together.

        longest: the longest dwell time; F counts over the time of its fastest mode, or that one.
        """
        flow, jump = to_float(F), to_float(H)
        with np.errstate(all="ignore"):
            finite = np.isfinite(flow).all() and np.isfinite(jump).all()
            fastest = float(np.abs(np.linalg.eigvals(flow)).max(initial=0.0)) if finite else 0.0
            time = min(longest, 1 / fastest) if fastest > 0 else longest
            size = np.abs(jump) + np.abs(flow) * time
            coupling = size - np.diag(np.diag(size))
        if not (np.isfinite(size).all() and coupling.max(initial=0.0) > 2.0**_COARSE):
            return Scaling(np.ones(len(F)))
        bits = _bits(size)
        bits = np.round((bits - (bits.max() + bits.min()) / 2) / _COARSE) * _COARSE
        return Scaling(np.exp2(np.clip(bits, -_LARGEST, _LARGEST)))

    @staticmethod
    def like(v: Matrix) -> Scaling:
        """Sizes next to the entries of v, (n,) floats; 1 where one is not positive and finite."""
        usable = np.isfinite(v) & (v > 0)
        with np.errstate(all="ignore"):
            bits = np.where(usable, np.round(np.log2(np.where(usable, v, 1.0))), 0.0)
        return Scaling(np.exp2(np.clip(bits, -_LARGEST, _LARGEST)))

    @property
    def is_identity(self) -> bool:
        """Whether nothing is scaled."""
        return bool((self.sizes == 1).all())

    @cached_property
    def _numbers(self) -> tuple[Exact, Exact]:
        return exact(self.sizes), exact(1 / self.sizes)

    def _pair(self, X: Matrix) -> tuple[Matrix, Matrix]:
        return self._numbers if X.dtype == object else (self.sizes, 1 / self.sizes)

    def map(self, X: Matrix) -> Matrix:
        """D^-1 X D: a map of x as one of z. Floats or exact, (..., n, n)."""
        return self.rows(self.columns(X))

    def rows(self, X: Matrix) -> Matrix:
        """D^-1 X: what has its values in x. (n,) or (..., n, m)."""
        if self.is_identity:
            return X
        back = self._pair(X)[1]
        return np.asarray((back if X.ndim == 1 else back[:, None]) * X)

    def columns(self, X: Matrix) -> Matrix:
        """X D: what is applied to x."""
        return X if self.is_identity else np.asarray(X * self._pair(X)[0])

    def form(self, P: Matrix) -> Matrix:
        """D P D: x'Px as a quadratic form of z."""
        return P if self.is_identity else np.asarray(self._pair(P)[0][:, None] * self.columns(P))

    def dual(self, Z: Matrix) -> Matrix:
        """D^-1 Z D^-1: a multiplier for maps of x as one for those of z."""
        return self.undone.form(Z)

    @cached_property
    def undone(self) -> Scaling:
        """From z back to x."""
        return Scaling(1 / self.sizes)

    def vector(self, v: Matrix, side: str) -> Matrix:
        """A state of z as one of x (side "right"), or a row vector v'z as one of x ("left")."""
        return np.asarray(v / self.sizes if side == "left" else v * self.sizes)

    def restored(self, evidence: Mapping[str, Any], H: Exact) -> dict[str, Any]:
        """Evidence about z as evidence about x: certificates and witnesses of F and H.

        H: exact, of x or z. Its independent columns are the coordinates of reduced windows.
        """
        if self.is_identity:
            return dict(evidence)
        found = dict(evidence)
        for name in found.keys() & {"P", "Q"}:
            found[name] = self.undone.form(_floats(found[name])).tolist()
        if "multipliers" in found:
            back = [self.form(Z) for Z in _floats(found["multipliers"])]
            found["multipliers"] = [Z.tolist() for Z in back]
        if "vector" in found:
            found["vector"] = self.vector(_floats(found["vector"]), found["side"]).tolist()
        if "windows" in found:
            found["windows"] = self._windows(found["windows"], H)
        for name in found.keys() & {"no_common_P", "witness"}:
            found[name] = self.restored(found[name], H)
        return found

    def _windows(self, windows: Any, H: Exact) -> list[dict[str, Any]]:
        reduced = len(windows[0]["P"]) < len(self.sizes)
        part = Scaling(1 / self.sizes[pivot_columns(H)]) if reduced else self.undone
        return [window | {"P": part.form(_floats(window["P"])).tolist()} for window in windows]


def _floats(values: ArrayLike) -> Matrix:
    return np.asarray(values, dtype=np.float64)
