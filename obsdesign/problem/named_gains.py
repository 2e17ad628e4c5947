"""Gains of named events and sensors: tables in a file, `dose.M` and `plasma.L` in a problem."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value
from obsdesign.entries import matrix, size_text, vector
from obsdesign.equations.saltation import Impact, Radii
from obsdesign.errors import InputError
from obsdesign.problem.clocks import Event
from obsdesign.problem.plant import Plant

# gain of a sensor at its samples, of an event at its jumps
OF_SENSOR, OF_EVENT = "L", "M"


def flattened(given: Entries, kind: str | None, plant: Plant) -> NewEntries:
    """Gains by one name each; those of one event or sensor as the kind has them for one clock.

    InputError for a table that is of no event or sensor, and for gains that need one clock where
    there are several.
    """
    tables = {name: value for name, value in given.items() if isinstance(value, Mapping)}
    flat = {name: value for name, value in given.items() if name not in tables}
    named = {
        f"{name}.{gain}": value for name, table in tables.items() for gain, value in table.items()
    }
    for entry in named:
        _check_owner(entry, plant)
    if plant.has_one_clock and not (kind == "interval" and plant.needs_clock_gains):
        return flat | {entry.rpartition(".")[2]: value for entry, value in named.items()}
    if kind is None:
        return flat | named
    for name, value in flat.items():
        named[_owned(name, plant)] = value
    return named


def clock_condition(plant: Plant) -> str:
    """For which plants kind `interval` lets step, samples and events act by themselves."""
    return "with several clocks" if plant.flow.dt is None else "in discrete time"


def nested(gains: Mapping[str, Matrix]) -> NewEntries:
    """Gains as a file has them: a table for each event and sensor."""
    result: NewEntries = {}
    for entry, value in gains.items():
        owner, _, gain = entry.rpartition(".")
        if owner:
            result.setdefault(owner, {})[gain] = value
        else:
            result[gain] = value
    return result


def sized(values: Value, entry: str, plant: Plant) -> Matrix:
    """The gain of an event or a sensor, with a column for each output it uses; else InputError."""
    owner, _, gain = entry.rpartition(".")
    result = matrix(values, f"observer.gains.{entry}")
    of, p = "of all sensors", plant.p
    if gain == OF_SENSOR:
        of, p = f"of {owner}", next(len(x.C) for x in plant.sensors if x.name == owner)
    if result.shape != (plant.n, p):
        hint = " Is it transposed?" if result.shape == (p, plant.n) else ""
        raise InputError(
            f"observer.gains.{entry} must be {plant.n}x{p} (n states, outputs {of}); got "
            f"{size_text(result)}.{hint}"
        )
    if gain == OF_EVENT and result[:, plant.sees_after].any():
        raise InputError(
            f"observer.gains.{entry} must be zero in the columns of sensors that see the state "
            "after events; their gain is L."
        )
    return result


def _check_owner(entry: str, plant: Plant) -> None:
    """InputError unless an entry is L of a sensor or M of an event."""
    owner, _, gain = entry.rpartition(".")
    is_listed = plant.has_tables or plant.needs_clock_gains
    listed = {
        OF_EVENT: [event.name for event in plant.events if is_listed],
        OF_SENSOR: [sensor.name for sensor in plant.sensors if is_listed],
    }
    if owner in listed[gain]:
        return
    if any(owner in names for names in listed.values()):
        what = "an event has M" if gain == OF_SENSOR else "a sensor has L"
        raise InputError(f"observer.gains.{owner}: {what}; got {gain}.")
    names = ", ".join(name for names in listed.values() for name in names) or "none"
    raise InputError(
        f"observer.gains.{owner} must be of an event or a sensor of the plant ({names})."
    )


def _owned(name: str, plant: Plant) -> str:
    """The name of a plain L or M of the one sensor or event; InputError for others."""
    owners = [x.name for x in plant.sensors if name == OF_SENSOR]
    owners += [x.name for x in plant.events if name == OF_EVENT]
    if name not in (OF_SENSOR, OF_EVENT):
        raise InputError(
            f"observer.gains.{name} is not available {clock_condition(plant)}: bounds are in the "
            "plant's own coordinates, and gains are L of a sensor and M of an event."
        )
    if len(owners) != 1:
        what = "sensor" if name == OF_SENSOR else "event"
        example = f"{{ {owners[0]} = {{ {name} = ... }} }}" if owners else "none"
        raise InputError(
            f"observer.gains.{name} is of one {what}; the plant has {len(owners)}. Write "
            f"observer.gains = {example}."
        )
    return f"{owners[0]}.{name}"


def refuse_triggers(plant: Plant, gains: Mapping[str, Matrix]) -> None:
    """InputError for an event with a trigger; gains: by name, zero where one is not given."""
    for place, event in enumerate(plant.events):
        if not isinstance(event, Event) or event.trigger is None:
            continue
        n, entry = plant.n, f"{event.entry}.trigger"
        ends = {key: vector(event.trigger[key], f"{entry}.{key}") for key in ("surface", "state")}
        for key, values in ends.items():
            if values.shape != (n,):
                raise InputError(f"{entry}.{key} must have {n} entries; got {values.size}.")
        b, c = (np.mean(bounds, axis=0) for bounds in (plant.flow.b_bounds, event.c_bounds))
        impact = Impact(plant.flow.A, b, event.G, c, *ends.values())
        speed = float(ends["surface"] @ (plant.flow.A @ ends["state"] + impact.b))
        if speed == 0:
            raise InputError(f"{entry}.state must cross the surface; its flow there is along it.")
        raise InputError(_reason(entry, _radii(plant, place, impact, gains)))


def _radii(plant: Plant, place: int, impact: Impact, gains: Mapping[str, Matrix]) -> Radii:
    event, shape = plant.events[place], (plant.n, plant.p)
    low, high = event.dwell_time or (1.0, math.inf)
    period = low if math.isinf(high) else (low + high) / 2
    L = np.hstack([
        gains.get(f"{sensor.name}.L", gains.get("L", np.zeros((plant.n, len(sensor.C)))))
        for sensor in plant.sensors
    ])  # fmt: skip
    M = gains.get(f"{event.name}.M", gains.get("M", np.zeros(shape)))
    return Radii.from_gains(impact, plant.outputs.C, np.asarray(L), np.asarray(M), period)


def _reason(entry: str, radii: Radii) -> str:
    return (
        f"{entry}: events that the estimate triggers are not offered: across one the error is "
        "multiplied by the saltation matrix Xi -+ M C, and with the flow between two of them its "
        f"spectral radius is {radii.observer_first:.4f} where the observer jumps first, "
        f"{radii.plant_first:.4f} where the plant does ({radii.reported:.4f} at reported times). "
        "Report the event, with time_error."
    )
