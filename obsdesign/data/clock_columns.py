"""Columns of named events and sensors in a data file: blank where nothing happened."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from obsdesign.column_names import EVENT, RECEIVED, signal_columns
from obsdesign.data.bound_columns import number_in
from obsdesign.errors import InputError

# other columns that a record may have, which say nothing of events and sensors
_OTHER = re.compile(r"t|[a-z]\d+(_(lo|hi|std))?|jump|status|received|mode|event")


@dataclass(frozen=True)
class Happening:
    """y (p,) and w (l,) of all sensors and events, NaN where there is none; events that happen.

    received: when the row arrived, None where it is not stated.
    """

    y: Array | None
    w: Array | None
    events: tuple[int, ...]
    received: float | None


@dataclass(frozen=True)
class ClockColumns:
    """Names of events with their numbers of known inputs, and of sensors with their outputs.

    lag: time after which a row is final, the longest `report_delay` plus the largest `time_error`;
    errors: `time_error` of each event; sees_after (p,): does an output see the state after an event
    of its time? silence_counts: does a row without a sample of a sensor
    that sends on change say that there was none?
    """

    events: Mapping[str, int]
    sensors: Mapping[str, int]
    lag: float = 0.0
    errors: tuple[float, ...] = ()
    silence_counts: bool = False
    sees_after: tuple[bool, ...] = ()

    @classmethod
    def from_problem(cls, problem: Entries, *, has_events: bool = True) -> ClockColumns | None:
        """Those of a problem as a dict; None where it has [jump] and [output].

        has_events: False for an observer that is not told when events happen.
        """
        if "sensor" not in problem:
            return None
        events = problem.get("event", ()) if has_events else ()
        delays = [block.get("report_delay", 0.0) for block in (*events, *problem["sensor"])]
        errors = tuple(event.get("time_error", 0.0) for event in events)
        return cls(
            {event["name"]: len(event["E"][0]) if "E" in event else 0 for event in events},
            {sensor["name"]: len(sensor["C"]) for sensor in problem["sensor"]},
            max(delays) + max(errors, default=0.0),
            errors if any(errors) else (),
            any("sends_on_change" in sensor for sensor in problem["sensor"]),
            tuple(own.get("sees") == "after" for own in problem["sensor"] for _ in own["C"]),
        )

    @cached_property
    def of_sensors(self) -> tuple[str, ...]:
        """Columns of all sensors, in their order."""
        return tuple(x for name, p in self.sensors.items() for x in signal_columns(name, p))

    def of_event(self, name: str) -> tuple[str, ...]:
        """Columns of an event: its inputs, or one that says that it happened."""
        return signal_columns(name, max(self.events[name], 1))

    def required(self, header: Sequence[str]) -> tuple[str, ...]:
        """Columns that a file must have; a column `event` stands for those without inputs."""
        if EVENT in header:
            listed = [name for name, inputs in self.events.items() if inputs]
        else:
            listed = list(self.events)
        return (*self.of_sensors, *(x for name in listed for x in self.of_event(name)))

    @property
    def optional(self) -> tuple[str, ...]:
        """Columns that a file may have besides."""
        return (EVENT, RECEIVED, *(x for name in self.events for x in self.of_event(name)))

    def unknown(self, header: Sequence[str]) -> list[str]:
        """Columns that look like those of events and sensors, and are of none."""
        known = {*self.of_sensors, *self.optional}
        plain = [x for x in header if x not in known and re.fullmatch(r"[a-z][a-z0-9_]*", x)]
        return [x for x in plain if not _OTHER.fullmatch(x) or re.fullmatch(r"[yw]\d+|jump", x)]

    def of_row(self, cells: Sequence[str], places: Mapping[str, int], where: str) -> Happening:
        """What happened at a line; InputError for what an event cannot have."""
        y = _numbers(cells, places, self.of_sensors, where)
        named = self._named(cells, places, where)
        events, inputs = [], []
        for k, (name, count) in enumerate(self.events.items()):
            happens, own = self._event(cells, places, name, where)
            if happens or name in named:
                events.append(k)
                if count and np.isnan(own).any():
                    titles = ", ".join(self.of_event(name))
                    raise InputError(f"{where}: {titles} must hold numbers at the event {name}.")
            inputs.append(own)
        w = np.concatenate(inputs) if any(self.events.values()) else None
        received = number_in(cells, places, RECEIVED, where) if RECEIVED in places else None
        return Happening(None if np.isnan(y).all() else y, w, tuple(events), received)

    def _event(
        self, cells: Sequence[str], places: Mapping[str, int], name: str, where: str
    ) -> tuple[bool, Array]:
        """(does its column say that it happens?, its known inputs)."""
        titles = [title for title in self.of_event(name) if title in places]
        values = _numbers(cells, places, titles, where)
        if self.events[name]:
            return bool(np.isfinite(values).any()), values
        for title, value in zip(titles, values.tolist(), strict=True):
            if value not in (0.0, 1.0) and not np.isnan(value):
                raise InputError(
                    f"{where}: {title} must be 1 at the event and empty elsewhere; got {value!r}."
                )
        return bool((values == 1.0).any()), np.zeros(0)

    def _named(
        self, cells: Sequence[str], places: Mapping[str, int], where: str
    ) -> tuple[str, ...]:  # fmt: skip
        """Names in the column `event`."""
        text = cells[places[EVENT]].strip() if EVENT in places else ""
        names = tuple(name.strip() for name in text.split("+")) if text else ()
        for name in names:
            if name not in self.events:
                known = ", ".join(self.events) or "no events"
                raise InputError(f"{where}: event must be one of {known}; got {name!r}.")
        if len(set(names)) < len(names):
            raise InputError(
                f"{where}: event must name each event once; got {text!r}. Two of a name need two "
                "rows."
            )
        return names


def _numbers(
    cells: Sequence[str], places: Mapping[str, int], titles: Sequence[str], where: str
) -> Array:
    values = [number_in(cells, places, title, where) for title in titles]
    return np.array([np.nan if value is None else value for value in values])
