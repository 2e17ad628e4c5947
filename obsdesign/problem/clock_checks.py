"""Events and sensors that fit each other: names, columns, what a sensor is read at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from obsdesign.errors import InputError
from obsdesign.problem.clocks import Event, Sensor
from obsdesign.problem.names import RESERVED


def check_clocks(events: Sequence[Event], sensors: Sequence[Sensor]) -> None:
    """InputError where names meet, or a sensor is read at an event that is none."""
    titles = Counter[str]()
    clocks: list[Event | Sensor] = [*events, *sensors]
    for each in clocks:
        titles.update(each.columns)
        for title in filter(RESERVED.fullmatch, each.columns):
            raise InputError(
                f"{each.entry}: its column is {title!r}, a name that data files have for another "
                "one; give another name."
            )
    for title, count in titles.items():
        if count > 1:
            raise InputError(
                f"events and sensors must differ in name; column {title!r} is doubled."
            )
    names = [event.name for event in events]
    for sensor in sensors:
        if sensor.at is not None and sensor.at not in names:
            raise InputError(
                f"{sensor.entry}.at must be the name of an event ({', '.join(names) or 'none'}); "
                f"got {sensor.at!r}."
            )
    uncertain = [event.name for event in events if event.time_error]
    for sensor in sensors:
        if sensor.at in uncertain:
            raise InputError(
                f"{sensor.entry}.at must be an event whose time is known; {sensor.at!r} has "
                "time_error. A sensor that is read at a known time has `every`."
            )
