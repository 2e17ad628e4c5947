"""Fragments of the JSON Schema of a problem file, and the declaration of a field by one.

The dataclasses of `plant` and `options` declare their entries with `file_entry`; from them
`docs/problem_schema.py` makes the published schema. The title of a fragment completes "must be".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, field

from lmi.arithmetic.arrays import Entries, Value
from lmi.window_memory import AUTO

Fragment = Entries

# marks a field without a default: None is one
_REQUIRED: Value = object()


def file_entry(
    fragment: Fragment,
    description: str,
    *,
    default: Value = _REQUIRED,
    name: str = "",
    whole: bool = False,
) -> Value:
    """Declare a field that a problem file may hold.

    name: of its entry in the file, where that differs; whole: the entry counts something.
    """
    metadata = {"schema": {**fragment, "description": description}, "name": name, "whole": whole}
    if default is _REQUIRED:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


def entry_name(declared: Field[Value]) -> str:
    """Name of the entry that a field is read from; "" where it is declared without one."""
    if "schema" not in declared.metadata:
        return ""
    return str(declared.metadata["name"] or declared.name)


def ref(name: str) -> Fragment:
    """A fragment of `DEFINITIONS`."""
    return {"$ref": f"#/$defs/{name}"}


def one_of(*words: str) -> Fragment:
    """One of these words."""
    return {"enum": list(words), "title": f"one of {', '.join(words)}"}


def list_of(item: Fragment, title: str) -> Fragment:
    """A list of at least one item."""
    return {"type": "array", "items": item, "minItems": 1, "title": title}


def whole_number(
    minimum: int, maximum: int | None = None, what: str = "a whole number"
) -> Fragment:
    """A whole number within bounds; what: the beginning of the title."""
    if maximum is None:
        return {"type": "integer", "minimum": minimum, "title": f"{what} >= {minimum}"}
    title = f"{what}, from {minimum} to {maximum}"
    return {"type": "integer", "minimum": minimum, "maximum": maximum, "title": title}


NUMBER: Fragment = {"type": "number", "title": "a number"}
POSITIVE: Fragment = {"type": "number", "exclusiveMinimum": 0, "title": "a positive number"}
NONNEGATIVE: Fragment = {"type": "number", "minimum": 0, "title": "a number >= 0"}
FLAG: Fragment = {"type": "boolean", "title": "true or false"}
POSITIVE_LIST = list_of(POSITIVE, "a list of positive numbers")
_ROW_TITLE = "a row: a list of numbers"
_MATRIX_TITLE = "a matrix: a list of rows of numbers"
_PAIR: Fragment = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}

DWELL_RANGE: Fragment = {
    "type": "array",
    "title": "a pair [shortest, longest]",
    "prefixItems": [ref("number"), ref("upper_end")],
    "items": False,
    "minItems": 2,
}

_EVERY: tuple[Fragment, ...] = ({"type": "number", "exclusiveMinimum": 0}, DWELL_RANGE)

# what several entries share
DEFINITIONS: Mapping[str, Fragment] = {
    "number": NUMBER,
    "upper_end": {
        "anyOf": [{"type": "number"}, {"const": "inf"}],
        "title": 'a number or inf (the string "inf" in JSON)',
    },
    "every": {"anyOf": [*_EVERY], "title": "a positive number or a pair [shortest, longest]"},
    "sensor_every": {
        "anyOf": [*_EVERY, {"const": "continuous"}],
        "title": 'a positive number, a pair [shortest, longest] or "continuous"',
    },
    "vector": list_of(ref("number"), "a list of numbers"),
    "per_output": {
        "type": ["number", "array"],
        "items": ref("number"),
        "minItems": 1,
        "title": "a number for all outputs, or a list of numbers",
    },
    "noise_bound": {
        "type": ["number", "array"],
        "items": {
            "type": ["number", "array"],
            "items": ref("number"),
            "title": "a number, or a pair [lower, upper]",
        },
        "minItems": 1,
        "title": "a number for all outputs, or a list of numbers or pairs [lower, upper]",
    },
    "row": list_of(ref("number"), _ROW_TITLE),
    "matrix": list_of(ref("row"), _MATRIX_TITLE),
    "gain_matrix": {
        "type": "array",
        "items": {"type": "array", "items": ref("number"), "title": _ROW_TITLE},
        "title": _MATRIX_TITLE,
        "description": "May have no rows or columns where its size says so.",
    },
    "bounds": {
        "type": "object",
        "title": "a table { lower = [...], upper = [...] }",
        "properties": {"lower": ref("vector"), "upper": ref("vector")},
        "required": ["lower", "upper"],
        "additionalProperties": False,
    },
    "input_bounds": {
        "type": "object",
        "title": "a table { lower = [...], upper = [...], rate = [...] }, the rate optional",
        "properties": {name: ref("vector") for name in ("lower", "upper", "rate")},
        "required": ["lower", "upper"],
        "additionalProperties": False,
    },
    "memory": {
        "anyOf": [{"const": AUTO}, {"type": "integer", "minimum": 0}],
        "title": f'"{AUTO}" or a whole number >= 0',
    },
    "poles": {
        **list_of(
            {
                "anyOf": [{"type": "number"}, _PAIR],
                "title": "a number or a pair [real, imaginary]",
            },
            "a list of poles: numbers or pairs [real, imaginary]",
        ),
        "description": "Poles of the error, one per state of it; one of a conjugate pair stands "
        "for both.",
    },
    "weights": {
        "type": "object",
        "title": "a table { state = [...], output = [...] } of positive numbers",
        "properties": {"state": POSITIVE_LIST, "output": POSITIVE_LIST},
        "additionalProperties": False,
    },
}
