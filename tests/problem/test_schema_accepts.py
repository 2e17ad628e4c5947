"""What the schema accepts without jsonschema is what jsonschema accepts."""

from __future__ import annotations

import copy
import json
import math
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from obsdesign.problem.schema_accepts import UnknownKeyword, accepts
from tests.fuzz.mutate import mutated

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "obsdesign" / "problem" / "problem.schema.json").read_text())
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
EXAMPLES = sorted((ROOT / "examples").glob("*.toml"))
KEYS = ("flow", "A", "jump", "G", "every", "name", "gains", "kind", "period", "range", "C")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_and_changed_ones(path: Path) -> None:
    body, rng = tomllib.loads(path.read_text()), np.random.default_rng(len(path.stem))
    assert accepts(body, SCHEMA, SCHEMA)
    refused = 0
    for _ in range(12):
        other = mutated(rng, copy.deepcopy(body), KEYS)
        is_valid = VALIDATOR.is_valid(other)
        assert accepts(other, SCHEMA, SCHEMA) == is_valid
        refused += not is_valid
    assert refused


VALUES: tuple[Any, ...] = (
    0, 1, 1.0, 1.5, -2, True, False, None, math.nan, math.inf, "", "a", "name", [], [1], [1, "a"],
    [1, 2, 3], [[1]], {}, {"a": 1}, {"a": "x", "b": 2}, {"b": True}, {"name": 1, "a": []},
)  # fmt: skip
SCHEMAS: tuple[dict[str, Any], ...] = (
    {"type": "integer"}, {"type": ["number", "string"]}, {"type": "boolean"}, {"type": "null"},
    {"const": 1}, {"const": True}, {"enum": ["a", 1, False]}, {"minimum": 1}, {"maximum": 1},
    {"exclusiveMinimum": 1}, {"exclusiveMaximum": 1.5}, {"minItems": 2}, {"maxItems": 1},
    {"minProperties": 2}, {"maxProperties": 1}, {"required": ["a"]},
    {"prefixItems": [{"type": "integer"}], "items": {"type": "string"}}, {"items": False},
    {"properties": {"a": {"type": "integer"}}, "additionalProperties": False},
    {"properties": {"a": True}, "patternProperties": {"^n": False},
     "additionalProperties": {"type": "integer"}},
    {"propertyNames": {"enum": ["a"]}}, {"not": {"type": "integer"}}, {"pattern": "^n"},
    {"if": {"type": "object"}, "then": {"required": ["a"]}, "else": {"type": "number"}},
    {"if": {"type": "object"}, "then": {"required": ["a"]}}, {"anyOf": [{"const": 1}, False]},
    {"allOf": [{"type": "integer"}, {"minimum": 1}]}, {"$ref": "#/$defs/one"},
)  # fmt: skip


@pytest.mark.parametrize("schema", SCHEMAS, ids=str)
def test_each_keyword(schema: dict[str, Any]) -> None:
    """An attempt that ends without an answer is right too: jsonschema then decides."""
    whole = {**schema, "$defs": {"one": {"type": "integer", "minimum": 1}}}
    validator = jsonschema.Draft202012Validator(whole)
    if schema.keys() & {"maxProperties", "pattern"}:
        with pytest.raises(UnknownKeyword):
            accepts("", whole, whole)
        return
    for value in VALUES:
        assert accepts(value, whole, whole) == validator.is_valid(value), value
