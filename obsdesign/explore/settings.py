"""Numbers of a problem that sliders change, and the file of a problem that was changed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit

from lmi.arithmetic.arrays import NewEntries, Value
from obsdesign.input_files import read_text
from obsdesign.output_files import write_text
from obsdesign.problem.problem import Problem
from obsdesign.studies.sweep.axes import changed, entries, entry, path_of

# what a slider spans: the value divided by this to the value times it
_SPAN = 10.0
_STOPS = 41
_NOT_NEGATIVE = r"time|every|period|noise|delay|jitter|rate|window|limit"
# entries that are offered first, most telling first, and how many of these
_FIRST = (
    r"jump\.dwell_time\[.\]", r"event\[\d+\]\.every\b.*", r"mode\[\d+\]\.every\b.*",
    r"parameter\[\d+\]\.range\[.\]", r"output\.noise_bound\b.*", r"sensor\[\d+\]\.noise_bound\b.*",
    r"output\.period", r"sensor\[\d+\]\.every\b.*", r"observer\.window", r"observer\.\w+",
    r"observer\.gains\b.*",
)  # fmt: skip
_MOST_FIRST = 6
# entries in words, those that hold times, and the bound of the noise of each output
_WORDS = {
    "jump.dwell_time[0]": "shortest dwell time", "jump.dwell_time[1]": "longest dwell time",
    "output.period": "sampling period",
}  # fmt: skip
_TIMES = r"\.(dwell_time|period|every|report_delay|time_error|jitter)\b"
_NOISE = r"output\.noise_bound\[(\d+)\](.*)"


@dataclass(frozen=True)
class Setting:
    """A number of a problem: its entry as `sweep` writes it, and the stops of its slider."""

    key: str
    value: float
    stops: tuple[float, ...]


def settings_of(problem: Problem) -> dict[str, Setting]:
    """Every finite number of a problem by its entry, in the order of the file."""
    body = problem.to_dict()
    values = {key: entry(body, path_of(key)) for key in entries(body)}
    finite = {key: value for key, value in values.items() if not isinstance(value, str)}
    return {key: Setting(key, value, _stops(key, value)) for key, value in finite.items()}


def _stops(key: str, value: float) -> tuple[float, ...]:
    """Values of a slider in order, the present one among them; whole ones of a whole number."""
    if value == 0:
        low = 0.0 if re.search(_NOT_NEGATIVE, key) else -1.0
        return tuple(float(f"{stop:.3g}") for stop in np.linspace(low, 1.0, _STOPS))
    ratios = np.geomspace(1 / _SPAN, _SPAN, _STOPS)
    if isinstance(value, int):
        below = max(1, round(value / _SPAN)) if value > 0 else value - _STOPS // 2
        return tuple(range(below, below + _STOPS))
    stops = {float(f"{value * ratio:.3g}") for ratio in ratios} | {value}
    return tuple(sorted(stops))


def first_settings(settings: Mapping[str, Setting]) -> list[str]:
    """The entries that most people change first."""
    ranked = [key for pattern in _FIRST for key in settings if re.fullmatch(pattern, key)]
    return (list(dict.fromkeys(ranked)) or list(settings))[:_MOST_FIRST]


def labels_of(problem: Problem, keys: Iterable[str]) -> dict[str, str]:
    """How entries are called on the page, with units: tables of a list by their names."""
    body, labels = problem.to_dict(), {}
    for key in keys:
        table, label = re.match(r"(\w+)\[(\d+)\]", key), _WORDS.get(key, key)
        unit = problem.names.time_unit if re.search(_TIMES, key) else None
        if table is not None:
            name = body[table[1]][int(table[2])]["name"]
            label = f"{table[1]}.{name}{key[table.end() :]}"
        elif bound := re.fullmatch(_NOISE, key):
            output = f"y{int(bound[1]) + 1}"
            label = f"noise bound of {problem.names.name_of(output)}{bound[2]}"
            unit = problem.names.unit(output)
        labels[key] = f"{label} [{unit}]" if unit else label
    return labels


def with_values(problem: Problem, values: Mapping[str, float]) -> Problem:
    """The problem with other numbers in some entries; InputError where they do not go together."""
    body = problem.to_dict()
    for key, value in values.items():
        body = changed(body, path_of(key), value)
    return Problem.from_dict(body)


def save(problem: Problem, values: Mapping[str, float], source: str, target: str) -> None:
    """Write the file of a problem with other numbers; the rest of a TOML file stays as it is.

    source: the file of the problem; target: TOML or JSON by its suffix. InputError where the
    numbers do not go together, or the file cannot be written.
    """
    body = with_values(problem, values).to_dict()
    if Path(target).suffix.lower() == ".json":
        write_text(target, json.dumps(body, indent=2) + "\n")
        return
    if Path(source).suffix.lower() == ".json":
        write_text(target, tomlkit.dumps(body))
        return
    document: Value = tomlkit.parse(read_text(source))
    if document.get("observer", {}).get("kind") != problem.kind:  # that of an option
        document.pop("observer", None)
        document.append("observer", tomlkit.item(body["observer"]))
    for key in values:
        _put(document, body, path_of(key))
    write_text(target, tomlkit.dumps(document))


def _put(document: Value, body: NewEntries, path: tuple[str | int, ...]) -> None:
    """Put an entry of `body` into a document; what is absent there is put in as a whole."""
    place: Value = document
    stated: Value = body
    for step in path[:-1]:
        if not _holds(place, step) or isinstance(place[step], int | float | str):
            break
        place, stated = place[step], stated[step]
    else:
        step = path[-1]
    place[step] = _in_one_line(stated[step])


def _in_one_line(value: Value) -> Value:
    """An entry that may stand anywhere in a TOML file: tables in braces."""
    if not isinstance(value, dict):
        return value
    table = tomlkit.inline_table()
    table.update({key: _in_one_line(item) for key, item in value.items()})
    return table


def _holds(place: Value, step: str | int) -> bool:
    """Is there such an entry in a table or list?"""
    return step in place if isinstance(step, str) else step < len(place)
