"""Reading files: UTF-8 text, at most 64 MiB and nested at most 50 deep, or a refusal."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Any

from obsdesign.errors import InputError

MOST_BYTES = 64 * 2**20
MOST_DEPTH = 50


def read_text(path: str | os.PathLike[str]) -> str:
    """Text of a file, without a byte order mark; InputError where it cannot be read."""
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read: {reason}.") from None
    if len(content) > MOST_BYTES:
        raise InputError(
            f"{path}: at most {MOST_BYTES >> 20} MiB are read; it is larger. Is it a data file?"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: UTF-8 text is required; it is not. Is it a binary file?"
        ) from None


def require_depth(value: object, name: str) -> None:
    """InputError where lists and tables are nested deeper than 50."""
    level = [value]
    for _ in range(MOST_DEPTH + 1):
        level = [
            child
            for item in level
            if isinstance(item, dict | list | tuple)
            for child in (item.values() if isinstance(item, dict) else item)
        ]
        if not level:
            return
    raise InputError(f"{name}: nested deeper than {MOST_DEPTH} lists and tables.")


def parse_json(
    text: str,
    parse_float: Callable[[str], float] | None = None,
    parse_int: Callable[[str], int] | None = None,
) -> Any:
    """The value of a JSON text, whose keys must differ; ValueError, or RecursionError."""
    return json.loads(
        text, object_pairs_hook=_keys_once, parse_constant=_refuse_constant,
        parse_float=parse_float, parse_int=parse_int,
    )  # fmt: skip


def _refuse_constant(name: str) -> float:
    raise ValueError(f'{name} is not allowed; infinity is written "inf"')


def _keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"key {twice!r} stands {names.count(twice)} times")
    return result
