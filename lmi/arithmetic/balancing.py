"""Diagonal scaling of states by powers of two: exact, and undone exactly in certificates.

In coordinates z = D^-1 x, D = diag(sizes), a flow F and jumps H become D^-1 F D and D^-1 H D, and a
certificate of these is one of F and H: P becomes D^-1 P D^-1, all in exact arithmetic. Sizes are
those of `lmi.arithmetic.units`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Array, Entries, NewEntries
from lmi.arithmetic.balls import Exact, exact, pivot_columns, to_float
from lmi.arithmetic.spectrum import spectral_radius
from lmi.arithmetic.units import LARGEST_UNIT, units_in_bits

# Couplings below this many bits need no other units: solvers do not mind
_COARSE = 4


@dataclass(frozen=True)
class Scaling:
    """sizes: powers of two (n,), x = D z, D = diag(sizes)."""

    sizes: Array

    @staticmethod
    def from_pair(F: Exact, H: Exact, longest: float) -> Scaling:
        """Sizes that balance a flow F and a jump H, (n, n) exact, together.

        longest: the longest dwell time; F counts over the time of its fastest mode, or that one.
        """
        flow, jump = to_float(F), to_float(H)
        with np.errstate(all="ignore"):
            finite = np.isfinite(flow).all() and np.isfinite(jump).all()
            fastest = spectral_radius(flow) if finite else 0.0
            time = min(longest, 1 / fastest) if fastest > 0 else longest
            size = np.abs(jump) + np.abs(flow) * time
            coupling = size - np.diag(np.diag(size))
        if not (np.isfinite(size).all() and coupling.max(initial=0.0) > 2.0**_COARSE):
            return Scaling(np.ones(len(F)))
        bits = units_in_bits(size)
        bits = np.round((bits - (bits.max() + bits.min()) / 2) / _COARSE) * _COARSE
        return Scaling(np.exp2(np.clip(bits, -LARGEST_UNIT, LARGEST_UNIT)))

    @staticmethod
    def like(v: Array) -> Scaling:
        """Sizes next to the entries of v, (n,) floats; 1 where one is not positive and finite."""
        usable = np.isfinite(v) & (v > 0)
        with np.errstate(all="ignore"):
            bits = np.where(usable, np.round(np.log2(np.where(usable, v, 1.0))), 0.0)
        return Scaling(np.exp2(np.clip(bits, -LARGEST_UNIT, LARGEST_UNIT)))

    @property
    def is_identity(self) -> bool:
        """True if no state is scaled."""
        return bool((self.sizes == 1).all())

    @cached_property
    def _numbers(self) -> tuple[Exact, Exact]:
        return exact(self.sizes), exact(1 / self.sizes)

    def _pair(self, X: Array) -> tuple[Array, Array]:
        return self._numbers if X.dtype == object else (self.sizes, 1 / self.sizes)

    def map(self, X: Array) -> Array:
        """D^-1 X D: a map of x as one of z. Floats or exact, (..., n, n)."""
        return self.rows(self.columns(X))

    def rows(self, X: Array) -> Array:
        """D^-1 X: what has its values in x. (n,) or (..., n, m)."""
        if self.is_identity:
            return X
        back = self._pair(X)[1]
        return np.asarray((back if X.ndim == 1 else back[:, None]) * X)

    def columns(self, X: Array) -> Array:
        """X D: what is applied to x."""
        return X if self.is_identity else np.asarray(X * self._pair(X)[0])

    def form(self, P: Array) -> Array:
        """D P D: x'Px as a quadratic form of z."""
        return P if self.is_identity else np.asarray(self._pair(P)[0][:, None] * self.columns(P))

    def dual(self, Z: Array) -> Array:
        """D^-1 Z D^-1: a multiplier for maps of x as one for those of z."""
        return self.undone.form(Z)

    @cached_property
    def undone(self) -> Scaling:
        """From z back to x."""
        return Scaling(1 / self.sizes)

    def vector(self, v: Array, side: str) -> Array:
        """A state of z as one of x (side "right"), or a row vector v'z as one of x ("left")."""
        return np.asarray(v / self.sizes if side == "left" else v * self.sizes)

    def restored(self, evidence: Entries, H: Exact) -> NewEntries:
        """Evidence about z as evidence about x: certificates and witnesses of F and H.

        H: exact, of x or z. Its independent columns are the coordinates of reduced windows.
        """
        if self.is_identity:
            return dict(evidence)
        result = dict(evidence)
        for name in result.keys() & {"P", "Q"}:
            result[name] = self.undone.form(_floats(result[name])).tolist()
        if "multipliers" in result:
            back = [self.form(Z) for Z in _floats(result["multipliers"])]
            result["multipliers"] = [Z.tolist() for Z in back]
        if "vector" in result:
            result["vector"] = self.vector(_floats(result["vector"]), result["side"]).tolist()
        if "windows" in result:
            result["windows"] = self._windows(result["windows"], H)
        for name in result.keys() & {"no_common_P", "witness"}:
            result[name] = self.restored(result[name], H)
        return result

    def _windows(self, windows: Sequence[NewEntries], H: Exact) -> list[NewEntries]:
        reduced = len(windows[0]["P"]) < len(self.sizes)
        part = Scaling(1 / self.sizes[pivot_columns(H)]) if reduced else self.undone
        return [window | {"P": part.form(_floats(window["P"])).tolist()} for window in windows]


def _floats(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=np.float64)
