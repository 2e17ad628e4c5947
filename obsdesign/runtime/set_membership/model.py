"""The plant of a multiplier observer in balanced units: z = scales * x, powers of two.

All products with powers of two are exact, so that every number below is that of the design; where
one would leave the range of floats, the plant's own units are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.units import balance
from obsdesign.equations.clocks import EventGains
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
class JumpModel:
    """z+ = G z + inputs w + c, c from a box: one of the events of a plant. inputs: E."""

    G: Matrix
    inputs: Matrix
    c: Disturbance


@dataclass(frozen=True)
class Model:
    """Matrices in z; scales (n,): z = scales * x. inputs: B; jumps: of every event.

    dt: step of discrete time, None for a flow.
    """

    scales: Matrix
    A: Matrix
    C: Matrix
    inputs: Matrix
    flow: Disturbance
    jumps: tuple[JumpModel, ...]
    dt: float | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def width(self) -> int:
        """Number of disturbance columns that every table has room for."""
        return max(len(b.active) for b in (self.flow, *(jump.c for jump in self.jumps)))


def observer_model(gains: SetMembershipGains) -> Model:
    """The model of a design."""
    jumps = [event.G for event in gains.every_event]
    scales = balance(np.stack([gains.A, *jumps]) if jumps else gains.A)
    model = _scaled(gains, scales)
    return model if _is_exact(gains, model) else _scaled(gains, np.ones(gains.n))


def _scaled(gains: SetMembershipGains, scales: Matrix) -> Model:
    ratio, column, n = scales[:, None] / scales[None, :], scales[:, None], gains.n
    B = np.zeros((n, 0)) if gains.B is None else gains.B
    return Model(
        scales=scales, A=gains.A * ratio, C=gains.C / scales, inputs=B * column,
        flow=_disturbance(*gains.flow_disturbance, column),
        jumps=tuple(
            JumpModel(
                event.G * ratio, _inputs(event) * column, _disturbance(*event.disturbance, column)
            )
            for event in gains.every_event
        ),
        dt=gains.dt,
    )  # fmt: skip


def _inputs(event: EventGains) -> Matrix:
    return np.zeros((len(event.G), 0)) if event.E is None else event.E


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
    for factors in (gains.flow_factors, gains.jump_factors):
        own = factors.rows[:, : gains.n]
        pairs.append((own / s * s, own))
    if gains.B is not None:
        pairs.append((model.inputs / column, gains.B))
    for jump, event in zip(model.jumps, gains.every_event, strict=True):
        pairs.append((jump.G / ratio, event.G))
        pairs.append((jump.c.matrix / column, event.disturbance[0]))
        pairs.append((jump.inputs / column, _inputs(event)))
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
