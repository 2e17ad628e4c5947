"""Rows of a simulation: when events happen, when sensors are read, and the rows between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation.discrete_times import on_steps, require_steps
from obsdesign.data.simulation.event_spacings import random_spacings
from obsdesign.data.simulation.event_times import event_times
from obsdesign.data.simulation.stays import ModeTimes, longest_stay, mode_times
from obsdesign.errors import InputError
from obsdesign.problem.clocks import Event, Every, Sensor
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant

# exponent by which an unstable mode may grow in a default simulation
_LARGEST_EXPONENT = 6.0
_MOST_ROWS = 1e7
_SAME_INSTANT = 1e-9  # time stamps closer than this part of a step are one instant
# of the longest stated times between events and samples, for which a default simulation lasts
_LASTING = 10

Dwell = str | float | Sequence[float]


class UncertainEvent(NamedTuple):
    """An event at a time of its own; row: that of its stamp; event: its place."""

    t: float
    row: int
    event: int


@dataclass(frozen=True)
class Instants:
    """Times of all rows; which events happen (rows, events), which outputs are known (rows, p).

    modes: changes of mode, which are rows too; None without modes. received: when each row
    arrives, None where all do at their time. true_times (rows, events): when events of a row really
    happen, at its time where their stamps are exact. start: when the state is the initial one.
    """

    times: Matrix
    happens: NDArray[np.bool_]
    is_measured: NDArray[np.bool_]
    modes: ModeTimes | None = None
    received: Matrix | None = None
    true_times: Matrix | None = None
    start: float = 0.0

    def exact_events(self) -> NDArray[np.bool_]:
        """Events that happen at their rows, (rows, events)."""
        if self.true_times is None:
            return self.happens
        return np.asarray(self.happens & (self.true_times == self.times[:, None]))

    def uncertain_events(self) -> list[UncertainEvent]:
        """Events that happen before or after their rows, in order."""
        if self.true_times is None:
            return []
        places = np.argwhere(self.happens & ~self.exact_events()).tolist()
        return sorted(UncertainEvent(float(self.true_times[k, e]), k, e) for k, e in places)


def true_times(plant: Plant, instants: Instants, rng: np.random.Generator) -> Matrix | None:
    """When the events of each row happen, (rows, events); None where all stamps are exact.

    Drawn within `time_error` of the row, not before the first one.
    """
    errors = np.array([event.stamp_error for event in plant.events])
    if not errors.any():
        return None
    drawn = rng.uniform(-1.0, 1.0, instants.happens.shape) * errors
    return np.asarray(np.maximum(instants.times[:, None] + drawn, instants.times[0]))


def instants_of(
    plant: Plant, dwell: Dwell, until: float, step: float | None, rng: np.random.Generator
) -> Instants:
    """All rows up to a time; InputError where two of them fall together.

    dwell: of events, as for `simulate`; step: between rows without event or sample, None for its
    default: none where every sensor keeps its own times.
    """
    if len(plant.events) > 1 and not isinstance(dwell, str):
        names = ", ".join(event.name for event in plant.events)
        raise InputError(f"dwell must be random or shortest for several events ({names}).")
    dt = plant.flow.dt
    # events of a plant with modes come at times that depend on its changes of mode
    events = [] if plant.modes else event_times(plant, dwell, until, rng)
    spacing = _default_step(plant, until) if step is None else step
    # a sample that is due at the last step may be drawn a little after it
    samples = [_sample_times(sensor, until + (dt or 0.0), rng) for sensor in plant.sensors]
    always = [_is_read_at_every_row(sensor) for sensor in plant.sensors]
    has_grid = step is not None or any(always) or _period(plant) > 0 or dt is not None
    # of several clocks t = 0 is a row, where nothing has happened yet
    grid = _grid(spacing, until) if has_grid else np.zeros(0 if plant.has_one_clock else 1)
    changes = mode_times(plant.modes, dwell, until, rng) if plant.modes else None
    events = events if changes is None else event_times(plant, dwell, until, rng, changes)
    listed = [*events, *samples, np.zeros(0) if changes is None else changes.times, grid]
    listed = listed if dt is None else _on_steps(listed, dt, spacing, until)
    times, rows = _merged(listed, _SAME_INSTANT * spacing)
    if any(len(np.unique(own)) < len(own) for own in rows) or not (np.diff(times) > 0).all():
        raise InputError(
            f"until = {until:g} and step = {spacing:g} leave rows closer than 1e-12 apart; "
            "choose a smaller unit of time."
        )
    happens = np.zeros((len(times), len(events)), bool)
    for k, own in enumerate(rows[: len(events)]):
        happens[own, k] = True
    measured = np.zeros((len(times), len(samples)), bool)
    if changes is not None:  # a row of the grid next to a change is the change
        changes = replace(changes, times=times[rows[-2]])
    for k, own in enumerate(rows[len(events) : -2]):
        measured[own, k] = True
        measured[:, k] |= always[k]
    return Instants(times, happens, _outputs_measured(plant, happens, measured), changes)


def _on_steps(listed: list[Matrix], dt: float, spacing: float, until: float) -> list[Matrix]:
    """The lists of times in discrete time; InputError for a spacing between its steps."""
    require_steps(spacing, dt, "step")
    _grid(dt, until)  # not more steps than rows may be
    return [on_steps(own, dt, until) for own in listed]


def arrival_times(plant: Plant, instants: Instants, rng: np.random.Generator) -> Matrix | None:
    """When each row arrives, (rows,), with the last report in it; None if all arrive at once.

    Every delay is drawn between zero and the `report_delay` of its event or sensor.
    """
    blocks = (*plant.events, *plant.sensors)
    delays = [x.report_delay if isinstance(x, Event | Sensor) else 0.0 for x in blocks]
    if not any(delays):
        return None
    counts = [1] * len(plant.events) + [len(sensor.C) for sensor in plant.sensors]
    there = np.hstack([instants.happens, instants.is_measured])
    drawn = rng.uniform(0.0, 1.0, (len(there), len(delays))) * delays
    waits = np.where(there, np.repeat(drawn, counts, axis=1), 0.0).max(axis=1)
    later = np.maximum(np.round(instants.times + waits, 12), instants.times)
    return np.asarray(np.where(waits > 0, later, instants.times))


def _outputs_measured(
    plant: Plant, happens: NDArray[np.bool_], measured: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(rows, p) from the samples of sensors on their own clocks, (rows, sensors)."""
    names, columns = [event.name for event in plant.events], []
    for k, sensor in enumerate(plant.sensors):
        own = measured[:, k]
        if sensor.event is not None:
            own = happens[:, names.index(sensor.event)]
        elif sensor.jump_measurement == "none":
            own = own & ~happens.any(axis=1)
        columns += [own] * len(sensor.C)
    return np.column_stack(columns)


