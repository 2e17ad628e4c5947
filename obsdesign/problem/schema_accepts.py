"""Whether a JSON Schema accepts a value, without jsonschema, which is slow to import.

The same schema decides: keywords mean what JSON Schema 2020-12 and jsonschema mean by them, each
is exact, and one that has no meaning here ends the attempt. Errors are left to jsonschema.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from numbers import Number

from lmi.arithmetic.arrays import Value

Schema = Mapping[str, Value] | bool
# does a value satisfy a keyword? (its argument, the value, the schema with its keywords, all)
Keyword = Callable[[Value, Value, Mapping[str, Value], Mapping[str, Value]], bool]


class UnknownKeyword(Exception):
    """A keyword that has no meaning here."""


def accepts(value: Value, schema: Schema, root: Mapping[str, Value]) -> bool:
    """Is a value one of a schema? UnknownKeyword where that cannot be decided here.

    root: the schema with the definitions that references name.
    """
    if isinstance(schema, bool):
        return schema
    for name, argument in schema.items():
        if name in _SILENT:
            continue
        if name not in _KEYWORDS:
            raise UnknownKeyword(name)
        if not _KEYWORDS[name](argument, value, schema, root):
            return False
    return True


def _is_number(value: Value) -> bool:
    return isinstance(value, Number) and not isinstance(value, bool)


def _is_integer(value: Value) -> bool:
    if isinstance(value, float):
        return value.is_integer()
    return isinstance(value, int) and not isinstance(value, bool)


_TYPES: Mapping[str, Callable[[Value], bool]] = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "number": _is_number,
    "integer": _is_integer,
}


def _type(names: Value, value: Value, _: Value, __: Value) -> bool:
    return any(_TYPES[name](value) for name in ([names] if isinstance(names, str) else names))


def _is(constant: Value, value: Value) -> bool:
    """Equality of simple constants: True is not 1."""
    if isinstance(constant, list | dict):
        raise UnknownKeyword("a constant that is a list or an object")
    return isinstance(constant, bool) == isinstance(value, bool) and bool(constant == value)


def _const(constant: Value, value: Value, _: Value, __: Value) -> bool:
    return _is(constant, value)


def _enum(constants: Value, value: Value, _: Value, __: Value) -> bool:
    return any(_is(constant, value) for constant in constants)


def _ref(name: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    if not name.startswith("#/"):
        raise UnknownKeyword(name)
    target: Value = root
    for part in name[2:].split("/"):
        target = target[part]
    return accepts(value, target, root)


def _properties(known: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    if not isinstance(value, dict):
        return True
    return all(accepts(value[name], own, root) for name, own in known.items() if name in value)


def _of_pattern(known: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    if not isinstance(value, dict):
        return True
    return all(
        accepts(item, own, root)
        for pattern, own in known.items()
        for name, item in value.items()
        if re.search(pattern, name)
    )


def _further(own: Value, value: Value, schema: Mapping[str, Value], root: Value) -> bool:
    if not isinstance(value, dict):
        return True
    known, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
    return all(
        accepts(item, own, root)
        for name, item in value.items()
        if name not in known and not any(re.search(pattern, name) for pattern in patterns)
    )


def _names(own: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    return not isinstance(value, dict) or all(accepts(name, own, root) for name in value)


def _required(names: Value, value: Value, _: Value, __: Value) -> bool:
    return not isinstance(value, dict) or all(name in value for name in names)


def _first_items(schemas: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    if not isinstance(value, list):
        return True
    return all(accepts(item, own, root) for item, own in zip(value, schemas, strict=False))


def _items(own: Value, value: Value, schema: Mapping[str, Value], root: Value) -> bool:
    first = len(schema.get("prefixItems", ()))
    return not isinstance(value, list) or all(accepts(item, own, root) for item in value[first:])


def _limit(is_beyond: Callable[[Value, Value], bool]) -> Keyword:
    """The keyword of a number that must not be beyond a limit; NaN is not beyond any."""

    def holds(limit: Value, value: Value, _: Value, __: Value) -> bool:
        return not (_is_number(value) and is_beyond(value, limit))

    return holds


def _size(
    kind: type[list[Value]] | type[dict[str, Value]], is_beyond: Callable[[int, int], bool]
) -> Keyword:
    def holds(limit: Value, value: Value, _: Value, __: Value) -> bool:
        return not (isinstance(value, kind) and is_beyond(len(value), limit))

    return holds


def _all(schemas: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    return all(accepts(value, own, root) for own in schemas)


def _any(schemas: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    return any(accepts(value, own, root) for own in schemas)


def _not(own: Value, value: Value, _: Value, root: Mapping[str, Value]) -> bool:
    return not accepts(value, own, root)


def _if(own: Value, value: Value, schema: Mapping[str, Value], root: Value) -> bool:
    branch = "then" if accepts(value, own, root) else "else"
    return accepts(value, schema.get(branch, True), root)


_KEYWORDS: Mapping[str, Keyword] = {
    "$ref": _ref, "type": _type, "const": _const, "enum": _enum, "properties": _properties,
    "patternProperties": _of_pattern, "additionalProperties": _further, "propertyNames": _names,
    "required": _required, "prefixItems": _first_items, "items": _items,
    "minimum": _limit(lambda value, limit: value < limit),
    "maximum": _limit(lambda value, limit: value > limit),
    "exclusiveMinimum": _limit(lambda value, limit: value <= limit),
    "exclusiveMaximum": _limit(lambda value, limit: value >= limit),
    "minItems": _size(list, lambda count, limit: count < limit),
    "maxItems": _size(list, lambda count, limit: count > limit),
    "minProperties": _size(dict, lambda count, limit: count < limit),
    "allOf": _all, "anyOf": _any, "not": _not, "if": _if,
}  # fmt: skip
# keywords that refuse nothing, or that another one reads
_SILENT = {"$schema", "$id", "$defs", "title", "description", "default", "then", "else"}
