"""The entry of a problem that a sweep changes, and its values.

An entry is written as in Python: `flow.A[0][1]`, `jump.dwell_time[1]`, `output.period`; indices
begin with 0. It must stand in the normalised problem (defaults filled in) and hold a number. A
table of a list may be called by its name, `parameter.stiffness.range[0]`; `width` of a parameter
is that of its range, about its middle.
"""

from __future__ import annotations

import copy
import difflib
import functools
import math
import operator
import re
from dataclasses import dataclass
from fractions import Fraction

from lmi.arithmetic.arrays import NewEntries, Value
from obsdesign.entries import is_number, number_from_text
from obsdesign.errors import InputError

Path = tuple[str | int, ...]

# of a parameter: highest less lowest value
_WIDTH = "width"
_KEY = re.compile(r"[A-Za-z]\w*(?:\.[A-Za-z]\w*|\[\d+\])*")
_STEP = re.compile(r"([A-Za-z]\w*)|\[(\d+)\]")


@dataclass(frozen=True)
class Axis:
    """`count` equally spaced values of an entry, from `first` to `last`; `last` may be less."""

    key: str
    first: float
    last: float
    count: int

    @property
    def path(self) -> Path:
        """The entry as keys and indices."""
        return path_of(self.key)

    @property
    def values(self) -> tuple[float, ...]:
        """All values, in their order."""
        return tuple(map(self.value, range(self.count)))

    def value(self, i: int) -> float:
        """Value number i. Equally spaced as decimal numbers: the third of 0:0.3:4 is 0.2."""
        first, last = Fraction(repr(self.first)), Fraction(repr(self.last))
        return float(first + i * (last - first) / max(self.count - 1, 1))

    def __str__(self) -> str:
        """The axis as it is written for --over, ends shortened."""
        return f"{self.key}={self.first:g}:{self.last:g}:{self.count}"

    def to_dict(self) -> NewEntries:
        """The axis as it stands in the first line of a sweep file."""
        return {"key": self.key, "first": self.first, "last": self.last, "count": self.count}


def parse_axis(text: str) -> Axis:
    """The axis of `key=first:last:count`; InputError when it is written otherwise."""
    key, equals, ends = text.partition("=")
    parts = ends.split(":")
    form = "--over must be key=first:last:count, such as jump.dwell_time[0]=0.5:2:16"
    if not equals or len(parts) != 3 or not _KEY.fullmatch(key.strip()):
        raise InputError(f"{form}; got {text!r}.")
    try:
        first, last = (number_from_text(part.strip()) for part in parts[:2])
    except ValueError:
        raise InputError(f"{form}; {parts[0]!r} and {parts[1]!r} are not both numbers.") from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise InputError(f"{form}; both ends must be finite, got {parts[0]} and {parts[1]}.")
    try:
        count = int(parts[2]) if parts[2].isdecimal() and parts[2].isascii() else 0
    except ValueError:
        count = 0
    if count < 1:
        raise InputError(f"{form}; count must be an integer >= 1, got {parts[2]!r}.")
    return Axis(key.strip(), first + 0.0, last + 0.0, count)


def path_of(key: str) -> Path:
    """Keys and indices of an entry as it is written."""
    return tuple(int(i) if i else name for name, i in _STEP.findall(key))


def entry(body: Value, path: Path) -> Value:
    """What a problem as a dict holds in an entry."""
    return functools.reduce(operator.getitem, path, body)


def changed(body: Value, path: Path, value: float) -> NewEntries:
    """A copy of a problem as a dict with another number in one entry."""
    result: NewEntries = copy.deepcopy(body)
    place: Value = result
    for step in path[:-1]:
        is_name = isinstance(place, list) and step in _names(place)
        place = _named(place, step) if is_name else place[step]
    if path[-1] == _WIDTH and _is_parameter(place):
        place["range"] = _range_of_width(place["range"], value)
    else:
        place[path[-1]] = value
    return result


def _range_of_width(ends: list[float], width: float) -> list[float]:
    """The range of that width about the middle of another; as decimal numbers."""
    low, high = (Fraction(repr(float(end))) for end in ends)
    middle, half = (low + high) / 2, Fraction(repr(float(width))) / 2
    return [float(middle - half), float(middle + half)]


def _is_parameter(place: Value) -> bool:
    return isinstance(place, dict) and "range" in place


def _names(tables: list[Value]) -> list[str]:
    """Names of the tables of a list."""
    return [table["name"] for table in tables if isinstance(table, dict) and "name" in table]


def _named(tables: list[Value], name: str | int) -> Value:
    """The table of that name."""
    return tables[_names(tables).index(str(name))]


def require_number(body: Value, axis: Axis) -> None:
    """InputError, with the entries there are, unless that of an axis holds a number."""
    place, so_far = body, ""
    for step in axis.path:
        place = _entered(place, step, so_far, axis.key)
        so_far = _written(so_far, step)
    if _is_entry(place):
        return
    if isinstance(place, dict | list) and (below := entries(place, so_far)):
        reason = f"is {_shape(place)}, not one number. Choose one of {_listed(below)}"
    else:
        numbers = entries(body.get(axis.path[0], {}), str(axis.path[0]))
        reason = f"is {place!r}, not a number. Numbers there: {_listed(numbers) or 'none'}"
    raise InputError(f"--over {axis.key}: it {reason}.")


def entries(body: Value, prefix: str = "") -> list[str]:
    """Every entry below `body` that holds a number, as it is written for --over."""
    if _is_entry(body):
        return [prefix]
    if isinstance(body, dict):
        below = [(str(key), item) for key, item in body.items()]
        return [name for key, item in below for name in entries(item, _written(prefix, key))]
    if isinstance(body, list):
        pairs = enumerate(body)
        return [name for i, item in pairs for name in entries(item, _written(prefix, i))]
    return []


def _is_entry(value: object) -> bool:
    return is_number(value) or value == "inf"


def _written(prefix: str, step: str | int) -> str:
    if isinstance(step, int):
        return f"{prefix}[{step}]"
    return f"{prefix}.{step}" if prefix else step


def _entered(place: Value, step: str | int, so_far: str, key: str) -> Value:
    where = so_far or "the problem"
    if isinstance(step, int):
        if not isinstance(place, list):
            raise InputError(f"--over {key}: {where} has no entries [0], [1], ...; it is "
                             f"{_shape(place)}.")  # fmt: skip
        if step >= len(place):
            raise InputError(f"--over {key}: {where} has entries [0] to [{len(place) - 1}]; "
                             f"got [{step}]. The first one is [0].")  # fmt: skip
        return place[step]
    if isinstance(place, list) and step in _names(place):
        return _named(place, step)
    if step == _WIDTH and _is_parameter(place):
        return place["range"][1] - place["range"][0]
    if not isinstance(place, dict):
        raise InputError(f"--over {key}: {where} has no {step!r}; it is {_shape(place)}.")
    if step not in place:
        names = {name.lower(): name for name in place}
        near = difflib.get_close_matches(step.lower(), list(names), 1)
        hint = f" Did you mean {names[near[0]]!r}?" if near else ""
        raise InputError(
            f"--over {key}: {where} has no {step!r}; it has {', '.join(place) or 'nothing'}.{hint}"
        )
    return place[step]


def _shape(place: object) -> str:
    if isinstance(place, dict):
        return "a table"
    if isinstance(place, list):
        rows = [len(row) for row in place if isinstance(row, list)]
        return f"a {len(place)}x{rows[0]} matrix" if rows else f"a list of {len(place)}"
    return f"{place!r}"


def _listed(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f", ... ({len(names)} in all)" if len(names) > 6 else "")
