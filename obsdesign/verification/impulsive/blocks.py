"""An impulsive observer that corrects a part of the state: the plant in blocks.

In the coordinates of `basis` the nominal plant is block upper triangular,

    A, G = [[hidden, *, *], [0, core, *], [0, 0, rest]],   C = [0, core, *]:

nothing that C sees comes from the hidden block, and nothing drives the rest. The core is corrected,
hidden and rest must decay by themselves. What the stored numbers differ by from such a plant (it
is rounding, or nothing) is carried to the convergence bound, which has to absorb it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lmi.arithmetic.balls import Exact, exact, inverse, number, rational, scalar
from lmi.bounds.largest_norm import norm_of, norm_over
from lmi.rank.stack import Stack, coordinates, state_basis
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.gains import Core
from obsdesign.verification.impulsive.rate import Bound, Reach, flow_change, together


@dataclass(frozen=True)
class Blocks:
    """A, G, C exactly in the coordinates of T, and the nominal A0, G0, C0 of the gain."""

    A: Exact
    G: Exact
    C: Exact
    A0: Exact
    G0: Exact
    C0: Exact
    T: Exact
    T_back: Exact
    first: int
    size: int

    @property
    def hidden(self) -> tuple[Exact, Exact] | None:
        """(A, G) of the block that C does not see; None if there is none."""
        return self._pair(0, self.first)

    @property
    def rest(self) -> tuple[Exact, Exact] | None:
        """(A, G) of the block that nothing drives; None if there is none."""
        return self._pair(self.first + self.size, len(self.A))

    def _pair(self, start: int, end: int) -> tuple[Exact, Exact] | None:
        if start == end:
            return None
        return self.A0[start:end, start:end], self.G0[start:end, start:end]

    @property
    def exact(self) -> bool:
        """Is the nominal plant the stored one?"""
        pairs = ((self.A, self.A0), (self.G, self.G0), (self.C, self.C0))
        return not any(value != 0 for a, b in pairs for value in (a - b).flat)


def blocks_of(numbers: Mapping[str, Any], core: Core, into: Exact) -> Blocks | None:
    """The blocks of exact gains; None if the basis is singular.

    core: in coordinates of its own, the columns of `into`; they replace those of the basis there.
    """
    A, G = numbers["A"], numbers["G"]
    C = seen_before_jump(G, numbers["C"], numbers["jump_measurement"])
    n, first, size = len(A), 0, len(core.A)
    T = exact(np.eye(n))
    if "basis" in numbers:
        first, T = int(numbers["core_place"][0]), numbers["basis"].copy()
    end = first + size
    T[:, first:end] = T[:, first:end] @ into
    T_back = inverse(T)
    if T_back is None:
        return None
    A, G, C = T_back @ A @ T, T_back @ G @ T, C @ T
    A0, G0, C0 = A.copy(), G.copy(), C.copy()
    zero = rational(0.0)
    for X in (A0, G0):
        X[first:, :first] = zero
        X[end:, first:end] = zero
    C0[:, :first] = zero
    A0[first:end, first:end], G0[first:end, first:end] = core.A, core.J
    C0[:, first:end] = core.C
    return Blocks(A, G, C, A0, G0, C0, T, T_back, first, size)


def in_its_coordinates(core: Core, low: float, high: float, window: int) -> tuple[Core, Exact]:
    """The core in the coordinates that its window gives, and their columns; all exact.

    The state in those of `lmi.rank.stack.state_basis`, the columns of the window in its R.
    """
    stack = Stack(*core.stack(window))
    R = coordinates(stack, low, high)[0]
    try:
        into = exact(state_basis(stack, R))
    except np.linalg.LinAlgError:  # none that floats can hold
        return core, exact(np.eye(len(core.A)))
    back = inverse(into)
    if back is None:
        return core, exact(np.eye(len(core.A)))
    A, J, C = back @ core.A @ into, back @ core.J @ into, core.C @ into
    if core.U is None or core.S is None:
        return Core(A, C, J), into
    columns = exact(R)
    turned = inverse(columns)
    if turned is None:
        return core, exact(np.eye(len(core.A)))
    return Core(A, C, J, back @ core.U @ turned, columns @ core.S @ into), into


@dataclass(frozen=True)
class Whole:
    """The bound of the stored plant, in the coordinates of T, and what each step is off by."""

    bound: Bound
    change: Any


def whole_bound(
    blocks: Blocks, reach: Reach, decaying: Mapping[str, Bound], high: float, rate: float
) -> Whole | None:
    """All blocks together; None if the bound of one is missing.

    decaying: by "hidden" and "rest", for the blocks that are there; rate: decay per unit of time
    that is aimed at.
    """
    change, _, nominal = flow_change(blocks.A, blocks.A0, high)
    off = nominal * (
        norm_of(blocks.G - blocks.G0) + reach.gain * norm_of(blocks.C - blocks.C0)
    ) + change * (norm_of(blocks.G) + reach.gain * norm_of(blocks.C))
    off = scalar(0) if blocks.exact else off
    parts: list[Bound] = []
    places: list[slice] = []
    end = blocks.first + blocks.size
    for name, place in (
        ("hidden", slice(0, blocks.first)),
        ("core", slice(blocks.first, end)),
        ("rest", slice(end, len(blocks.A))),
    ):
        if place.start == place.stop:
            continue
        own = reach.bound if name == "core" else decaying.get(name)
        if own is None:
            return None
        parts.append(own)
        places.append(place)
    if len(parts) == 1:
        return Whole(reach.bound.perturbed(off), off)
    # a little less than what is asked for, to be rounded up
    goal = (-number(rate) * number(high)).exp() * number(1 - 1e-7) if rate > 0 else None
    core = places.index(slice(blocks.first, end))
    weights = _influences(blocks, reach, high, places, core)
    return Whole(together(parts, weights, goal), off)


def _influences(
    blocks: Blocks, reach: Reach, high: float, places: list[slice], core: int
) -> list[list[Any]]:
    """What one step brings from block j to block i beyond the blocks themselves; balls.

    Nominal: above the diagonal, the cascade. Everywhere: what the stored plant differs by, worked
    out block by block, since a little from the core to the rest comes back through large gains.
    """
    unit = exact(np.eye(len(blocks.A)))
    count = range(len(places))

    def cut(X: Exact) -> list[list[Any]]:
        return [[norm_of(X[a, b]) for b in places] for a in places]

    def flows(X: Exact) -> list[list[Any]]:
        return [[norm_over(unit[a], X, unit[:, b], 0.0, high) for b in places] for a in places]

    def product(X: list[list[Any]], Y: list[list[Any]]) -> list[list[Any]]:
        return [[sum((X[i][k] * Y[k][j] for k in count), scalar(0)) for j in count] for i in count]

    def closed(G: Exact, C: Exact) -> list[list[Any]]:
        """Norms of G + L C, L acting on the core alone."""
        found = cut(G)
        for j in count:
            found[core][j] = found[core][j] + reach.gain * norm_of(C[:, places[j]])
        return found

    nominal = product(flows(blocks.A0), closed(blocks.G0, blocks.C0))
    cascade = [[nominal[i][j] if i < j else scalar(0) for j in count] for i in count]
    if blocks.exact:
        return cascade
    drift = product(product(flows(blocks.A), cut(blocks.A - blocks.A0)), flows(blocks.A0))
    drift = [[number(high) * x for x in row] for row in drift]
    first = product(drift, closed(blocks.G, blocks.C))
    second = product(flows(blocks.A0), closed(blocks.G - blocks.G0, blocks.C - blocks.C0))
    return [[cascade[i][j] + first[i][j] + second[i][j] for j in count] for i in count]


def in_state(bound: Bound, blocks: Blocks) -> Bound:
    """The bound for the state itself."""
    return bound.scaled(norm_of(blocks.T) * norm_of(blocks.T_back))
