"""The plant of a multiplier observer in balanced units: z = scales * x, powers of two.

All products with powers of two are exact, so that every number below is that of the design; where
one would leave the range of floats, the plant's own units are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.units import balance
from obsdesign.equations.set_membership.gains import SetMembershipGains

_SUBNORMAL = 1e-290


@dataclass(frozen=True)
class Disturbance:
    """b = matrix w with lower <= w <= upper (or c); active: columns whose box is not one point.

    matrix (n, k); lower, upper (k,).
    """

    matrix: Matrix
    lower: Matrix
    upper: Matrix
    active: Indices


@dataclass(frozen=True)
class Model:
    """Matrices in z; scales (n,): z = scales * x. inputs, jump_inputs: B and E.

    jump: None without jumps, as is G.
    """

    scales: Matrix
    A: Matrix
    C: Matrix
    inputs: Matrix
    flow: Disturbance
    G: Matrix | None
    jump_inputs: Matrix
    jump: Disturbance | None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def width(self) -> int:
        """Number of disturbance columns that every table has room for."""
        jump = 0 if self.jump is None else len(self.jump.active)
        return max(len(self.flow.active), jump)


def observer_model(gains: SetMembershipGains) -> Model:
    """The model of a design."""
    maps = gains.A if gains.G is None else np.stack([gains.A, gains.G])
    scales = balance(maps)
    model = _scaled(gains, scales)
    return model if _is_exact(gains, model) else _scaled(gains, np.ones(gains.n))


def _scaled(gains: SetMembershipGains, scales: Matrix) -> Model:
    ratio, column = scales[:, None] / scales[None, :], scales[:, None]
    n, has_jumps = gains.n, gains.G is not None
    B = np.zeros((n, 0)) if gains.B is None else gains.B
    E = np.zeros((n, 0)) if gains.E is None else gains.E
    return Model(
        scales=scales, A=gains.A * ratio, C=gains.C / scales, inputs=B * column,
        flow=_disturbance(*gains.flow_disturbance, column),
        G=None if gains.G is None else gains.G * ratio, jump_inputs=E * column,
        jump=_disturbance(*gains.jump_disturbance, column) if has_jumps else None,
    )  # fmt: skip


def _disturbance(matrix: Matrix, lower: Matrix, upper: Matrix, column: Matrix) -> Disturbance:
    scaled = matrix * column
    active = np.flatnonzero((lower < upper) & (matrix != 0).any(axis=0))
    return Disturbance(scaled, lower, upper, active)


def _is_exact(gains: SetMembershipGains, model: Model) -> bool:
    """Do all products with the scales give the entries of the design back?"""
    s = model.scales
    ratio, column = s[:, None] / s[None, :], s[:, None]
    pairs = [
        (model.A / ratio, gains.A), (model.C * s, gains.C),
        (model.flow.matrix / column, gains.flow_disturbance[0]),
    ]  # fmt: skip
    if gains.B is not None:
        pairs.append((model.inputs / column, gains.B))
    if gains.G is not None and model.G is not None and model.jump is not None:
        pairs.append((model.G / ratio, gains.G))
        pairs.append((model.jump.matrix / column, gains.jump_disturbance[0]))
        if gains.E is not None:
            pairs.append((model.jump_inputs / column, gains.E))
    return all(np.array_equal(back, own) for back, own in pairs)


def unscaled(box: Matrix, scales: Matrix) -> Matrix:
    """Bounds of x from those of z: exact unless they underflow."""
    return rescaled(box, 1.0 / scales)


def rescaled(box: Matrix, factors: Matrix) -> Matrix:
    """A box (2, n) times powers of two, (n,), outward where entries underflow."""
    scaled = box * factors
    is_small = (np.abs(scaled) < _SUBNORMAL) & (box != 0.0)
    ends = np.stack([np.nextafter(scaled[0], -np.inf), np.nextafter(scaled[1], np.inf)])
    return np.where(is_small, ends, scaled)
