"""Blocks of a plant as the plain dicts and lists of a file, and back to fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from lmi.arithmetic.arrays import Entries, NewEntries, Value
from obsdesign.problem.flow import Flow, InputBounds
from obsdesign.problem.modes import Mode
from obsdesign.problem.output import Output
from obsdesign.problem.parameters import Parameter, StateBox
from obsdesign.problem.plant import Jump
from obsdesign.problem.schema import entry_name
from obsdesign.problem.signal_names import SignalNames
from obsdesign.problem.timing import Timing


def as_block(value: Value) -> Value:
    """Dataclasses and arrays as the plain dicts and lists of a file."""
    if isinstance(value, Flow | Jump | Output | Mode | Timing):
        stated = [x.name for x in fields(value) if entry_name(x) or x.name == "upper"]
        names = [name for name in stated if getattr(value, name) is not None]
        block = {name: as_block(getattr(value, name)) for name in names}
        ends = {name: block.pop(name) for name in ("lower", "upper") if name in block}
        return block | ({"disturbance": ends} if ends else {})
    if isinstance(value, Parameter | StateBox):
        own = {x.name: as_block(getattr(value, x.name)) for x in fields(value)}
        return {name: entry for name, entry in own.items() if entry is not None}
    if isinstance(value, InputBounds | SignalNames):
        return as_block(value.to_entry())
    if isinstance(value, Mapping):
        return {key: as_block(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return as_block(value.tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]  # a pole
    if isinstance(value, list | tuple):
        return [as_block(item) for item in value]
    return value


def entries_of(block: Entries) -> NewEntries:
    """Fields of a flow, a jump or a sensor: bounds beside the others, "inf" as a number."""
    entries = dict(block)
    entries |= entries.pop("disturbance", {})
    for name in ("dwell_time", "dwell_jitter", "every"):
        if name in entries:
            entries[name] = _infinite(entries[name])
    return entries


def _infinite(value: Value) -> Value:
    if isinstance(value, list):
        return [_infinite(item) for item in value]
    return math.inf if value == "inf" else value
