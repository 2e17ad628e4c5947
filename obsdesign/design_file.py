"""Reading design files: format, version, digest, and the shape of every entry.

Checked by hand, so that the runtime can read designs with numpy alone; the published JSON Schema is
`problem/design.schema.json`.
"""

from __future__ import annotations

import json
import math
import os
from typing import Any

import numpy as np

from obsdesign.document import FORMAT, VERSION, Claim, Design, Guarantee, digest
from obsdesign.entries import LARGEST, is_number, shown
from obsdesign.errors import InputError
from obsdesign.input_files import keys_once, read_text, require_depth

VERDICTS = ("proved", "refuted", "undecided")
# gains that are true or false, and those that are words
_FLAGS = ("nonnegative", "state_correction")
_WORDS = ("differentiator", "form", "half_sample", "jump_measurement", "method", "operator",
          "reference", "rule", "strategy", "weighting")  # fmt: skip
_TYPES: dict[str, type] = {
    "format": str, "version": int, "name": str, "kind": str, "problem": dict, "gains": dict,
    "claims": list, "guarantees": list, "warnings": list, "provenance": dict, "digest": str,
}  # fmt: skip
_SINCE_WARNINGS = ("warnings",)  # keys that files of the first release lack


def load_design(path: str | os.PathLike[str]) -> Design:
    """Read a design file; InputError if it is not one, of another version, or was changed."""
    text = read_text(path)
    try:
        body = json.loads(
            text, parse_constant=_refuse_constant, parse_float=_finite, parse_int=_whole,
            object_pairs_hook=keys_once,
        )  # fmt: skip
    except (ValueError, RecursionError) as error:
        where = f" ({error})" if text.strip() else " (the file is empty)"
        raise InputError(f"{path}: not a design file: not valid JSON{where}.") from None
    return from_dict(body, str(path))


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not allowed")


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{shown(text)} is beyond binary64")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def from_dict(body: Any, path: str = "design") -> Design:
    """A design from its parsed JSON, checked for format, version, keys and digest."""
    if not isinstance(body, dict) or body.get("format") != FORMAT:
        arrived = shown(body.get("format")) if isinstance(body, dict) else type(body).__name__
        raise InputError(
            f"{path}: format must be {FORMAT!r}; got {arrived}. Is this a problem file?"
        )
    if type(body.get("version")) is not int or body["version"] != VERSION:
        raise InputError(
            f"{path}: version must be {VERSION}; got {shown(body.get('version'))}. "
            "Was it written by a newer obsdesign?"
        )
    if missing := [key for key in _KEYS if key not in body and key not in _SINCE_WARNINGS]:
        raise InputError(f"{path}: {missing[0]} is missing; a design file has it.")
    if unknown := [key for key in body if key not in _KEYS]:
        raise InputError(f"{path}: unknown key {shown(unknown[0])} in a design file.")
    require_depth(body, path)
    try:
        expected = digest(body)
    except UnicodeEncodeError:
        raise InputError(f"{path}: a text in it is not valid Unicode.") from None
    stated = body["digest"]
    if stated != expected:
        text = repr(stated) if isinstance(stated, str) and len(stated) <= 80 else shown(stated)
        raise InputError(
            f"{path}: digest does not match the content ({text}, content gives "
            f"{expected!r}). The file was changed after it was written."
        )
    return _checked(body, path)


