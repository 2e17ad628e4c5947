"""Exact trajectories of a plant with jumps, inputs, disturbances and noise.

Nothing is integrated by steps: between two instants the state moves by a block exponential of
plant, held inputs and signal generators, so that the record is the solution to rounding. In
discrete time the step of the plant is repeated.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.column_names import MODE, TIME
from obsdesign.data.simulation.change_senders import ChangeSenders
from obsdesign.data.simulation.parameter_courses import (
    SignalsAtRows,
    drawn_courses,
    nominal_plant,
)
from obsdesign.data.simulation.record_columns import record_columns
from obsdesign.data.simulation.rows import (
    Instants,
    UncertainEvent,
    arrival_times,
    default_until,
    instants_of,
    true_times,
)
from obsdesign.data.simulation.signals import DISTURBANCES, Signals, signals
from obsdesign.data.simulation.stated_rows import StatedRows
from obsdesign.entries import positive
from obsdesign.equations.time_grid import rounded_steps
from obsdesign.errors import InputError
from obsdesign.problem.plant import Jump, Plant


@dataclass(frozen=True)
class Simulation:
    """A simulated run, one row per instant; x is the state after the row's jump.

    columns: t, y1.., u1.., w1.., jump, then the truth x1.., d1.. (ignored by observers); named
    events and sensors have columns of their own for y, w and jump, and `received` where they are
    reported with a delay. events: times and weights of
    unknown impulses, (t, weight1, ...). blocks: y, u, w, x, d, (rows, ...) each; happened (rows,
    events): which events happen, None where the record does not say.
    """

    columns: dict[str, Array]
    events: Matrix
    blocks: dict[str, Matrix]
    happened: NDArray[np.bool_] | None

    @property
    def t(self) -> Matrix:
        """Time stamps, (rows,)."""
        return self.columns[TIME]

    @property
    def mode(self) -> list[str] | None:
        """The mode from each row on; None where the plant has no modes."""
        return self.columns[MODE].tolist() if MODE in self.columns else None

    def block(self, letter: str) -> Matrix:
        """Signals y, u, w, x or d as one array (rows, number)."""
        return self.blocks[letter]


def simulate(
    plant: Plant,
    *,
    until: float | None = None,
    step: float | None = None,
    initial: ArrayLike | None = None,
    dwell: str | float | Sequence[float] = "random",
    disturbance: str = "random",
    rng: np.random.Generator | None = None,
    announced: bool = False,
    parameters: str | Mapping[str, float] = "random",
    rows: StatedRows | None = None,
) -> Simulation:
    """Simulate a plant from t = 0, by matrix exponentials from row to row: exact up to rounding.

    until, step: end and spacing of the rows, in the plant's time unit (default: ten dwell times,
    without jumps 200 periods or ten time constants of the slowest mode; the sampling period, else a
    round number near until/500, in discrete time a step). initial: x(0), (n,), default the middle
    of [state], without it ones, with parameters zeros. dwell:
    `shortest`, `random` (admissible), one dwell time, or a sequence of them, repeated in turn.
    disturbance: `zero` (the middle of every bound, no noise), `extreme` (a corner, held), `random`
    or `sine`. rng: a numpy Generator (default: seed 0). announced: the record has the times of
    impulses of unknown weight too, which every kind but `impulsive_input` needs. parameters: their
    course, constant between rows: `nominal`, `random`, `extreme`, `bang-bang`, or values by name.
    rows: those of a file, in place of until, step and dwell; initial is the state at the first.

    InputError for options that do not fit the plant, and where the state overflows.
    """
    if disturbance not in DISTURBANCES:
        raise InputError(
            f"disturbance must be one of {', '.join(DISTURBANCES)}; got {disturbance!r}."
        )
    rng = np.random.default_rng(0) if rng is None else rng
    x, uncertain, plant = _initial(plant, initial), plant, nominal_plant(plant)
    if rows is None:
        until = default_until(plant, dwell) if until is None else positive(until, "until")
        step = None if step is None else positive(step, "step")
        instants = instants_of(plant, dwell, until, step, rng)
    else:
        instants = rows.instants
    source = signals(plant, disturbance, len(instants.times), rng)
    source = source if rows is None else rows.signals(source)
    sources = _of_modes(source, disturbance, instants, rng)
    with np.errstate(over="ignore", invalid="ignore"):
        received, happened = arrival_times(plant, instants, rng), true_times(plant, instants, rng)
        instants = replace(instants, received=received, true_times=happened)
        values = drawn_courses(uncertain, parameters, len(instants.times), rng)
        courses = SignalsAtRows(uncertain, source, values) if uncertain.parameters else None
        record = _trajectory(x, instants, source, announced, sources, courses)
    _require_finite(record)
    return record if courses is None else _with_parameters(record, uncertain, values)


def _with_parameters(record: Simulation, plant: Plant, values: Matrix) -> Simulation:
    """The record with a column of each parameter, by its name."""
    names = [parameter.name for parameter in plant.parameters]
    return replace(record, columns=record.columns | dict(zip(names, values.T, strict=True)))


def _of_modes(
    source: Signals, disturbance: str, instants: Instants, rng: np.random.Generator
) -> list[Signals]:
    """The signals of each mode, with the same inputs; none without modes."""
    plant, rows = source.plant, len(instants.times)
    own = [signals(plant.in_mode(k), disturbance, rows, rng) for k in range(len(plant.modes))]
    return [each.with_inputs(source) for each in own]


def _require_finite(record: Simulation) -> None:
    finite = np.isfinite(record.block("x")).all(axis=1)
    if not finite.all():
        raise InputError(
            f"the state overflows at t = {record.t[np.argmin(finite)]:g}: the plant is unstable "
            "for these jumps; give a smaller --until."
        )


def _initial(plant: Plant, initial: ArrayLike | None) -> Matrix:
    n, box = plant.n, plant.state
    default = np.zeros(n) if plant.parameters else np.ones(n)  # 0 is in every box that is proved
    if box is not None:
        default = box.lower + (box.upper - box.lower) / 2
    x = default if initial is None else np.asarray(initial, dtype=np.float64)
    if x.shape != (n,) or not np.isfinite(x).all():
        raise InputError(f"initial must have {n} finite entries, one per state; got {x.tolist()}.")
    return x


def _trajectory(
    x: Matrix, instants: Instants, source: Signals, announced: bool, sources: Sequence[Signals],
    courses: SignalsAtRows | None,
) -> Simulation:  # fmt: skip
    """Step from row to row; matrices are shared between equal steps.

    sources: the signals of each mode, none where there are no modes; courses: those with the
    parameters of each row, None without any.
    """
    plant = source.plant
    after = plant.sees_after
    truth, outputs, events = [], [], []
    maps = defaultdict[int, dict[float, Matrix]](dict)
    now, pending = instants.start, instants.uncertain_events()
    at_rows = instants.exact_events()
    leading, following = _modes_at_rows(instants)
    senders, times = ChangeSenders.from_plant(plant), instants.times.tolist()
    for k, t in enumerate(times):
        mode = leading[k]
        if courses is not None:
            source, last = courses.at(k), source
            if source is not last:
                maps.clear()
        own = sources[mode] if sources else source
        while pending and pending[0].t <= t:
            x, now = _after_uncertain(pending.pop(0), own, x, k, now)
        before = x = _flowed(x, own, k, (now, t), maps[mode])
        happening = np.flatnonzero(at_rows[k]).tolist()
        for event in happening:
            x = np.asarray(source.plant.events[event].G @ x + source.jump(k, event))
        if any(plant.events[event].H is not None for event in happening):
            events.append([t, *source.weights_of(k, happening)])
        C = own.plant.outputs.C
        clean = np.where(after, C @ x, C @ before)
        # a row's measurement and events belong to the mode before
        if following[k] != mode:
            x = _entered(x, plant.modes[following[k]].entry_map)
        y = own.measurement(clean, k, t, instants.is_measured[k])
        outputs.append(senders.sent(y, t, times[k + 1] if k + 1 < len(times) else t))
        truth.append(x)
        now = t
    names = [plant.modes[mode].name for mode in following] if plant.modes else None
    return _record(instants, source, announced, (outputs, truth, events), names)


def _modes_at_rows(instants: Instants) -> tuple[list[int], list[int]]:
    """The mode that leads up to each row, and the one from it on; 0 without modes."""
    times, changes = instants.times, instants.modes
    if changes is None:
        return [0] * len(times), [0] * len(times)
    return changes.modes_before(times), changes.modes_of(times)


def _flowed(
    x: Matrix, source: Signals, row: int, span: tuple[float, float], maps: dict[float, Matrix]
) -> Matrix:
    """The state at the end of a span of time up to a row; maps: of this flow, by length."""
    start, end = span
    h, dt = end - start, source.plant.flow.dt
    if dt is not None:
        return source.stepped(x, row, start, rounded_steps(h, dt))
    if not h > 0:
        return x
    if h not in maps:
        maps[h] = expm(source.generator * h)[: len(x)]
    return np.asarray(maps[h] @ source.extended(x, row, start))


def _after_uncertain(
    event: UncertainEvent, source: Signals, x: Matrix, row: int, start: float
) -> tuple[Matrix, float]:
    """The state after an event on the way from `start` to a row, and its time."""
    if event.t > start:
        flow = expm(source.generator * (event.t - start))[: len(x)]
        x = flow @ source.extended(x, row, start)
    G = source.plant.events[event.event].G
    return np.asarray(G @ x + source.jump(event.row, event.event)), event.t


def _record(
    instants: Instants,
    source: Signals,
    announced: bool,
    rows: tuple[Sequence[Matrix], Sequence[Matrix], Sequence[Sequence[float]]],
    modes: Sequence[str] | None,
) -> Simulation:
    """The simulation of rows (outputs, states, impulses), and the mode of each row."""
    plant, (outputs, truth, events) = source.plant, rows
    blocks = {
        "y": np.array(outputs).reshape(len(instants.times), plant.p),
        "u": source.u,
        "w": np.where(source.of_inputs(instants.happens), source.w, np.nan),
        "x": np.array(truth).reshape(-1, plant.n),
        "d": source.unknown(instants.times),
    }
    # impulses of unknown weight alone come unannounced
    is_reported = announced or not all(_is_hidden(event, plant.n) for event in plant.events)
    happened = instants.happens if is_reported else None
    table = record_columns(plant, instants.times, blocks, happened, instants.received)
    table |= {} if modes is None else {MODE: np.array(modes)}
    weights = np.array(events).reshape(len(events), 1 + source.weights.shape[1])
    return Simulation(table, weights, blocks, happened)


def _entered(x: Matrix, G: Matrix | None) -> Matrix:
    """The state after the map on entry into a mode, None for the identity."""
    return x if G is None else np.asarray(G @ x)


def _is_hidden(event: Jump, n: int) -> bool:
    """Are its times unknown too? Those of impulses of unknown weight alone are."""
    return event.H is not None and np.array_equal(event.G, np.eye(n))
