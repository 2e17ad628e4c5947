"""Ranges [shortest, longest] of times between two jumps or two samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from lmi.arithmetic.arrays import Value
from obsdesign.entries import real, shown
from obsdesign.equations.time_grid import steps_of
from obsdesign.errors import InputError


def time_range(values: Value, entry: str, what: str) -> tuple[float, float] | None:
    """(shortest, longest) from a pair; None for None. InputError for what is no range of times.

    entry: its name in messages; what: what is in the range, as "dwell time".
    """
    if values is None:
        return None
    if isinstance(values, str) or not hasattr(values, "__len__") or len(values) != 2:
        raise InputError(f"{entry} must be a pair [shortest, longest]; got {shown(values)}.")
    low, high = (real(value, entry) for value in values)
    if math.isnan(low) or math.isnan(high):
        raise InputError(f"{entry} must be numbers; got {shown([low, high])}.")
    if math.isinf(low):
        raise InputError(f"{entry}: the shortest {what} must be finite; got [{low}, {high}].")
    if low < 0:
        raise InputError(f"{entry}: the shortest {what} must be >= 0; got [{low:g}, {high:g}].")
    if low > high:
        raise InputError(
            f"{entry} must be [shortest, longest]; got [{low:g}, {high:g}]. Is it reversed?"
        )
    if high == 0:
        raise InputError(f"{entry}: the longest {what} must be > 0; got [0, 0].")
    return low + 0.0, high


class Timed(Protocol):
    """A block with a clock."""

    @property
    def entry(self) -> str:
        """What messages call it."""

    @property
    def stated_times(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Entries that hold times of its clock, each with these."""


def require_on_grid(blocks: Iterable[Timed], dt: float) -> None:
    """InputError unless all finite times are multiples of the step of discrete time."""
    for block in blocks:
        for key, times in block.stated_times:
            for time in times:
                if math.isfinite(time) and steps_of(time, dt) is None:
                    raise InputError(
                        f"{block.entry}.{key} must be a multiple of flow.dt = {dt:g}: nothing "
                        f"happens between two steps; got {time:g}."
                    )