def _sample_times(sensor: Output, until: float, rng: np.random.Generator) -> Matrix:
    """Times of a sensor's samples on a clock of its own; none where rows or events give them."""
    every: Every | str | None = sensor.period if sensor.measured == "periodic" else None
    if isinstance(sensor, Sensor):
        every = sensor.every
    if every is None or isinstance(every, str) or _is_read_at_every_row(sensor):
        return np.zeros(0)
    if not isinstance(every, tuple):
        return _about_grid(_grid(every, until), sensor, rng)
    low, high = every
    spacings = random_spacings(low, high, math.inf, until, rng)
    times = np.round(np.cumsum(np.fromiter(spacings, float)), 12)
    return np.asarray(times[times <= until])


def _is_read_at_every_row(sensor: Output) -> bool:
    """Is it read at every row? What one that sends on change then sends depends on its reading."""
    return sensor.measured == "continuous" or sensor.sends_on_change is not None


def _about_grid(grid: Matrix, sensor: Output, rng: np.random.Generator) -> Matrix:
    """A grid without lost samples, each as far from its point as the jitter allows."""
    if not isinstance(sensor, Sensor) or not (sensor.losses or sensor.jitter):
        return grid
    kept = np.cumsum(rng.integers(1, sensor.losses + 2, len(grid))) - 1
    grid = grid[kept[kept < len(grid)]]
    times = np.round(grid + sensor.jitter * rng.uniform(-1, 1, len(grid)), 12)
    return np.sort(np.clip(times, 0.0, grid[-1] if len(grid) else 0.0))


