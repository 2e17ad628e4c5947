"""Widths of interval bounds of a plant with parameters, without any bound of x.

With y, u and w known, the radius r >= |x - m| of `runtime.interval.parametric_steps` follows

    r' = W r + sum |A_i m + Q_i (y - C m) + B_i u| + (|L| + sum |Q_i|) (V + sum |C_i m|) + b_rad
    r+ = N r + sum |G_i m + T_i (y - C m) + E_i w| + (|M| + sum |T_i|) (V + sum |C_i m|) + c_rad

    W = Mz(F) + sum |R_i| + (|L| + sum |Q_i|) sum |C_i|,  R_i = A_i - Q_i C
    N = |H| + sum |S_i| + (|M| + sum |T_i|) sum |C_i|,    S_i = G_i - T_i C

where D0 + D1 and Gp + Gn stand for Mz(F) and |H|. A_i m + Q_i (y - C m) is R_i m + Q_i y, and
m' = F m + L y + B u + b_mid, m+ = H m + M y + E w + c_mid do not depend on x: |m| <= mu with

    mu' = Mz(F) mu + |L| |y| + |B| |u| + |b_mid|,   mu+ = |H| mu + |M| |y| + |E| |w| + |c_mid|

so that (mu, r) is a positive system, block triangular, stable if and only if (W, N) is: the bounds
stay bounded whenever y, u and w are. It is linear in the largest |y|, |u|, |w|, and so is a bound
of its limit. With measurements after jumps, X = I - M C,

    r+ = (|X G| + sum |X G_i|) r + sum |X (G_i m + E_i w)| + |X| c_rad + |M| (V + sum |C_i x+|),
    |x+| <= |G m + E w + c_mid| + (|G| + sum |G_i|) r + sum |G_i m + E_i w| + c_rad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array
from obsdesign.column_names import numbered
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.splits import completed_split
from obsdesign.equations.interval.width import Coordinates, WidthSystem
from obsdesign.equations.parameters import NormalForm


@dataclass(frozen=True)
class SourcedWidth:
    """The system of (mu, 2 r) for each unit of a source, and the pair (W, N) of its last block.

    systems: by source: "constant" (noise and disturbances), and "y1", ..., "u1", ..., "w1", ...,
    each for 1 as its largest magnitude; out (2n, 2n) leads to x. N: None without jumps.
    """

    W: Array
    N: Array | None
    systems: dict[str, WidthSystem]


@dataclass(frozen=True)
class _Nominal:
    """Matrices in the observer's coordinates, effects summed as |.|, arithmetic of `lift`."""

    gains: IntervalGains
    form: NormalForm
    frame: Coordinates
    lift: Callable[[Array], Array]
    C: Array
    L: Array
    M: Array
    C_sum: Array

    @staticmethod
    def of_design(
        gains: IntervalGains,
        form: NormalForm,
        lift: Callable[[Array], Array],
        inverse: Callable[[Array], Array | None],
    ) -> _Nominal:
        frame = Coordinates.from_matrices(gains.S, None, inverse, lift)
        if name := frame.singular_matrix():
            raise ValueError(f"{name} is singular")
        C = form.C if frame.S is None else form.C @ frame.S
        C_sum = total((Y if frame.S is None else Y @ frame.S for Y in form.on("C")), C)
        L, M = (frame.inward(lift(K)) for K in (gains.L, gains.M))
        return _Nominal(gains, form, frame, lift, C, L, M, C_sum)

    def corrected(self, key: str, stored: Array | None) -> tuple[Array, Array]:
        """(sum |X_i - Q_i C|, sum |Q_i|) of the effects on A or G; stored: Q_i of all effects."""
        zero = 0 * self.C.T
        remaining, gains = 0 * (self.C.T @ self.C), zero
        for i, effect in enumerate(self.form.effects):
            if (X := getattr(effect, key)) is not None:
                Q = zero if stored is None else self.lift(stored[i])
                remaining = remaining + abs(self.frame.similar(X) - Q @ self.C)
                gains = gains + abs(Q)
        return remaining, gains

    def known(self, key: str, left: Array) -> tuple[Array, Array]:
        """(|X B|, sum |X B_i|) of a matrix of known inputs, X = left."""
        columns = getattr(self.form, key)
        if columns is None:
            blank = 0 * self.C.T[:, :0]
            return blank, blank
        inward = left @ self.frame.inward(columns)
        return abs(inward), total((left @ self.frame.inward(Y) for Y in self.form.on(key)), inward)

    def disturbance(self, bounds: tuple[Array, Array, Array], left: Array) -> tuple[Array, Array]:
        """(|X middle|, |X columns| radius) of a disturbance columns @ w, w in [lower, upper]."""
        columns, lower, upper = (self.lift(own) for own in bounds)
        through = left @ self.frame.inward(columns)
        return abs(through @ ((lower + upper) / 2)), abs(through) @ ((upper - lower) / 2)


