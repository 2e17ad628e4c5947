"""The few numbers behind a claim, in words and digits; its matrices stay in the design file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from lmi.arithmetic.arrays import Entries

_MOST_LISTED = 8


def numbers_of(evidence: Entries, prefix: str = "") -> Iterator[tuple[str, str]]:
    """(name, value) of the few numbers of a proof, as texts; matrices stay in the file."""
    for key, value in evidence.items():
        name = f"{prefix}{key.replace('_', ' ')}"
        if isinstance(value, Mapping):
            if key != "witness" and len(value) <= _MOST_LISTED:
                yield from numbers_of(value, f"{name}: ")
        elif isinstance(value, bool | str | int | float | np.number):
            yield name, _number(value)
        elif _is_short_list(value):
            yield name, ", ".join(_number(x) for x in value)


def _is_short_list(value: object) -> bool:
    if not isinstance(value, list | tuple | np.ndarray) or len(value) > _MOST_LISTED:
        return False
    return all(isinstance(x, bool | str | int | float | np.number) for x in value)


def _number(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float | np.number) else str(value)


def state_table(rows: Sequence[Entries]) -> list[list[str]]:
    """Widths of each state as text, the titles first; `StateWidths` has what they mean."""
    titles = {"strip": "sensor strip", "width": "certified width", "best": "least possible",
              "ratio": "ratio"}  # fmt: skip
    table = [["state", *titles.values()]]
    for row in rows:
        unit = "" if row["unit"] is None else f" [{row['unit']}]"
        numbers = ("-" if row[key] is None else f"{row[key]:.4g}" for key in titles)
        table.append([row["name"] + unit, *numbers])
    return table
