"""Widths of the multiplier observer on a pattern: sums without data, over floats or balls.

With multipliers mu for the upper bound of l'x and -mu for the lower one, all that is linear in y, u
and the middles of the boxes drops out of the difference:

    width <= 2 (|p|'r + sum of |mu|'V and of the supports of the disturbances),   p = P'l

r: half the width at the start of the window. It is affine and increasing in r. The supports are
those that the observer computes (`support`), in exact arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.equations.set_membership.pattern import Pattern, Step
from obsdesign.equations.time_grid import rounded_steps

# numbers of pieces that a step of a length may be cut into
Pieces = Callable[[float], Sequence[int]]


@dataclass(frozen=True)
class Arithmetic:
    """cast: floats as the numbers that are computed with; exp: e^{X t} of a square array."""

    cast: Callable[[Array], Array]
    exp: Callable[[Array, float], Array]


# the sign test must hold by one in so many parts more than at run time, where it is rounded
_MARGIN = 10**9


@dataclass(frozen=True)
class StepMap:
    """x+ = Phi x + what the disturbance adds, of floats or of balls.

    F0, FM, F1, E2 (n, pieces * width): see `support`, pieces counted from the end of the step;
    length: of a piece; radius (pieces * width,): of the columns of the disturbance. other: the
    same step in another number of pieces, where the observer may take either.
    """

    Phi: Array
    F0: Array
    FM: Array
    F1: Array
    E2: Array
    length: float
    radius: Array
    other: StepMap | None = None

    @property
    def generators(self) -> Array:
        """What a disturbance that is constant on every piece, and of full size, adds."""
        return self.F0 * self.radius


def _flow_step(
    A: Array, columns: Array, radius: Array, h: float, *, pieces: int,
    numbers: Arithmetic,
) -> StepMap:  # fmt: skip
    """A step of length h in so many pieces, a power of two; columns (n, r) of the disturbance."""
    n, r, d, exp = len(A), columns.shape[1], h / pieces, numbers.exp
    block = np.block([[A, columns], [np.zeros((r, n + r), dtype=int) * A.flat[0]]])
    whole, half = exp(block, d), exp(A, 0.5 * d)
    piece, first = whole[:n, :n], whole[:n, n:]
    # int_0^d e^{A s} ds b: what a constant b adds in a piece
    growth = exp(abs(A), 0.5 * d) @ abs(columns)
    F0, middles = [first], [half]
    for _ in range(pieces - 1):
        F0.append(piece @ F0[-1])
        middles.append(piece @ middles[-1])
    FM = [middle @ columns for middle in middles]
    Phi = middles[-1] @ half
    return StepMap(
        Phi, np.hstack(F0), np.hstack(FM), np.hstack([A @ X for X in FM]),
        np.hstack([abs(A @ A @ X) @ growth for X in middles]), numbers.cast(np.array(d)).item(),
        np.tile(radius, pieces),
    )  # fmt: skip


def _counted_step(A: Array, columns: Array, radius: Array, count: int) -> StepMap:
    """So many steps of discrete time: a piece of length zero for each."""
    Phi, pieces = A, [columns]
    for _ in range(count - 1):
        pieces.append(A @ pieces[-1])
        Phi = A @ Phi
    F0 = np.hstack(pieces)
    return StepMap(Phi, F0, F0 * 0, F0 * 0, F0 * 0, 0, np.tile(radius, count))


def _jump_step(G: Array, columns: Array, radius: Array) -> StepMap:
    """A jump: a piece of length zero."""
    nothing = columns * 0
    return StepMap(G, columns, nothing, nothing, nothing, 0, radius)


def support_of(q: Array, step: StepMap) -> Array:
    """(B,): what the disturbance of a step adds along q (B, n), as the observer bounds it."""
    if not len(step.radius):
        none: Array = abs(q).sum(axis=1) * 0  # of the numbers of q
        return none
    own = _support(q, step)
    if step.other is None:
        return own
    other = _support(q, step.other)
    result: Array = (own + other + abs(own - other)) / 2  # the larger one
    return result


def _support(q: Array, step: StepMap) -> Array:
    d = step.length  # products with it one by one, and divisions by whole numbers: all exact
    total, l0, l1 = (abs(q @ X) for X in (step.F0, step.FM, step.F1))
    slope, bend = l1 * d / 2, abs(q) @ step.E2 * d * d / 4
    threshold = slope + bend / 2
    is_signed = np.asarray(l0 >= threshold + threshold / _MARGIN, dtype=bool)
    crossing = total + (slope + bend) * d / 2
    keeps = np.asarray(l0 >= slope, dtype=bool)
    crossed = slope * d / 2 + l0 * l0 / np.where(keeps, 1, l1)
    taylor = np.where(keeps, l0 * d, crossed) + bend * d / 6
    is_less = np.asarray(taylor < crossing, dtype=bool)
    terms = np.where(is_signed, total, np.where(is_less, taylor, crossing))
    result: Array = terms @ step.radius
    return result


@dataclass(frozen=True)
class NominalMaps:
    """The plant of a design on a pattern, in floats or in balls."""

    gains: SetMembershipGains
    numbers: Arithmetic

    @property
    def C(self) -> Array:
        """Output matrix (p, n)."""
        return self.numbers.cast(self.gains.C)

    @property
    def V(self) -> Array:
        """Half widths of the strips (p,)."""
        return self.numbers.cast(self.gains.noise_bound)

    def steps(self, cycle: Sequence[Step], pieces: Pieces) -> dict[Step, StepMap]:
        """The maps of all different steps; pieces: the numbers of pieces that serve a length."""
        return {step: self._map(step, pieces) for step in dict.fromkeys(cycle)}

    def _map(self, step: Step, pieces: Pieces) -> StepMap:
        cast, gains = self.numbers.cast, self.gains
        if step.jump:
            return _jump_step(cast(gains.jump_matrix), *self._disturbance(gains.jump_disturbance))
        columns, radius = self._disturbance(gains.flow_disturbance)
        if gains.dt is not None:
            return _counted_step(cast(gains.A), columns, radius, rounded_steps(step.h, gains.dt))
        maps = [
            _flow_step(cast(gains.A), columns, radius, step.h, pieces=count, numbers=self.numbers)
            for count in pieces(step.h)
        ]
        return maps[0] if len(maps) == 1 else replace(maps[0], other=maps[1])

    def _disturbance(self, entries: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        """(columns, radius) of the disturbances whose box is not one point."""
        matrix, lower, upper = entries
        active = np.flatnonzero((lower < upper) & (matrix != 0).any(axis=0))
        cast = self.numbers.cast
        radius = (cast(upper[active]) - cast(lower[active])) / 2
        return cast(matrix[:, active]), radius


def width_map(
    steps: Sequence[StepMap], C: Array, V: Array, mu: Array, rows: Array
) -> tuple[Array, Array]:
    """(|P| (B, n), k (B,)): half widths are at most |P| r + k.

    steps: of a window, oldest first; mu (B, steps, p); rows (B, n): l; V (p,).
    """
    p, added = rows, abs(rows).sum(axis=1) * 0
    for k in range(len(steps) - 1, -1, -1):
        q = p - mu[:, k] @ C
        added = added + abs(mu[:, k]) @ V + support_of(q, steps[k])
        p = q @ steps[k].Phi
    return abs(p), added


@dataclass(frozen=True)
class RowMap:
    """Half widths after a row are at most M r + k; r (n,): those after row `start`."""

    start: int
    M: Array
    k: Array


def row_maps(
    maps: NominalMaps, pattern: Pattern, pieces: Pieces, multipliers: Array
) -> list[RowMap]:  # fmt: skip
    """The map of every row of a cycle; multipliers (windows, n, steps, p), floats: as stored."""
    steps, count = maps.steps(pattern.cycle, pieces), multipliers.shape[2]
    windows, cast = pattern.windows(count), maps.numbers.cast
    unit = cast(np.eye(maps.gains.n))
    own = [
        width_map([steps[step] for step in window], maps.C, maps.V, cast(mu), unit)
        for window, mu in zip(windows, multipliers, strict=True)
    ]
    rows = []
    for end in pattern.ends:
        M, k = own[windows.index(pattern.window(end, count))]
        start, step = pattern.start(end, count)
        if step is not None:
            none = cast(np.zeros((maps.gains.n, 1, len(maps.V))))
            before, added = width_map([steps[step]], maps.C, maps.V, none, unit)
            M, k = M @ before, k + M @ added
        rows.append(RowMap(start, M, k))
    return rows
