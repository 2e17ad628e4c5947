"""Gains of the multiplier observer: what a design of kind `set_membership` stores."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix, NewEntries, Value
from obsdesign.equations.clocks import EventGains, SensorGains, clock_data
from obsdesign.equations.gains import plant_data
from obsdesign.equations.parameters import EffectGains
from obsdesign.equations.plant import Flow, Plant
from obsdesign.equations.set_membership.effects import Factors, factored
from obsdesign.equations.shaped_gains import ShapedGains, present, shaped_entries
from obsdesign.equations.stored import blocks, count, matrix, number, word

MEASURED = ("continuous", "periodic", "at_jumps")
IRREGULAR = "irregular"


@dataclass(frozen=True, kw_only=True, eq=False)
class SetMembershipGains(ShapedGains):
    """The plant's numbers, and how far back and for which directions bounds are computed.

    window: number of stages (steps of time and jumps) that a bound looks back at; steps: of the
    search for multipliers in each row. fixed_lag: bounds of the state that many rows ago are given
    as well, None for none. directions (r, n): rows l of further bounds of l'x. measured, period:
    when a sample is due.

    events, sensors: those of a plant with several clocks, which has no other entries of a jump; its
    outputs are those of all sensors, one above the other, and measured is "irregular".

    spacing: least time between events of different names, None for none.

    D (n, q), d_lower, d_upper (q,): an unknown input d between these bounds acts as D d, None
    without one; d_rate (q,): bounds of |d'|, with which d is estimated too, None for any.

    effects: what each parameter of an uncertain plant adds as it goes from 0 to 1, A, B, G, E and C
    being nominal; rounding: what these leave out of exact ones. Where x is known to stay in a box,
    flow_effect, jump_effect bound them there along each column of their factors, for known inputs
    up to input_bound (m,) and jump_input_bound (l,) where these are stated, and output_effect (p,)
    what they add to y; else these are None. state_tube (n,): of a proved box, which holds once |x|
    <= state_tube, just after a jump if there are any; None of one that is stated.

    multipliers (phases, n, window, p): of upper bounds of x_1 ... x_n for a full window of the
    nominal pattern, oldest stage first; those of lower bounds are their negatives. They are sound
    for every record, and tight where the stages of the window are those of the pattern.
    """

    noise_bound: Array = matrix("p")
    window: int = count()
    steps: int = count()
    fixed_lag: int | None = count(optional=True)
    directions: Array | None = matrix("r", "n", optional=True)
    events: tuple[EventGains, ...] = blocks(EventGains)
    sensors: tuple[SensorGains, ...] = blocks(SensorGains)
    spacing: float | None = number(optional=True)
    measured: str = word(*MEASURED, IRREGULAR)
    period: float | None = number(optional=True)
    D: Array | None = matrix("n", "q", optional=True)
    d_lower: Array | None = matrix("q", optional=True)
    d_upper: Array | None = matrix("q", optional=True)
    d_rate: Array | None = matrix("q", optional=True)
    effects: tuple[EffectGains, ...] = blocks(EffectGains)
    rounding: tuple[EffectGains, ...] = blocks(EffectGains)
    flow_effect: Array | None = matrix("e", optional=True)
    jump_effect: Array | None = matrix("f", optional=True)
    output_effect: Array | None = matrix("p", optional=True)
    state_lower: Array | None = matrix("n", optional=True)
    state_upper: Array | None = matrix("n", optional=True)
    state_tube: Array | None = matrix("n", optional=True)
    input_bound: Array | None = matrix("m", optional=True)
    jump_input_bound: Array | None = matrix("l", optional=True)
    multipliers: Array | None = matrix("phases", "n", "window", "p", optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_together("D", "d_lower", "d_upper")
        if any(len(event.G) != self.n for event in self.events):
            raise ValueError("gains.events must have one row per state.")
        if self.sensors and sum(sensor.outputs for sensor in self.sensors) != self.p:
            raise ValueError("gains.sensors must have all outputs between them.")
        if self.multipliers is not None and self.multipliers.shape[2] != self.window:
            raise ValueError(
                f"gains.multipliers must have one entry for each of the {self.window} stages of "
                f"the window; got {self.multipliers.shape[2]}."
            )

    @classmethod
    def from_plant(cls, plant: Plant, **gains: Value) -> Self:
        """Gains with the numbers of a plant, which has the attributes of `obsdesign.Plant`."""
        return cls(**plant_entries(plant), **gains)

    @property
    def flow_disturbance(self) -> tuple[Array, Array, Array]:
        """(Bw, lower, upper) of w, d, effects of parameters: all of it is Bw w, w in the box."""
        declared = self.declared_disturbance
        if self.D is not None:
            declared = _beside(declared, (self.D, present(self.d_lower), present(self.d_upper)))
        return _beside(declared, _of_effects(self.flow_factors, self.flow_effect))

    @cached_property
    def flow_factors(self) -> Factors:
        """Effects on the flow, rows of (x, u)."""
        return factored(self.effects_on("A", "B"), (self.n, self.n + self.inputs_of("B")))

    @cached_property
    def jump_factors(self) -> Factors:
        """Effects on the jump, rows of (x, w)."""
        return factored(self.effects_on("G", "E"), (self.n, self.n + self.inputs_of("E")))

    def effects_on(self, state: str, known: str) -> list[Matrix]:
        """Effects (n, n + inputs) on two matrices, those of rounding included."""
        count, listed = self.inputs_of(known), []
        for effect in (*self.effects, *self.rounding):
            X, Y = getattr(effect, state), getattr(effect, known)
            if X is not None or Y is not None:
                X = np.zeros((self.n, self.n)) if X is None else X
                listed.append(np.hstack([X, np.zeros((self.n, count)) if Y is None else Y]))
        return listed

    def inputs_of(self, name: str) -> int:
        """Number of columns of B or E."""
        matrix = {"B": self.B, "E": self.E}[name]
        return 0 if matrix is None else matrix.shape[1]

    @property
    def columns(self) -> dict[str, int | bool]:
        """Numbers of y, u and w in a sample, w of all events, and whether jumps are reported."""
        if not self.sensors:
            return super().columns
        w = sum(event.inputs for event in self.events)
        return {"y": self.p, "u": self.m, "w": w, "jump": bool(self.events)}

    @cached_property
    def every_event(self) -> tuple[EventGains, ...]:
        """All events; the jump of a plant with one clock is one."""
        if self.G is None:
            return self.events
        matrix, lower, upper = _beside(
            self.jump_disturbance, _of_effects(self.jump_factors, self.jump_effect)
        )
        is_plain = self.jump_disturbance_matrix is None and not len(self.jump_factors.rows)
        return (
            EventGains(
                name="jump", G=self.G, E=self.E, lower=lower, upper=upper,
                disturbance_matrix=None if is_plain else matrix,
                dwell_time=self.dwell_time,
            ),
        )  # fmt: skip


def _beside(
    first: tuple[Array, Array, Array], second: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """Columns and bounds of two disturbances side by side."""
    if not second[0].shape[1]:
        return first
    columns = np.hstack([first[0], second[0]])
    lower, upper = (np.concatenate([first[k], second[k]]) for k in (1, 2))
    return columns, lower, upper


def _of_effects(factors: Factors, bounds: Array | None) -> tuple[Array, Array, Array]:
    """Columns of effects with their bounds, 1 where none are stated."""
    sizes = np.ones(factors.columns.shape[1]) if bounds is None else bounds
    return factors.columns, -sizes, sizes


def plant_entries(plant: Plant) -> NewEntries:
    """The plant's numbers that this kind stores."""
    entries = plant_data(plant) if plant.has_one_clock else clock_data(plant)
    if plant.flow.disturbance_matrix is not None:
        flow = plant.flow
        entries |= shaped_entries("", flow.disturbance_matrix, flow.lower, flow.upper)
    if plant.flow.d_bounds is not None:
        entries |= _unknown_input(plant.flow)
    if not plant.has_one_clock:
        return entries | {"measured": IRREGULAR}
    if plant.output.period is not None:
        entries["period"] = plant.output.period
    if plant.jump is not None and plant.jump.disturbance_matrix is not None:
        entries |= shaped_entries("jump_", *plant.jump.shaped_disturbance)
    return entries | {"measured": plant.output.measured}


def _unknown_input(flow: Flow) -> NewEntries:
    """The bounded unknown input, which is then no part of the bounds of b."""
    own = flow.d_bounds
    assert own is not None
    ends = dict(zip(("flow_lower", "flow_upper"), flow.disturbance_box(), strict=True))
    rate = {} if own.rate is None else {"d_rate": own.rate}
    return {**ends, "D": flow.D, "d_lower": own.lower, "d_upper": own.upper, **rate}
