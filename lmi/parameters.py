"""Affine families x' = A(p) x, x+ = G(p) x, whose parameters lie in a box.

    A(p) = A_0 + sum_i p_i A_i,   G(p) = G_0 + sum_i p_i G_i,   |p_i| <= 1

A parameter that varies is any measurable function of time, and its value at a jump is one of its
own. A constant one is one unknown number for all times.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import Exact, Rational, exact, rational, to_float

# corners double with each parameter
MOST_PARAMETERS = 8

Point = tuple[float, ...]


@dataclass(frozen=True)
class AffineFamily:
    """A, G: (1 + q, n, n) exact, the middle and the effect of each parameter on its half range.

    is_constant: of each parameter.
    """

    A: Exact
    G: Exact
    is_constant: tuple[bool, ...] = field(default=())

    def __post_init__(self) -> None:
        """ValueError where shapes do not agree."""
        count, n = len(self.A), self.A.shape[-1]
        if self.A.shape != (count, n, n) or self.G.shape != self.A.shape:
            raise ValueError("A and G need (1 + q, n, n) entries each")
        if len(self.is_constant) != count - 1:
            raise ValueError(f"{count - 1} parameters need as many entries of is_constant")

    @property
    def order(self) -> int:
        """Number n of states."""
        return int(self.A.shape[-1])

    @property
    def count(self) -> int:
        """Number q of parameters."""
        return len(self.A) - 1

    def flow(self, p: Sequence[float | Rational]) -> Exact:
        """A(p), exact."""
        return _combined(self.A, p)

    def jump(self, p: Sequence[float | Rational]) -> Exact:
        """G(p), exact."""
        return _combined(self.G, p)

    def flow_vertices(self) -> list[Exact]:
        """Matrices whose convex hull holds every A(p); ValueError for too many parameters."""
        return _vertices(self.A)

    def jump_vertices(self) -> list[Exact]:
        """Matrices whose convex hull holds every G(p); ValueError for too many parameters."""
        return _vertices(self.G)

    def corners(self) -> Iterator[Point]:
        """Every p of entries -1 and 1."""
        return itertools.product((-1.0, 1.0), repeat=self.count)

    def floats(self) -> tuple[Array, Array]:
        """A and G in floats, (1 + q, n, n) each."""
        return to_float(self.A), to_float(self.G)

    def scaled(self, factor: float | Rational) -> AffineFamily:
        """The same middle with all ranges `factor` times as wide."""
        weights = exact([1.0, *[1.0] * self.count])
        weights[1:] *= rational(factor)
        shape = weights[:, None, None]
        return replace(self, A=self.A * shape, G=self.G * shape)

    def halves(self, parameter: int) -> tuple[AffineFamily, AffineFamily]:
        """The families with p_i in [-1, 0] and in [0, 1], each with |p_i| <= 1 again."""
        return self._half(parameter, -1), self._half(parameter, 1)

    def _half(self, i: int, sign: int) -> AffineFamily:
        flows, jumps = self.A.copy(), self.G.copy()
        for own in (flows, jumps):
            own[1 + i] = own[1 + i] / 2
            own[0] = own[0] + own[1 + i] * sign
        return replace(self, A=flows, G=jumps)


def _combined(parts: Exact, p: Sequence[float | Rational]) -> Exact:
    total: Exact = parts[0]
    for weight, part in zip(p, parts[1:], strict=True):
        total = total + part * rational(weight)
    return total


def _vertices(parts: Exact) -> list[Exact]:
    """Middle +- every effect, those that are multiples of each other taken together."""
    effects = _independent(list(parts[1:]))
    if len(effects) > MOST_PARAMETERS:
        raise ValueError(
            f"at most {MOST_PARAMETERS} parameters may act on one matrix; got {len(effects)}"
        )
    vertices = [parts[0]]
    for effect in effects:
        vertices = [vertex + effect * sign for vertex in vertices for sign in (-1, 1)]
    return vertices


def _independent(effects: Sequence[Exact]) -> list[Exact]:
    """p E + r (c E) = (p + r c) E covers |1 + |c|| E: parallel effects are one; zeros are none."""
    merged: list[Exact] = []
    for effect in effects:
        places = np.argwhere(effect != 0)
        if not len(places):
            continue
        place = tuple(places[0])
        for k, other in enumerate(merged):
            if other[place] == 0:
                continue
            ratio = effect[place] / other[place]
            if (effect == other * ratio).all():
                merged[k] = other * (1 + abs(ratio))
                break
        else:
            merged.append(effect)
    return merged
