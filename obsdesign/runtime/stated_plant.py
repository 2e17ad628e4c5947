"""The plant of a problem as a dict, in blocks [flow], [jump] and [output]."""

from __future__ import annotations

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.entries import is_number


def plain_blocks(problem: Entries) -> Entries:
    """The blocks of a problem; of named events and sensors those with the same gains.

    Several sensors have one output of all rows. Several events have no such block.
    """
    sensors, events = problem.get("sensor"), problem.get("event", ())
    if not isinstance(sensors, list) or not all(isinstance(x, dict) for x in [*sensors, *events]):
        return problem
    blocks: NewEntries = {name: problem.get(name) for name in ("flow", "timing", "observer")}
    blocks["output"] = (
        _stacked_output(sensors) if _is_irregular(sensors, events) else _output_of(sensors[0])
    )
    if len(events) == 1 and not _is_irregular(sensors, events):
        every = events[0].get("every")
        blocks["jump"] = {**events[0], "dwell_time": [every, every] if is_number(every) else every}
        blocks["jump"] |= {"dwell_jitter": "inf"}
    return blocks


def _is_irregular(sensors: list[Value], events: list[Value]) -> bool:
    first = sensors[0]
    every = first.get("every")
    is_fixed = not isinstance(every, list) and not first.get("losses") and not first.get("jitter")
    return len(sensors) > 1 or len(events) > 1 or not is_fixed


def _output_of(sensor: Value) -> NewEntries:
    """The [output] of one sensor that is read always, every period, or at jumps."""
    every = sensor.get("every")
    own = {**sensor, "jump_measurement": sensor.get("sees", "before")}
    return own | ({"period": every} if is_number(every) else {})


def _stacked_output(sensors: list[Value]) -> NewEntries:
    """The [output] of several sensors: all their rows."""
    bounds = [sensor.get("noise_bound") for sensor in sensors]
    listed = [bound for own in bounds if isinstance(own, list) for bound in own]
    if any(isinstance(bound, list) for bound in listed):
        listed = [bound if isinstance(bound, list) else [-bound, bound] for bound in listed]
    C = [row for sensor in sensors for row in sensor.get("C", ())]
    return {"C": C, "noise_bound": listed, "jump_measurement": "before"}
