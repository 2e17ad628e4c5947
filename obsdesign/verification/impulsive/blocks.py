"""An impulsive observer that corrects a part of the state: the plant in blocks.

In the coordinates of `basis` the nominal plant is block upper triangular,

    A, G = [[hidden, *, *], [0, core, *], [0, 0, rest]],   C = [0, core, *]:

C does not depend on the hidden block, and nothing drives the rest. The core is corrected, hidden
and rest must decay by themselves. The difference of the stored numbers from such a plant, rounding
or zero, enters the convergence bound, which has to absorb it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.balls import Ball, Exact, exact, inverse, number, rational, scalar
from lmi.bounds.largest_norm import norm_of, norm_over
from lmi.rank.stack import Stack, coordinates, state_basis
from obsdesign.equations.estimation_error import seen_before_jump
from obsdesign.equations.impulsive.formulas import Core
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.verification.impulsive.rate import Bound, Reach, coupled_bound, flow_change


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
    def hidden_pair(self) -> tuple[Exact, Exact] | None:
        """(A, G) of the unobservable block; None if there is none."""
        return self._pair(0, self.first)

    @property
    def rest_pair(self) -> tuple[Exact, Exact] | None:
        """(A, G) of the block that nothing drives; None if there is none."""
        return self._pair(self.first + self.size, len(self.A))

    def _pair(self, start: int, end: int) -> tuple[Exact, Exact] | None:
        if start == end:
            return None
        return self.A0[start:end, start:end], self.G0[start:end, start:end]

    @property
    def is_exact(self) -> bool:
        """Whether the nominal plant is the stored one."""
        pairs = ((self.A, self.A0), (self.G, self.G0), (self.C, self.C0))
        return not any(value != 0 for a, b in pairs for value in (a - b).flat)


def plant_blocks(gains: ImpulsiveGains, core: Core, into: Exact) -> Blocks | None:
    """The exact blocks of the plant of a design; None if the basis is singular.

    core: in coordinates of its own, the columns of `into`; they replace those of the basis there.
    """
    A, G = exact(gains.A), exact(gains.jump_matrix)
    C = seen_before_jump(G, exact(gains.C), gains.jump_measurement)
    first, size = 0, len(core.A)
    T = exact(np.eye(gains.n))
    if gains.basis is not None:
        first, T = gains.core_columns.start, exact(gains.basis)
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
    return Blocks(A=A, G=G, C=C, A0=A0, G0=G0, C0=C0, T=T, T_back=T_back, first=first, size=size)


def in_own_coordinates(core: Core, low: float, high: float, window: int) -> tuple[Core, Exact]:
    """The core in the coordinates of its window, and their columns; all exact.

    The state in those of `lmi.rank.stack.state_basis`, the columns of the window in its R.
    """
    stack, unchanged = Stack(*core.stack(window)), (core, exact(np.eye(len(core.A))))
    R = coordinates(stack, low, high)[0]
    try:
        into = exact(state_basis(stack, R))
    except np.linalg.LinAlgError:  # none that floats can hold
        return unchanged
    columns = exact(R)
    back, turned = inverse(into), inverse(columns)
    if back is None or turned is None:
        return unchanged
    A, J, C = back @ core.A @ into, back @ core.J @ into, core.C @ into
    if core.U is None or core.S is None:
        return Core(A, C, J), into
    return Core(A, C, J, back @ core.U @ turned, columns @ core.S @ into), into


@dataclass(frozen=True)
class Whole:
    """The bound of the stored plant, in the coordinates of T, and the perturbation per step."""

    bound: Bound
    change: Ball


def whole_bound(
    blocks: Blocks, reach: Reach, decaying: Mapping[str, Bound], high: float, rate: float
) -> Whole | None:
    """The bound of all blocks, coupled; None if that of one is missing.

    decaying: by "hidden" and "rest", for the blocks that exist; rate: decay per unit of time to be
    reached.
    """
    change, nominal = flow_change(blocks.A, blocks.A0, high)
    perturbation = nominal * (
        norm_of(blocks.G - blocks.G0) + reach.gain * norm_of(blocks.C - blocks.C0)
    ) + change * (norm_of(blocks.G) + reach.gain * norm_of(blocks.C))
    perturbation = scalar(0) if blocks.is_exact else perturbation
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
        return Whole(reach.bound.perturbed(perturbation), perturbation)
    # a little less than the rate needs, to be rounded up
    goal = (-number(rate) * number(high)).exp() * number(1 - 1e-7) if rate > 0 else None
    core = places.index(slice(blocks.first, end))
    weights = _influences(blocks, reach, high, places, core)
    return Whole(coupled_bound(parts, weights, goal), perturbation)


def _influences(
    blocks: Blocks, reach: Reach, high: float, places: list[slice], core: int
) -> list[list[Ball]]:
    """Norms of the coupling from block j to block i in one step; balls.

    Nominal: above the diagonal, the cascade. Everywhere: the difference of the stored plant, block
    by block, since a little from the core to the rest comes back through large gains.
    """
    unit = exact(np.eye(len(blocks.A)))
    count = range(len(places))

    def cut(X: Exact) -> list[list[Ball]]:
        return [[norm_of(X[a, b]) for b in places] for a in places]

    def flows(X: Exact) -> list[list[Ball]]:
        return [[norm_over(unit[a], X, unit[:, b], 0.0, high) for b in places] for a in places]

    def product(X: list[list[Ball]], Y: list[list[Ball]]) -> list[list[Ball]]:
        return [[sum((X[i][k] * Y[k][j] for k in count), scalar(0)) for j in count] for i in count]

    def closed(G: Exact, C: Exact) -> list[list[Ball]]:
        """Norms of G + L C, L acting on the core alone."""
        norms = cut(G)
        for j in count:
            norms[core][j] = norms[core][j] + reach.gain * norm_of(C[:, places[j]])
        return norms

    nominal = product(flows(blocks.A0), closed(blocks.G0, blocks.C0))
    cascade = [[nominal[i][j] if i < j else scalar(0) for j in count] for i in count]
    if blocks.is_exact:
        return cascade
    drift = product(product(flows(blocks.A), cut(blocks.A - blocks.A0)), flows(blocks.A0))
    drift = [[number(high) * x for x in row] for row in drift]
    first = product(drift, closed(blocks.G, blocks.C))
    second = product(flows(blocks.A0), closed(blocks.G - blocks.G0, blocks.C - blocks.C0))
    return [[cascade[i][j] + first[i][j] + second[i][j] for j in count] for i in count]


def in_state(bound: Bound, blocks: Blocks) -> Bound:
    """The bound for the state itself."""
    return bound.scaled(norm_of(blocks.T) * norm_of(blocks.T_back))
