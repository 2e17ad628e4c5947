"""The few numbers behind a claim, in words and digits; its matrices stay in the design file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal, localcontext

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


# columns of the table of states: entry of a row, title
_COLUMNS = {
    "strip": "sensor strip", "width": "guaranteed", "error": "guaranteed", "typical": "typical",
    "best": "best possible",
}  # fmt: skip
_ROUNDING = {"width": ROUND_CEILING, "error": ROUND_CEILING, "best": ROUND_FLOOR}
_MOST_STATES = 12
# a width above so many sensor strips is more than rounding
_WIDER = 1.001


def state_table(rows: Sequence[Entries]) -> list[list[str]]:
    """Numbers of each state as text, the titles first; `StateWidths` has what they mean.

    Columns that no state has a number for are left out, and so are states beyond twelve. Widths
    that are guaranteed for one pattern of samples and jumps alone are titled with it.
    """
    shown = {key: title for key, title in _COLUMNS.items()
             if any(row.get(key) is not None for row in rows)}  # fmt: skip
    if "width" in shown and (pattern := rows[0].get("pattern")):
        shown["width"] += f"\nwith {pattern}".replace(" and ", "\nand ")
    is_of_widths = any(row[key] is not None for row in rows for key in ("strip", "width"))
    table = [["width of" if is_of_widths else "error of", *shown.values(), ""]]
    for row in rows[:_MOST_STATES]:
        unit = "" if row["unit"] is None else f" [{row['unit']}]"
        numbers = ("–" if row.get(key) is None else _three_digits(key, row[key]) for key in shown)
        table.append([row["name"] + unit, *numbers, _remark(row)])
    if len(rows) > _MOST_STATES:
        table.append([f"{len(rows) - _MOST_STATES} more: --json", *[""] * len(shown), ""])
    return table


def _three_digits(key: str, value: float) -> str:
    """A number of a column: proved bounds rounded up, what none can be below rounded down.

    Digits beyond the ninth do not count: 0.1 less a rounding error is shown as 0.1.
    """
    with localcontext(prec=3, rounding=_ROUNDING.get(key, ROUND_HALF_EVEN)):
        return f"{float(+Decimal(f'{value:.9g}')):.3g}"


def _remark(row: Entries) -> str:
    """A remark on a state whose bounds are guaranteed wider than one sample alone leaves them."""
    strip, width = row["strip"], row["width"]
    is_wider = strip is not None and width is not None and width > _WIDER * strip
    return "> strip" if is_wider else ""
