"""Is the evidence in a document what proving again gives? Entry by entry, for every kind.

Three sorts of entries. Numbers that are proved, and certificates, must be the ones found again.
Entries named as estimates (`approx_...`, everything inside `estimated`) are floats that prove
nothing: they may differ as libraries do. How a proof went (number of boxes, precision) is nobody's
promise, and is compared in its kind alone: a count stays one. Bounds whose value depends on how
their proof was cut into boxes are unconfirmed where they differ, not false. An entry that nothing
produced is never let through.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

# how a proof went: depends on the floats that steer it
_COURSE = ("bits", "boxes", "method", "periods", "smallest_box", "steps",
           "tail_from")  # fmt: skip
# of these, what is counted
_COUNTS = ("bits", "boxes", "periods", "steps")
# what a second proof adds, and a file need not have
_ADDED = "confirmed_by"
# other libraries round otherwise: less than this, relatively, is not a false statement
_LAST_DIGITS = 1e-9
_ESTIMATE, _ESTIMATE_FLOOR = 1e-2, 1e-9


# a sentence of interval observers that designs of before do not have: it promises no width
ROUNDED_WIDTHS = (
    "Widths are those of exact arithmetic and exact time stamps: what rounding and half an ulp of "
    "a time stamp add is inside the bounds, and widens them."
)

# by claim: bounds that are as sharp as the boxes of their proof, and what follows from them
_BOUNDS = {
    "strongly_observable": ("sigma_min", "margin", "spread", "largest", "recalled"),
    "rate": ("per_impulse", "constant", "in_time"),
}


# by claim: a phrase of its statement, and what designs of earlier releases have in its place
OLDER_WORDING = {
    "strongly_observable": (
        "in units of its rows and of usual spacings",
        "of that at usual spacings",
    ),
}


# where earlier releases found what a source now names
_OLDER_SOURCES = {"(lmi/windows_proof.py)": "(docs/windows.md)"}


def current_source(source: str) -> str:
    """A source as it is named today."""
    for before, now in _OLDER_SOURCES.items():
        source = source.replace(before, now)
    return source


def is_older_wording(claim: str, stored: str, statement: str) -> bool:
    """Whether a stored statement is that of an earlier release for the same claim."""
    now, before = OLDER_WORDING.get(claim, ("", ""))
    return bool(now) and now in statement and stored == statement.replace(now, before)


@dataclass(frozen=True)
class Difference:
    """Where a document and what was found differ, as `claim.entry`; false: or unconfirmed only."""

    entry: str
    false: bool


def difference(claim: str, stored: Any, found: Any) -> Difference | None:
    """The gravest difference between the JSON-ready evidence of a claim and what is found again."""
    every = list(_differences(claim, stored, found, False))
    return next((one for one in every if one.false), every[0] if every else None)


def _differences(path: str, stored: Any, found: Any, estimate: bool) -> Iterator[Difference]:
    if isinstance(stored, Mapping) and isinstance(found, Mapping):
        for key in sorted({*stored, *found}):
            here = f"{path}.{key}"
            if key not in stored and key == _ADDED:
                continue
            if key not in stored or key not in found:
                yield Difference(here, True)
            elif key in _COURSE:
                if not _alike(key, stored[key], found[key]):
                    yield Difference(here, True)
            else:
                named = key == "estimated" or key.startswith("approx_")
                gaps = _differences(here, stored[key], found[key], estimate or named)
                yield from _unconfirmed(gaps) if key in _BOUNDS.get(path, ()) else gaps
    elif isinstance(stored, list) and isinstance(found, list):
        if len(stored) != len(found):
            yield Difference(path, True)
        for i, pair in enumerate(zip(stored, found, strict=False)):
            yield from _differences(f"{path}[{i}]", *pair, estimate)
    elif _is_number(stored) and _is_number(found):
        yield from _of_numbers(path, float(stored), float(found), estimate)
    elif type(stored) is not type(found) or stored != found:
        yield Difference(path, True)


def _unconfirmed(gaps: Iterator[Difference]) -> Iterator[Difference]:
    return (Difference(gap.entry, False) for gap in gaps)


def _of_numbers(path: str, stored: float, found: float, estimate: bool) -> Iterator[Difference]:
    size, gap = max(abs(stored), abs(found)), abs(stored - found)
    if estimate:
        if gap > _ESTIMATE * size + _ESTIMATE_FLOOR:
            yield Difference(path, False)
    elif stored != found:
        yield Difference(path, gap > _LAST_DIGITS * size)


def _is_number(value: Any) -> bool:
    """JSON numbers; the word for infinity is compared as a word."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _alike(key: str, stored: Any, found: Any) -> bool:
    """The same sort of scalar: the same word, a count for a count, never below zero."""
    if isinstance(found, str):
        return bool(stored == found)
    if not _is_number(found):
        return not _is_number(stored) and not isinstance(stored, Mapping | list | str)
    whole = key not in _COUNTS or isinstance(stored, int)
    return _is_number(stored) and whole and stored >= 0
