"""Random changes of JSON values and of texts."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np

HUGE_INTEGER = 10**400
NUMBERS: tuple[Any, ...] = (
    0, 1, -1, -0.0, 2, 3, 0.5, 1e-3, 1e3, 1e-8, 1e8, 1e-20, 1e20, 1e50, -1e50, 1e-50, 1e100, -1e100, 1e-100,
    1e149, -1e149, 1e150, -1e150, 1e-150, -1e-150, 1e151, 1e160, 1e-160, 1e-310, 5e-324, 1e308,
    -1e308, 1.7976931348623157e308, 2**53, HUGE_INTEGER, -HUGE_INTEGER, 1e16, 1e-16, 7, 40, 1000,
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    True, False, None, "", "inf", "-inf", "nan", "1", "text", "\ud800", "a\nb", [], {}, [[]], [[], []],
    [1], [[1]], [[1, 2]], [[1], [2]], [[1, 2], [3]], [["a", 2]], [[True]], [None], {"a": 1},
    [1e160], ["inf"], [[1e150, 1e150], [1e150, 1e150]], [[0, 0], [0, 0]], "interval", "x" * 5000,
)  # fmt: skip


_NESTED = re.compile(r'"@(list|table) (\d+)"')


def json_text(body: Any, ascii_only: bool = False) -> str:
    """JSON text, with deep nesting where a text says "@list 700"."""

    def nesting(match: re.Match[str]) -> str:
        opening, closing = ('{"a":', "}") if match[1] == "table" else ("[", "]")
        return opening * int(match[2]) + "1" + closing * int(match[2])

    return _NESTED.sub(nesting, json.dumps(body, ensure_ascii=ascii_only))


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of everything inside."""
    paths = [path]
    if isinstance(value, dict | list) and len(path) < 20:
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            paths += places(item, (*path, key))
    return paths


def at(value: Any, path: tuple[Any, ...]) -> Any:
    """What stands at a path."""
    for key in path:
        value = value[key]
    return value


def _chosen(rng: np.random.Generator, values: Any) -> Any:
    return values[int(rng.integers(len(values)))]


def _number(rng: np.random.Generator, old: Any) -> Any:
    pick = rng.random()
    if (
        isinstance(old, int | float)
        and not isinstance(old, bool)
        and pick < 0.35
        and abs(old) < 1e300
    ):
        return _chosen(rng, [-old, old * 2, old / 3, old + 1, old * (1 + 1e-12), old * 1e-3,
                             float(rng.normal()), old * 1e6])  # fmt: skip
    return _chosen(rng, NUMBERS)


def _replace(rng: np.random.Generator, old: Any) -> Any:
    pick = rng.random()
    if isinstance(old, int | float) and pick < 0.75:
        return _number(rng, old)
    if pick < 0.97:
        return copy.deepcopy(_chosen(rng, OTHERS if pick < 0.9 else NUMBERS))
    return f"@{rng.choice(['list', 'table'])} {rng.choice([40, 60, 300, 700, 2000])}"


def _reshape(rng: np.random.Generator, old: Any) -> Any:
    """A list with an item more, less, twice, or transposed."""
    new = list(old)
    ways: list[Callable[[], Any]] = [
        lambda: new[1:], lambda: new + new[-1:], lambda: new[::-1],
        lambda: [new], lambda: [list(row) for row in zip(*new, strict=False)],
        lambda: [_replace(rng, None) if rng.random() < 0.5 else item for item in new],
    ]  # fmt: skip
    try:
        return _chosen(rng, ways)()
    except TypeError:
        return new + new


IN_RANGE = tuple(x for x in NUMBERS if x == 0 or 1e-150 <= abs(x) <= 1e150)


def renumbered(rng: np.random.Generator, body: Any, numbers: tuple[Any, ...] = IN_RANGE) -> Any:
    """A copy with other numbers, mostly such as a problem may hold, and the same structure."""
    body = copy.deepcopy(body)
    for _ in range(int(rng.geometric(0.5))):
        paths = [path for path in places(body) if type(at(body, path)) in (int, float)]
        if not paths:
            return body
        path = _chosen(rng, paths)
        parent, old, pick = at(body, path[:-1]), at(body, path), rng.random()
        if pick < 0.25 and isinstance(parent, list):  # a row in other units
            factor = (
                10.0 ** rng.integers(-150, 150)
                if rng.random() < 0.3
                else 10.0 ** rng.integers(-9, 9)
            )
            parent[:] = [
                x * factor if type(x) in (int, float) and abs(x) < 1e100 else x for x in parent
            ]
        elif pick < 0.6 and abs(old) < 1e300:
            parent[path[-1]] = _chosen(rng, [-old, old * 1.5, old / 3, old + 1, old * 1e-3, 0, 1, -1,
                                             float(rng.normal())])  # fmt: skip
        else:
            parent[path[-1]] = _chosen(rng, numbers)
    return body


def mutated(rng: np.random.Generator, body: Any, keys: tuple[str, ...] = ()) -> Any:
    """A copy with one or a few changes; keys: names that entries may be given."""
    body = copy.deepcopy(body)
    for _ in range(1 + int(rng.geometric(0.6))):
        path = _chosen(rng, places(body)[1:] or [()])
        if not path:
            return _replace(rng, body)
        parent, key = at(body, path[:-1]), path[-1]
        pick = rng.random()
        if pick < 0.6:
            parent[key] = _replace(rng, parent[key])
        elif pick < 0.75 and isinstance(parent[key], list):
            parent[key] = _reshape(rng, parent[key])
        elif pick < 0.85:
            del parent[key]
        elif pick < 0.93 and isinstance(parent, dict):
            parent[_chosen(rng, keys or ("a",))] = _replace(rng, 1.0)
        else:
            other = _chosen(rng, places(body)[1:] or [path])
            parent[key] = copy.deepcopy(at(body, other))
    return body


_BITS = (b"", b"\0", b"\xff", b",", b"\n", b"\r\n", b"[", b"]", b"{", b"}", b'"', b"nan", b"inf", b"1e400", b"true",
         b"=", b";", b" ", b"\xef\xbb\xbf", b"-", b"1e150", b"0x10", b"1_0", b"\xe2\x80\xa8", b"#")  # fmt: skip


def garbled(rng: np.random.Generator, text: bytes) -> bytes:
    """A few bytes taken out, put in or doubled; or the end is missing."""
    for _ in range(int(rng.geometric(0.5))):
        at_byte, pick = int(rng.integers(len(text) + 1)), rng.random()
        if pick < 0.6:
            cut = int(rng.integers(4))
            text = text[:at_byte] + _chosen(rng, _BITS) + text[at_byte + cut :]
        elif pick < 0.8:
            text = text[:at_byte]
        else:
            text = text[:at_byte] + text[at_byte // 2 :]
    return text
