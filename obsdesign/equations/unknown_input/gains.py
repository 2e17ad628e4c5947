"""Gains of the unknown-input observer: what a design of kind `unknown_input` stores."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, NewEntries
from obsdesign.equations.gains import Gains
from obsdesign.equations.stored import count, matrix, word

DIFFERENTIATORS = ("cell", "damped", "batch", "fixed_lag")
# they smooth to the noise, so that its deviation is required
SMOOTHING = ("batch", "fixed_lag")


@dataclass(frozen=True, kw_only=True, eq=False)
class UnknownInputGains(Gains):
    """B, D of the plant, the matrices of `ObserverMatrices`, `first`, and the differentiator.

    Letters: k = n - q reduced states, z = p - q annihilated outputs, v = m + 1 known inputs with
    the constant 1. first (k, p): the reduced state of least norm for the first y. noise_std (p,):
    the noise that a smoothing differentiator smooths to; lag: samples that `fixed_lag` waits for.
    """

    D: Array = matrix("n", "q")
    B: Array | None = matrix("n", "m", optional=True)
    T1: Array = matrix("n", "n")
    T: Array = matrix("k", "n")
    N: Array = matrix("q", "p")
    Z: Array = matrix("z", "p")
    L: Array = matrix("k", "z")
    F: Array = matrix("k", "k")
    H: Array = matrix("k", "p")
    Gu: Array = matrix("k", "v")
    X: Array = matrix("n", "k")
    Xy: Array = matrix("n", "p")
    Q: Array = matrix("q", "k")
    R: Array = matrix("q", "p")
    S: Array = matrix("q", "v")
    first: Array = matrix("k", "p")
    differentiator: str = word(*DIFFERENTIATORS)
    noise_std: Array | None = matrix("p", optional=True)
    lag: int | None = count(optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, shape in shapes(self.n, self.p, self.q, self.m).items():
            if getattr(self, name).shape != shape:
                arrived = getattr(self, name).shape
                raise ValueError(f"gains.{name} must have shape {shape}; got shape {arrived}.")
        if self.differentiator in SMOOTHING and self.noise_std is None:
            raise ValueError(f"gains.noise_std must have shape ({self.p},).")
        if self.differentiator == "fixed_lag" and self.lag is None:
            raise ValueError("gains.lag must be a whole number >= 1; got nothing.")

    @classmethod
    def from_document(cls, entries: Entries) -> Self:
        """The gains that a design file states; matrices without entries are not stored there."""
        for name in ("A", "C", "D"):
            if np.ndim(entries.get(name, 0)) != 2:
                raise ValueError(f"gains.{name} must be a matrix.")
        (n, q), p = np.shape(entries["D"]), len(entries["C"])
        m = np.shape(entries["B"])[-1] if "B" in entries else 0
        empty = {name: np.zeros(s) for name, s in shapes(n, p, q, m).items() if 0 in s}
        return super().from_document(empty | dict(entries))

    def to_document(self) -> NewEntries:
        """Entries of a design file; JSON cannot tell a 0 x 3 matrix from a 0 x 2 one."""
        return without_empty(super().to_document())

    @cached_property
    def q(self) -> int:
        """Number of unknown inputs."""
        return int(self.D.shape[1])

    @cached_property
    def k(self) -> int:
        """Number of reduced states."""
        return len(self.F)

    @cached_property
    def m(self) -> int:
        """Number of known inputs."""
        return 0 if self.B is None else int(self.B.shape[1])

    @property
    def columns(self) -> dict[str, int | bool]:
        """Numbers of y, u, w in a sample, and whether jumps are reported."""
        return {"y": self.p, "u": self.m, "w": 0, "jump": False}


_STORED = ("A", "C", "D", "B")
_COMPUTED = tuple(
    entry
    for entry in dataclasses.fields(UnknownInputGains)
    if "shape" in entry.metadata and entry.name not in (*_STORED, "noise_std", "noise_centre")
)


def shapes(n: int, p: int, q: int, m: int) -> dict[str, tuple[int, ...]]:
    """Shape of every gain that is computed, empty ones included; m known inputs."""
    sizes = {"n": n, "p": p, "q": q, "k": n - q, "z": p - q, "v": m + 1}
    return {
        entry.name: tuple(sizes[axis] for axis in entry.metadata["shape"].axes)
        for entry in _COMPUTED
    }


def without_empty(gains: Entries) -> NewEntries:
    """Gains that have entries, as a design file states them."""
    return {name: value for name, value in gains.items() if np.size(value)}
