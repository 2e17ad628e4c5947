"""Designs that were changed and signed again: what is not found again is not let through."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.design_file import from_dict
from obsdesign.document import digest

EXAMPLES = Path(__file__).parents[3] / "examples"


@functools.cache
def written() -> Any:
    problem = obsdesign.load_problem(EXAMPLES / "ahn_2.toml")
    return obsdesign.design(problem).to_dict()


def verdict(body: Any) -> str:
    return obsdesign.verify(from_dict({**body, "digest": digest(body)})).verdict


def numbers(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in pairs:
        if isinstance(item, dict | list):
            yield from numbers(item, (*path, key))
        elif isinstance(item, int | float) and not isinstance(item, bool):
            yield (*path, key)


def test_every_number_of_gains_and_evidence_is_found_again() -> None:
    """Each by itself: another sign, another size; nothing of it is proved."""
    count = 0
    for block in ("claims", "gains"):
        for path in numbers(written()[block]):
            for change in (lambda v: -v - 0.5, lambda v: v * 1.5 + 1e-3):
                body = copy.deepcopy(written())
                place = body[block]
                for key in path[:-1]:
                    place = place[key]
                place[path[-1]] = change(place[path[-1]])
                assert verdict(body) != "proved", (block, path)
                count += 1
    assert count > 100


def test_the_file_as_written_is_proved() -> None:
    assert verdict(copy.deepcopy(written())) == "proved"


@pytest.mark.parametrize("kind", ["", "unknown_inputs", "os.path", "__init__"])
def test_a_file_of_no_kind_is_refused_in_a_line(kind: str) -> None:
    body = copy.deepcopy(written()) | {"kind": kind}
    with pytest.raises(obsdesign.InputError, match="kind must be one of") as error:
        verdict(body)
    assert "\n" not in str(error.value)
    assert repr(kind) in str(error.value)