def sourced_width(
    gains: IntervalGains,
    form: NormalForm,
    lift: Callable[[Array], Array],
    inverse: Callable[[Array], Array | None],
) -> SourcedWidth:
    """The systems of a design with a continuous y.

    gains: with bounds of b, c and v alone; form: of the plant, in the arithmetic of `lift` and
    `inverse`. ValueError if S is singular.
    """
    plant = _Nominal.of_design(gains, form, lift, inverse)
    flow = _flow(plant)
    jump = None if form.G is None else _jump(plant, form.G)
    zero = 0 * flow.inputs[:, 0]
    pushes = dict(zip(["constant", *numbered("y", gains.p), *numbered("u", gains.m)],
                      flow.inputs.T, strict=True))  # fmt: skip
    kicks: dict[str, Array] = {}
    if jump is not None:
        count = jump.inputs.shape[1] - 1 - gains.p
        names = ["constant", *numbered("y", gains.p), *numbered("w", count)]
        kicks = dict(zip(names, jump.inputs.T, strict=True))
    own = np.eye(gains.n, dtype=np.int64) if plant.frame.S is None else abs(plant.frame.S)
    out = np.block([[own, 0 * own], [0 * own, own]])
    systems = {
        name: WidthSystem(
            W=flow.matrix, f=pushes.get(name, zero), N=None if jump is None else jump.matrix,
            h=None if jump is None else kicks.get(name, zero), K=None, k=None, out=out,
        )
        for name in dict.fromkeys([*pushes, *kicks])
    }  # fmt: skip
    return SourcedWidth(flow.radius, None if jump is None else jump.radius, systems)


@dataclass(frozen=True)
class _Block:
    """centre (n, n): of mu; across: what mu adds to r; inputs: (mu, 2 r) by source, in columns."""

    centre: Array
    across: Array
    inputs: Array

    @property
    def radius(self) -> Array:
        """Of r itself."""
        return self.centre + self.across

    @property
    def matrix(self) -> Array:
        """Of (mu, 2 r)."""
        return np.block([[self.centre, 0 * self.across], [2 * self.across, self.radius]])


def _flow(plant: _Nominal) -> _Block:
    """Between jumps."""
    gains, lift = plant.gains, plant.lift
    F = plant.frame.similar(plant.form.A) - plant.L @ plant.C
    centre = _sum(completed_split(F, lift(gains.D0), lift(gains.D1)))
    R, Q = plant.corrected("A", gains.flow_correction)
    L, identity = abs(plant.L), np.eye(gains.n, dtype=np.int64)
    across = R + (L + Q) @ plant.C_sum
    middle, radius = plant.disturbance(gains.declared_disturbance, identity)
    B, B_sum = plant.known("B", identity)
    V, shift = lift(gains.noise_bound), _noise_shift(plant)
    constant = [middle + L @ shift, 2 * (radius + (L + Q) @ V + Q @ shift)]
    inputs = _by_source([constant, [L, 2 * Q], [B, 2 * B_sum]])
    return _Block(centre, across, inputs)


def _jump(plant: _Nominal, stated: Array) -> _Block:
    """At a jump x+ = G x."""
    gains, lift = plant.gains, plant.lift
    if gains.jump_measurement == "after":
        return _jump_before_sample(plant, stated)
    G, identity = plant.frame.similar(stated), np.eye(gains.n, dtype=np.int64)
    is_measured = gains.jump_measurement == "before"
    M = plant.M if is_measured else 0 * plant.M
    halves = (lift(half) for half in gains.jump_split)
    centre = _sum(completed_split(G - M @ plant.C, *halves))
    S, T = plant.corrected("G", gains.jump_correction if is_measured else None)
    across = S + (abs(M) + T) @ plant.C_sum
    middle, radius = plant.disturbance(gains.jump_disturbance, identity)
    E, E_sum = plant.known("E", identity)
    V, shift = lift(gains.noise_bound), _noise_shift(plant)
    constant = [middle + abs(M) @ shift, 2 * (radius + (abs(M) + T) @ V + T @ shift)]
    inputs = _by_source([constant, [abs(M), 2 * T], [E, 2 * E_sum]])
    return _Block(centre, across, inputs)


def _jump_before_sample(plant: _Nominal, stated: Array) -> _Block:
    """The same with a measurement after the jump."""
    gains, frame, M = plant.gains, plant.frame, abs(plant.M)
    G, identity = frame.similar(stated), np.eye(gains.n, dtype=np.int64)
    X = identity - plant.M @ plant.C
    halves = (plant.lift(half) for half in gains.jump_split)
    centre = _sum(completed_split(X @ G, *halves))
    effects = [frame.similar(Y) for Y in plant.form.on("G")]
    shown = M @ plant.C_sum
    added = total((X @ Y for Y in effects), G)
    through = shown @ (abs(G) + total(effects, G))
    middle, radius = plant.disturbance(gains.jump_disturbance, identity)
    own_middle, own_radius = plant.disturbance(gains.jump_disturbance, X)
    E, E_sum = plant.known("E", X)
    plain, plain_sum = plant.known("E", identity)
    V, shift = plant.lift(gains.noise_bound), _noise_shift(plant)
    constant = [own_middle + M @ shift, 2 * (own_radius + M @ V + shown @ (middle + radius))]
    inputs = _by_source([constant, [M, 0 * M], [E, 2 * (E_sum + shown @ (plain + plain_sum))]])
    return _Block(centre, added + through, inputs)


def _noise_shift(plant: _Nominal) -> Array:
    """|middle of the noise|, (p,), which is taken from y."""
    centre = plant.gains.noise_centre
    return 0 * abs(plant.C[:, 0]) if centre is None else abs(plant.lift(centre))


def _by_source(blocks: list[list[Array]]) -> Array:
    """Columns of (mu, 2 r), of vectors or matrices."""
    columns = [[part.reshape(len(part), -1) for part in pair] for pair in blocks]
    return np.hstack([np.vstack(pair) for pair in columns])


def _sum(halves: tuple[Array, Array]) -> Array:
    return halves[0] + halves[1]


def total(matrices: Iterable[Array], like: Array) -> Array:
    """The sum of |X|, of the shape of `like`."""
    result = 0 * like
    for X in matrices:
        result = result + abs(X)
    return result
