"""Structure of a problem by its JSON Schema, with errors for people."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

from lmi.arithmetic.arrays import Value
from obsdesign.entries import shown
from obsdesign.errors import InputError
from obsdesign.kinds import GAINS
from obsdesign.problem.option_table import OPTIONS, owners
from obsdesign.problem.schema_accepts import UnknownKeyword, accepts

# blocks of one jump and one output, and lists of named ones, which are not mixed
_PLAIN, _LISTED = ("jump", "output"), ("event", "sensor", "mode", "parameter")
# keys of [jump] and [output], and what says the same of a named one
_OF_CLOCKS = {
    "dwell_time": "every", "measured": "every", "period": "every", "jump_measurement": "sees",
}  # fmt: skip
# words for keys of blocks that have these keys
_MEANT = {
    "value": "range", "nominal": "range", "interval": "range", "bounds": "range",
    "min": "lower", "minimum": "lower", "max": "upper", "maximum": "upper",
}  # fmt: skip
# which violation is reported when there are several: names before values
_FIRST = ("not", "propertyNames", "additionalProperties", "required")


def check_structure(body: Value) -> None:
    """InputError for the most informative violation of the schema by parsed TOML or JSON."""
    if not isinstance(body, dict):
        raise InputError(f"a problem must be a table with [flow] and [output]; got {shown(body)}.")
    abridged = _abridged(body)
    if _is_accepted(abridged):
        return
    validator = _validator()
    try:
        errors = list(validator.iter_errors(abridged))
    except ValueError:  # it puts values into text, and Python refuses such integers
        raise InputError("numbers must fit binary64; an integer has thousands of digits.") from None
    if errors:
        raise InputError(_sentence(min(errors, key=_rank), body, validator.schema))


def _is_accepted(body: Value) -> bool:
    try:
        return accepts(body, _schema(), _schema())
    except (UnknownKeyword, TypeError):  # keys of a dict in Python may be no text
        return False


@cache  # of a file that does not change: reading it takes longer than a problem
def _schema() -> Value:
    return json.loads(files("obsdesign").joinpath("problem/problem.schema.json").read_text("utf-8"))


@cache
def _validator() -> Value:
    import jsonschema  # slow to import, and files without errors do without

    return jsonschema.Draft202012Validator(_schema())


def _abridged(value: Value) -> Value:
    """The body with only a corner of every matrix of numbers: jsonschema is slow."""
    if isinstance(value, dict):
        return {key: _abridged(item) for key, item in value.items()}
    if isinstance(value, list) and value and all(isinstance(row, list) and row for row in value):
        kinds = {type(item) for row in value for item in row}
        return [[value[0][0]]] if kinds <= {int, float} and len(value[0]) > 2 else value
    return value


def _rank(error: Value) -> tuple[int, int, list[str]]:
    place = _FIRST.index(error.validator) if error.validator in _FIRST else len(_FIRST)
    return place, len(error.absolute_path), [str(part) for part in error.absolute_path]


def _sentence(error: Value, body: Value, schema: Value) -> str:
    path = _named(list(error.absolute_path), body)
    is_of_name = "propertyNames" in error.absolute_schema_path
    if error.validator in ("propertyNames", "enum") and is_of_name:
        return _unknown(error.instance, path, _names(), body, schema)
    if error.validator == "additionalProperties":
        known = list(error.schema.get("properties", {}))
        patterns = tuple(error.schema.get("patternProperties", ()))
        name = next(
            key
            for key in error.instance
            if key not in known and not any(re.search(one, str(key)) for one in patterns)
        )
        return _unknown(name, path, known, body, schema)
    if error.validator == "not":  # a block beside those it may not be mixed with
        return _mixed(path[0], body)
    if error.validator == "required":
        name = next(key for key in error.validator_value if key not in error.instance)
        return f"{_entry([*path, name])} is required; it is missing."
    return _value(error, path, body, schema)


def _named(path: list[Value], body: Value) -> list[Value]:
    """The path with the name of an event or a sensor for its place in the list."""
    if len(path) < 2 or path[0] not in _LISTED:
        return path
    table = body[path[0]][path[1]]
    name = table.get("name") if isinstance(table, dict) else None
    return [f"{path[0]}.{name if isinstance(name, str) else path[1] + 1}", *path[2:]]


def _mixed(block: Value, body: Value) -> str:
    table = "sensor" if "sensor" in body else "event"
    other = {"jump": "event", "output": "sensor"}[block]
    return (
        f"[{block}] may not be mixed with [[{table}]]; write it as [[{other}]] with a name of its "
        "own."
    )


def _names() -> list[str]:
    return ["kind", "gains", *sorted({name for names in OPTIONS.values() for name in names})]


def _unknown(key: Value, path: list[Value], known: list[str], body: Value, schema: Value) -> str:
    """An unknown key: of another kind, or misspelt."""
    name = str(key)  # a dict in Python may have any key
    where = f" in [{'.'.join(map(str, path))}]" if path else ""
    kind = body.get("observer", {}).get("kind") if isinstance(body.get("observer"), dict) else None
    if path == ["observer"] and (kinds := owners(name)):
        return (
            f"observer.{name} is an option of kind {' and '.join(map(repr, kinds))}, not of "
            f"{kind!r}; drop it, or choose that kind with --kind."
        )
    if path == ["observer", "gains"]:
        kinds = [other for other, gains in GAINS.items() if name in gains and other != kind]
        if kind is not None and kinds:
            return (
                f"observer.gains.{name} is a gain of kind {' and '.join(map(repr, kinds))}, "
                f"not of {kind!r}."
            )
    if home := _home(name, schema, body):
        return f"unknown key {name!r}{where}: it belongs in [{home}]."
    if path and str(path[0]).startswith(("event.", "sensor.")) and name in _OF_CLOCKS:
        return f"unknown key {name!r}{where}: it is {_OF_CLOCKS[name]!r} there."
    near = _nearest(name, known)
    if near:
        return f"unknown key {name!r}{where}: did you mean {' or '.join(map(repr, near))}?"
    return f"unknown key {name!r}{where}: this kind has none here."


def _gain_names(schema: Value) -> list[str]:
    return list(schema["properties"]["observer"]["properties"]["gains"]["properties"])


def _owners(body: Value) -> list[Value]:
    """Names of events and sensors, as far as a body has them."""
    tables = [table for title in _LISTED for table in body.get(title, ())]
    return [table["name"] for table in tables if isinstance(table, dict) and "name" in table]


def _home(name: str, schema: Value, body: Value) -> str | None:
    """The only block that knows this name; None where none or several do."""
    has_tables = any(title in body for title in ("event", "sensor"))
    blocks = {
        title: list(block.get("items", block).get("properties", {}))
        for title, block in schema["properties"].items()
        if title not in ("state", "parameter", *(_PLAIN if has_tables else _LISTED))
    }
    blocks |= {"observer": _names(), "observer.gains": _gain_names(schema)}
    homes = [title for title, names in blocks.items() if name in names]
    return homes[0] if len(homes) == 1 else None


def _nearest(name: str, known: list[str]) -> list[str]:
    """Known names that mean it, or start so, else the one most like it."""
    small = name.lower()
    if (meant := _MEANT.get(small)) in known:
        return [meant]
    if len(small) > 2 and (longer := [k for k in known if k.lower().startswith(small)]):
        return longer
    near = difflib.get_close_matches(small, [k.lower() for k in known], 1, 0.0)
    return [k for k in known if k.lower() in near][:1]


def _value(error: Value, path: list[Value], body: Value, schema: Value) -> str:
    if path[:2] == ["observer", "gains"] and len(path) == 3 and path[2] not in _owners(body):
        known = list(error.parent.schema["properties"]) if error.parent else _gain_names(schema)
        if path[2] not in known:
            return _unknown(path[2], path[:2], known, body, schema)
    wanted = error.schema.get("title")
    if wanted is None and error.parent is not None:
        wanted = error.parent.schema.get("title")
    if "dwell_time" in path:
        wanted = "a pair [shortest, longest] of numbers; the longest may be inf"
        return f"jump.dwell_time must be {wanted}; got {shown(body['jump']['dwell_time'])}."
    if error.validator == "enum":
        wanted = f"one of {', '.join(map(str, error.validator_value))}"
    text = f"{_entry(path)} must be {wanted}; got {shown(error.instance)}."
    if error.validator == "enum" and isinstance(error.instance, str):
        near = difflib.get_close_matches(error.instance, error.validator_value, 1, 0.6)
        text += f" Did you mean {near[0]!r}?" if near else ""
    if str(error.instance).lower().lstrip("+-") in ("inf", "infinity", "nan"):
        return text + " Infinity is allowed only as the longest dwell time and as dwell_jitter."
    if isinstance(error.instance, str) and wanted and "number" in wanted:
        text += " Numbers are written without quotes."
    if str(wanted).startswith("a row") and not isinstance(error.instance, list):
        text += " One row is written [[1, 2]], one column [[1], [2]]."
    return text


def _entry(path: Sequence[Value]) -> str:
    """flow.A, row 1, column 2."""
    names = [str(part) for part in path if not isinstance(part, int)]
    places = [part + 1 for part in path if isinstance(part, int)]
    words = ("row", "column") if len(places) == 2 else ("entry",)
    if names and names[-1] in "ABCDEGHLMKST" and len(places) == 1:
        words = ("row",)
    return ", ".join([".".join(names), *(f"{w} {k}" for w, k in zip(words, places, strict=False))])