def _merged(listed: Sequence[Matrix], least: float) -> tuple[Matrix, list[NDArray[np.intp]]]:
    """Times of all lists in order, and the rows of each list.

    Times up to `least` apart are one row, at the time that the first of the lists has.
    """
    every = np.concatenate(listed)
    order = np.argsort(every, kind="stable")
    row = np.empty(len(every), np.intp)
    row[order] = np.cumsum(np.diff(every[order], prepend=-math.inf) > least) - 1
    first = np.full(len(np.unique(row)), len(every))
    np.minimum.at(first, row, np.arange(len(every)))
    ends = np.cumsum([len(own) for own in listed])[:-1]
    return every[first], list(np.split(row, ends))


def default_until(plant: Plant, dwell: Dwell) -> float:
    """Ten dwell times where there are jumps, else 200 samples or what the slowest mode takes."""
    if plant.modes:
        return _LASTING * longest_stay(plant.modes)
    if not plant.has_one_clock:
        return _several_cycles(plant)
    if isinstance(dwell, int | float) and plant.jump is not None:
        return 10.0 * float(dwell)
    if plant.jump is None or plant.jump.dwell_time is None:
        return settled(plant)
    low, high = plant.jump.dwell_time
    typical = low if dwell == "shortest" else (low + high) / 2 if math.isfinite(high) else 2 * low
    return 10.0 * (typical or 1.0)


def _several_cycles(plant: Plant) -> float:
    """Ten times the longest stated time between two events of a name, or two samples."""
    ends = [end for event in plant.events for end in event.dwell_time or ()]
    stated = [*ends, *(sensor.gap for sensor in plant.sensors)]
    finite = [end for end in stated if math.isfinite(end) and end > 0]
    return _LASTING * max(finite) if finite else settled(plant)


def _period(plant: Plant) -> float:
    """Period of the one sensor; 0 where there is none."""
    return plant.output.sample_spacing if plant.has_one_clock else 0.0


def settled(plant: Plant) -> float:
    """200 sampling periods, or ten times the slowest mode's; less where x would grow far."""
    modes, period = np.linalg.eigvals(plant.flow.A), _period(plant)
    if plant.flow.dt is not None:
        period = period or plant.flow.dt
        modes = np.log(np.maximum(np.abs(modes), np.exp(-1.0))) / plant.flow.dt
    fastest = float(np.abs(modes).max())
    if fastest == 0 or not math.isfinite(fastest):
        return 200 * period or 10.0
    slowest = float(np.abs(modes[np.abs(modes) > 1e-6 * fastest]).min())
    until = 200 * period or min(10 / slowest, 1000 / fastest)
    growth = float(modes.real.max())
    if growth * until > _LARGEST_EXPONENT:
        until = max(_LARGEST_EXPONENT / growth, 50 * period)
    return float(f"{until:.2g}")


def _default_step(plant: Plant, until: float) -> float:
    if period := _period(plant) or plant.flow.dt:
        return period
    wanted = until / 500
    scale = 10.0 ** math.floor(math.log10(wanted))
    return float(
        scale * min((1.0, 2.0, 5.0, 10.0), key=lambda nice: abs(math.log(nice * scale / wanted)))
    )


def _grid(step: float, until: float) -> Matrix:
    if until / step > _MOST_ROWS:
        raise InputError(
            f"step = {step:g} makes {until / step:.4g} rows until {until:g}; "
            f"{_MOST_ROWS:g} is the limit."
        )
    rows = int(until / step * (1 + 1e-12)) + 1
    return np.asarray(np.round(step * np.arange(rows), 12), dtype=np.float64)