def _checked(body: dict[str, Any], path: str) -> Design:
    shapes = {"name": str, "kind": str, "problem": dict, "gains": dict, "claims": list,
              "guarantees": list, "warnings": list, "provenance": dict}  # fmt: skip
    for key, shape in shapes.items():
        if key in body and not isinstance(body[key], shape):
            raise InputError(
                f"{path}: {key} must be a {shape.__name__}; got {type(body[key]).__name__}."
            )
    for i, claim in enumerate(body["claims"]):
        if not isinstance(claim, dict) or set(claim) != set(Claim.__dataclass_fields__):
            raise InputError(
                f"{path}: claims[{i}] must have exactly {', '.join(Claim.__dataclass_fields__)}."
            )
        words = all(isinstance(claim[key], str) for key in ("id", "statement", "source", "verdict"))
        if not words or not isinstance(claim["evidence"], dict):
            raise InputError(f"{path}: claims[{i}] must hold texts, and evidence a table.")
        if truth := _truth_in_lists(claim["evidence"]):
            raise InputError(f"{path}: claims[{i}].evidence: numbers are due in {shown(truth)}.")
        if claim["verdict"] not in VERDICTS:
            raise InputError(
                f"{path}: claims[{i}].verdict must be one of {', '.join(VERDICTS)}; "
                f"got {shown(claim['verdict'])}."
            )
    _check_guarantees(body, path)
    gains = {name: _gain(name, value, path) for name, value in body["gains"].items()}
    return Design(
        name=body["name"],
        kind=body["kind"],
        problem=body["problem"],
        gains=gains,
        claims=tuple(Claim(**claim) for claim in body["claims"]),
        guarantees=tuple(
            Guarantee(entry["statement"], tuple(entry["claims"]), entry["given"])
            for entry in body["guarantees"]
        ),
        warnings=tuple(body["warnings"]) if "warnings" in body else None,
        provenance=body["provenance"],
    )


def _truth_in_lists(value: Any) -> list[Any] | None:
    """A list that holds true or false, anywhere inside; None if there is none."""
    if isinstance(value, list) and any(isinstance(item, bool) for item in value):
        return value
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return next((truth for item in items if (truth := _truth_in_lists(item))), None)


def _check_guarantees(body: dict[str, Any], path: str) -> None:
    """InputError unless guarantees and provenance have the entries that are read."""
    kinds = {"statement": str, "given": bool, "claims": list}
    for i, entry in enumerate(body["guarantees"]):
        if not isinstance(entry, dict) or set(entry) != set(kinds):
            raise InputError(f"{path}: guarantees[{i}] must have exactly {', '.join(kinds)}.")
        for key, kind in kinds.items():
            if not isinstance(entry[key], kind):
                raise InputError(
                    f"{path}: guarantees[{i}].{key} must be a {kind.__name__}; "
                    f"got {shown(entry[key])}."
                )
        if not all(isinstance(name, str) for name in entry["claims"]):
            raise InputError(f"{path}: guarantees[{i}].claims must hold ids of claims.")
    if not all(isinstance(text, str) for text in body.get("warnings", ())):
        raise InputError(f"{path}: warnings must hold sentences.")
    for key in ("versions", "solver"):
        if not isinstance(body["provenance"].get(key, {}), dict):
            got = shown(body["provenance"][key])
            raise InputError(f"{path}: provenance.{key} must be a table; got {got}.")


def _gain(name: str, value: Any, path: str) -> Any:
    """A text, a number, a flag, or a read-only array of numbers; InputError for anything else."""
    entry = f"{path}: gains.{name}"
    if name in _FLAGS and isinstance(value, bool):
        return value
    if name in _WORDS and not isinstance(value, str):
        raise InputError(f"{entry} must be a word; got {shown(value)}.")
    if value == "inf" or not isinstance(value, str):
        value = _numbers(value, entry)
    if isinstance(value, list):
        try:
            result = np.array(value, dtype=np.float64)
        except ValueError:
            raise InputError(f"{entry} must be a matrix; its rows differ in length.") from None
        result.setflags(write=False)
        return result
    return value


def _numbers(value: Any, entry: str) -> Any:
    """Nested lists with infinity as a float; InputError where no number stands."""
    if isinstance(value, list):
        return [_numbers(item, entry) for item in value]
    if value == "inf":
        return math.inf
    if not is_number(value):
        raise InputError(f"{entry} must hold numbers; got {shown(value)}.")
    if abs(value) > LARGEST:
        raise InputError(
            f"{entry} must hold numbers of magnitude at most {LARGEST:g}; got {shown(value)}."
        )
    return value
