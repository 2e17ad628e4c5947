"""Check that gains run the plant that their problem states: entries that both hold."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.document import Design, jsonable, same
from obsdesign.entries import is_number
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.errors import InputError, naming
from obsdesign.kinds import GIVING_BOUNDS
from obsdesign.runtime.stated_parameters import (
    WIDENED,
    has_parameters,
    nominal_blocks,
    widened_blocks,
)

# gains that repeat an entry of the problem, and where it stands there
_REPEATED: tuple[tuple[str, str, str], ...] = (
    ("A", "flow", "A"), ("B", "flow", "B"), ("C", "output", "C"), ("G", "jump", "G"),
    ("dt", "flow", "dt"), ("spacing", "timing", "spacing"),
    ("E", "jump", "E"), ("noise_bound", "output", "noise_bound"), ("period", "output", "period"),
    ("dwell_time", "jump", "dwell_time"), ("dwell_jitter", "jump", "dwell_jitter"),
    ("jump_measurement", "output", "jump_measurement"), ("noise_centre", "output", "noise_bound"),
    ("disturbance_matrix", "flow", "disturbance_matrix"),
    ("jump_disturbance_matrix", "jump", "disturbance_matrix"),
)  # fmt: skip
# the same, of one kind: elsewhere the name is a matrix of the observer
_REPEATED_BY_KIND = {
    "impulsive_input": (("H", "jump", "H"),), "set_membership": (
        ("D", "flow", "D"), ("d_lower", "flow.d_bounds", "lower"),
        ("d_upper", "flow.d_bounds", "upper"), ("d_rate", "flow.d_bounds", "rate"),
    ),
}  # fmt: skip


def refuse_other_plant(design: Design) -> None:
    """InputError when the gains are for another plant than the one the design names."""
    if "modes" in design.gains or "mode" in design.problem:
        _same_modes(design)
        return
    blocks, compared = plain_blocks(design.problem), _REPEATED
    if has_parameters(design.problem):
        with naming("gains", ValueError):
            if design.kind in GIVING_BOUNDS:
                blocks = widened_blocks(design.problem, design.gains)
                compared = tuple(row for row in _REPEATED if row[0] not in WIDENED)
            else:
                blocks = nominal_blocks(design.problem)
    flow = blocks.get("flow")
    if "sensors" in design.gains:  # which have `sees` of their own
        _same_sees(design)
        blocks = {**blocks, "output": {**blocks["output"], "jump_measurement": "before"}}
    blocks = {**blocks, "flow.d_bounds": flow.get("d_bounds") if isinstance(flow, dict) else None}
    for name, block, key in (*compared, *_REPEATED_BY_KIND.get(design.kind, ())):
        table = blocks.get(block)
        stated = table.get(key) if isinstance(table, dict) else None
        if key == "noise_bound":
            stated = _noise_part(stated, name)
        is_needed = name in ("noise_centre", "dt", "spacing") and stated is not None
        given = name in design.gains or is_needed
        if name == "disturbance_matrix" and blocks["flow.d_bounds"] and "D" not in design.gains:
            continue  # the columns of D are columns of it
        if given and not same(jsonable(design.gains.get(name)), jsonable(stated)):
            if name == "dwell_time" and _is_searched_range(design, stated):
                continue
            raise InputError(
                f"gains.{name} differs from problem.{block}.{key}; `obsdesign verify` refutes it. "
                "Was the file put together by hand?"
            )


def _same_sees(design: Design) -> None:
    """InputError where a sensor sees another state at an event than the problem says."""
    named, output = design.problem.get("sensor"), design.problem.get("output")
    listed = named if isinstance(named, list) else [output]
    key = "sees" if isinstance(named, list) else "jump_measurement"
    stated = [own.get(key, "before") if isinstance(own, dict) else None for own in listed]
    sensors = design.gains["sensors"]
    tables = sensors if isinstance(sensors, list) else []
    given = [own.get("sees") if isinstance(own, dict) else None for own in tables]
    if given != stated:
        block = "sensor.sees" if isinstance(named, list) else "output.jump_measurement"
        raise InputError(
            f"gains.sensors.sees differ from problem.{block}; `obsdesign verify` refutes it. Was "
            "the file put together by hand?"
        )


def _same_modes(design: Design) -> None:
    """InputError when the gains of modes are for other modes than the design names."""
    stated, listed = design.problem.get("mode"), design.gains.get("modes")
    pairs, blocks = [], plain_blocks(design.problem)
    flow, output = (blocks.get(name, {}) for name in ("flow", "output"))
    if isinstance(stated, list) and isinstance(listed, list) and len(stated) == len(listed):
        pairs = list(zip(listed, stated, strict=True))
    events, given = design.problem.get("event", []), design.gains.get("events", [])
    tables = [flow, output, *(x for pair in pairs for x in pair)]
    is_same = bool(pairs) and all(isinstance(x, dict) for x in tables)
    timing = design.problem.get("timing", {})
    is_same = is_same and _same_events(given, events)
    is_same = is_same and isinstance(timing, dict)
    is_same = is_same and design.gains.get("spacing") == timing.get("spacing")
    if is_same:
        names = [str(mode.get("name")) for _, mode in pairs]
        is_same = all(
            same(jsonable(own.get(name)), jsonable(wanted))
            for own, mode in pairs
            for name, wanted in _stated_of_mode(mode, flow, output, names).items()
        )
    if not is_same:
        raise InputError(
            "gains.modes differ from problem.mode; `obsdesign verify` refutes it. Was the file put "
            "together by hand?"
        )


def _same_events(given: Value, stated: Value) -> bool:
    """Are these the events that a problem states, in its order?"""
    if not isinstance(given, list) or not isinstance(stated, list) or len(given) != len(stated):
        return False
    if not all(isinstance(x, dict) for x in (*given, *stated)):
        return False
    return all(
        same(jsonable(own.get(name)), jsonable(wanted))
        for own, event in zip(given, stated, strict=True)
        for name, wanted in _stated_of_event(event).items()
    )


def _stated_of_event(event: Entries) -> Entries:
    """Gains of an event that repeat its entries, and what a problem states there."""
    every, modes, box = event.get("every"), event.get("modes"), event.get("disturbance")
    ends = box if isinstance(box, dict) else {}
    return {
        "name": event.get("name"),
        "G": event.get("G"),
        "E": event.get("E"),
        "lower": ends.get("lower"),
        "upper": ends.get("upper"),
        "disturbance_matrix": event.get("disturbance_matrix"),
        "dwell_time": every if isinstance(every, list) or every is None else [every, every],
        "modes": "+".join(map(str, modes)) if isinstance(modes, list) else None,
    }


def _stated_of_mode(mode: Entries, flow: Entries, output: Entries, names: list[str]) -> Entries:
    """Gains of a mode that repeat an entry of the problem, and what it states there."""
    own, noise, G = {**flow, **mode}, output.get("noise_bound"), mode.get("G")
    others = [name for name in names if name != mode.get("name")]
    is_identity = isinstance(G, list) and np.eye(len(G)).tolist() == G
    stated = {
        "name": own.get("name"),
        "every": own.get("every"),
        "next": "+".join(map(str, mode.get("next", others))),
        "A": own.get("A"),
        "B": own.get("B"),
        "C": mode.get("C", output.get("C")),
        "G": None if is_identity else G,
        "noise_bound": _noise_part(noise, "noise_bound"),
        "noise_centre": _noise_part(noise, "noise_centre"),
    }
    box = own.get("disturbance")
    if isinstance(box, dict) and "disturbance_matrix" not in flow and "d_bounds" not in flow:
        stated |= {"flow_lower": box.get("lower"), "flow_upper": box.get("upper")}
    return stated


def _noise_part(stated: Value, name: str) -> object:
    """The centre or the radius of noise bounds as a problem states them; None if it has none."""
    is_pairs = isinstance(stated, list) and any(isinstance(item, list) for item in stated)
    if not is_pairs:
        return stated if name == "noise_bound" else None
    try:
        centre, radius = noise_box(stated)
    except (TypeError, ValueError):
        return None
    return radius if name == "noise_bound" else centre


def _is_searched_range(design: Design, stated: Value) -> bool:
    """Is the range of the gains one that a search for the shortest dwell time may have proved?"""
    options, proved = design.problem.get("observer"), design.gains["dwell_time"]
    if not isinstance(options, dict) or options.get("objective") != "shortest_dwell":
        return False
    if np.shape(proved) != (2,) or np.shape(stated) != (2,):
        return False
    if not all(is_number(end) or end == "inf" for end in stated):
        return False
    low, high = (float(end) for end in stated)
    return bool(0.0 <= proved[0] <= low and proved[1] == high)


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
