"""Reading design files: format, version, digest, and the shape of every entry.

Checked by hand, so that the runtime can read designs with numpy alone; the published JSON Schema is
`problem/design.schema.json`.
"""

from __future__ import annotations

import math
import os

import numpy as np

from lmi.arithmetic.arrays import NewEntries, Value
from obsdesign.document import FORMAT, VERSION, Claim, Design, Guarantee, digest
from obsdesign.entries import LARGEST, is_number, shown
from obsdesign.errors import InputError
from obsdesign.input_files import parse_json, read_text, require_depth

VERDICTS = ("proved", "refuted", "undecided")
# gains that are true or false, and those that are words
_FLAGS = ("nonnegative", "state_correction")
_WORDS = ("differentiator", "form", "half_sample", "jump_measurement", "method", "operator",
          "reference", "rule", "strategy", "weighting")  # fmt: skip
_TYPES: dict[str, type] = {
    "format": str, "version": int, "name": str, "kind": str, "problem": dict, "gains": dict,
    "claims": list, "guarantees": list, "warnings": list, "provenance": dict, "digest": str,
}  # fmt: skip
_OF_PROBLEM = (
    "{path}: a design file is required; this is a problem file. "
    "`obsdesign design {path}` designs it."
)
_SINCE_WARNINGS = ("warnings",)  # keys that files of the first release lack


def load_design(path: str | os.PathLike[str]) -> Design:
    """Read a design file (docs/design_file.md).

    InputError if it cannot be read, is no design, is of another version, or was changed since it
    was signed. Nothing of what it claims is proved here: `obsdesign.verify` does.
    """
    text = read_text(path)
    try:
        body = parse_json(text, parse_float=_finite, parse_int=_whole)
    except (ValueError, RecursionError) as error:
        if str(path).lower().endswith(".toml"):
            raise InputError(_OF_PROBLEM.format(path=path)) from None
        where = f" ({error})" if text.strip() else " (the file is empty)"
        raise InputError(f"{path}: not a design file: not valid JSON{where}.") from None
    return from_dict(body, str(path))


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(f"{shown(text)} is beyond binary64")
    return value


def _whole(text: str) -> int:
    _finite(text)
    return int(text)


def from_dict(body: Value, path: str = "design") -> Design:
    """A design from its parsed JSON, checked for format, version, keys, digest and shapes."""
    _check_format(body, path)
    require_depth(body, path)
    _check_digest(body, path)
    for key, shape in _TYPES.items():
        if key in body and not isinstance(body[key], shape):
            got = type(body[key]).__name__
            raise InputError(f"{path}: {key} must be a {shape.__name__}; got {got}.")
    for key in ("versions", "solver"):
        if not isinstance(body["provenance"].get(key, {}), dict):
            got = shown(body["provenance"][key])
            raise InputError(f"{path}: provenance.{key} must be a table; got {got}.")
    claims = [_claim(claim, f"{path}: claims[{i}]") for i, claim in enumerate(body["claims"])]
    guarantees = [
        _guarantee(entry, f"{path}: guarantees[{i}]") for i, entry in enumerate(body["guarantees"])
    ]
    if not all(isinstance(text, str) for text in body.get("warnings", ())):
        raise InputError(f"{path}: warnings must hold sentences.")
    return Design(
        name=body["name"],
        kind=body["kind"],
        problem=body["problem"],
        gains={name: _gain(name, value, path) for name, value in body["gains"].items()},
        claims=tuple(claims),
        guarantees=tuple(guarantees),
        warnings=tuple(body["warnings"]) if "warnings" in body else None,
        provenance=body["provenance"],
    )


def _check_format(body: Value, path: str) -> None:
    """InputError unless this is a design of this version, with its keys and no others."""
    if isinstance(body, dict) and "flow" in body and "format" not in body:
        raise InputError(_OF_PROBLEM.format(path=path))
    if not isinstance(body, dict) or body.get("format") != FORMAT:
        arrived = shown(body.get("format")) if isinstance(body, dict) else type(body).__name__
        raise InputError(f"{path}: format must be {FORMAT!r}; got {arrived}.")
    if type(body.get("version")) is not int or body["version"] != VERSION:
        raise InputError(
            f"{path}: version must be {VERSION}; got {shown(body.get('version'))}. "
            "Was it written by a newer obsdesign?"
        )
    if missing := [key for key in _TYPES if key not in body and key not in _SINCE_WARNINGS]:
        raise InputError(f"{path}: {missing[0]} is missing; a design file has it.")
    if unknown := [key for key in body if key not in _TYPES]:
        raise InputError(f"{path}: unknown key {shown(unknown[0])} in a design file.")


def _check_digest(body: NewEntries, path: str) -> None:
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


def _claim(entry: Value, place: str) -> Claim:
    names = tuple(Claim.__dataclass_fields__)
    if not isinstance(entry, dict) or set(entry) != set(names):
        raise InputError(f"{place} must have exactly {', '.join(names)}.")
    texts = all(isinstance(entry[name], str) for name in names if name != "evidence")
    if not texts or not isinstance(entry["evidence"], dict):
        raise InputError(f"{place} must hold texts, and evidence a table.")
    if truth := _truth_in_lists(entry["evidence"]):
        raise InputError(f"{place}.evidence: numbers are due in {shown(truth)}.")
    if entry["verdict"] not in VERDICTS:
        raise InputError(
            f"{place}.verdict must be one of {', '.join(VERDICTS)}; got {shown(entry['verdict'])}."
        )
    return Claim(**entry)


def _truth_in_lists(value: Value) -> list[Value] | None:
    """A list that holds true or false, anywhere inside; None if there is none."""
    if isinstance(value, list) and any(isinstance(item, bool) for item in value):
        return value
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return next((truth for item in items if (truth := _truth_in_lists(item))), None)


def _guarantee(entry: Value, place: str) -> Guarantee:
    kinds = {"statement": str, "given": bool, "claims": list}
    if not isinstance(entry, dict) or set(entry) != set(kinds):
        raise InputError(f"{place} must have exactly {', '.join(kinds)}.")
    for key, kind in kinds.items():
        if not isinstance(entry[key], kind):
            raise InputError(f"{place}.{key} must be a {kind.__name__}; got {shown(entry[key])}.")
    if not all(isinstance(name, str) for name in entry["claims"]):
        raise InputError(f"{place}.claims must hold ids of claims.")
    return Guarantee(entry["statement"], tuple(entry["claims"]), entry["given"])


def _gain(name: str, value: Value, path: str) -> Value:
    """A text, a number, a flag, or a read-only array of numbers; InputError for anything else."""
    entry = f"{path}: gains.{name}"
    if name in _FLAGS and isinstance(value, bool):
        return value
    if name in _WORDS and not isinstance(value, str):
        raise InputError(f"{entry} must be a word; got {shown(value)}.")
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        return [
            {key: _gain(f"{name}[{i}].{key}", item, path) for key, item in block.items()}
            for i, block in enumerate(value)
        ]
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


def _numbers(value: Value, entry: str) -> Value:
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
