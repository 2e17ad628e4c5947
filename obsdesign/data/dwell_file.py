"""A sequence of dwell times from a file: one number a line, or the witness of an answer.

An answer is what `design --json`, `verify --json` or `search --json` print, or a design file; its
first witness that names dwell times is taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from lmi.arithmetic.arrays import Value
from obsdesign.entries import number_from_text, real
from obsdesign.errors import InputError
from obsdesign.input_files import parse_json, read_text, require_depth


def read_dwell_times(path: str) -> list[float]:
    """Positive finite numbers, at least one; InputError for anything else."""
    text = read_text(path)
    is_json = text.lstrip().startswith(("{", "["))
    dwell_times = _answer(text, path) if is_json else _lines(text, path)
    if not dwell_times:
        raise InputError(f"{path}: at least one dwell time is required; the file holds none.")
    return dwell_times


def _lines(text: str, path: str) -> list[float]:
    """Numbers, one a line; a first line of words is a header."""
    dwell_times = []
    for number, line in enumerate(text.splitlines(), start=1):
        cell = line.strip().rstrip(",")
        if not cell or (number == 1 and not _starts_a_number(cell)):
            continue
        try:
            dwell_times.append(_positive(number_from_text(cell)))
        except ValueError:
            raise InputError(
                f"{path} line {number}: a dwell time must be a positive finite number; "
                f"got {cell[:40]!r}."
            ) from None
    return dwell_times


def _starts_a_number(cell: str) -> bool:
    return cell[0] in "+-.0123456789" or cell.lower() in ("nan", "inf")


def _positive(value: float) -> float:
    if not (value > 0 and math.isfinite(value)):
        raise ValueError
    return value


def _answer(text: str, path: str) -> list[float]:
    try:
        body = parse_json(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}).") from None
    require_depth(body, path)
    candidates = [body] if isinstance(body, list) else _sequences(body)
    for values in candidates:
        try:
            return [_positive(real(value, "a dwell time")) for value in values]
        except (InputError, TypeError, ValueError):
            continue
    raise InputError(
        f"{path}: a list of positive dwell times, or an answer with a witness that names them, "
        "is required; it has none."
    )


def _sequences(body: Value) -> Iterator[list[Value]]:
    """Dwell times of all witnesses, in the order of the file."""
    if isinstance(body, Mapping):
        witness = body.get("witness")
        if isinstance(witness, Mapping):
            if isinstance(witness.get("thetas"), list):
                yield witness["thetas"]
            if isinstance(witness.get("theta"), int | float):
                yield [witness["theta"]]
        for item in body.values():
            yield from _sequences(item)
    elif isinstance(body, list):
        for item in body:
            yield from _sequences(item)
