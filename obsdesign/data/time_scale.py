"""A sign that time stamps are in another unit than the plant: milliseconds for seconds, say."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from statistics import median

import numpy as np

from lmi.arithmetic.arrays import Entries
from obsdesign.data.records import Block
from obsdesign.runtime.columns import Columns

# intervals of each clock that are looked at
_MOST_INTERVALS = 200
# factor from which on a clock is hardly that of the plant
_FAR = 50.0


class TimeScale:
    """Times between rows and between jumps of a record, beside those that the problem states."""

    def __init__(self, problem: Entries) -> None:
        """problem: as a design stores it; of named sensors those that are read every so often."""
        jump, output = problem.get("jump", {}), problem.get("output", {})
        stated = {"output.period": output.get("period"), "jump.dwell_time": jump.get("dwell_time")}
        self._expected: dict[str, tuple[float, float]] = {
            entry: _ends(value) for entry, value in stated.items() if value is not None
        }
        self._columns: dict[str, slice] = {}
        first = 0
        for sensor in problem.get("sensor", ()):
            entry, last = f"sensor.{sensor['name']}.every", first + len(sensor["C"])
            every = sensor.get("every")
            if every is not None and not isinstance(every, str):
                self._expected[entry] = _ends(every)
                self._columns[entry] = slice(first, last)
            first = last
        self._intervals: dict[str, list[float]] = {entry: [] for entry in self._expected}
        self._last: dict[str, float] = {}

    def watched(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same rows; their times are noted as they pass."""
        for block in blocks:
            if isinstance(block, Columns):
                rows, jumps = block.t.tolist(), block.t[block.jump].tolist()
            else:
                rows, jumps = [block.t], [block.t] if block.jump else []
            self._note("output.period", rows)
            self._note("jump.dwell_time", jumps)
            for entry, columns in self._columns.items():
                self._note(entry, _read_at(block, columns))
            yield block

    def remarks(self, name: str) -> list[str]:
        """A remark where the median time of a clock is far from what is stated."""
        for entry, intervals in self._intervals.items():
            if not intervals:
                continue
            typical, (low, high) = median(intervals), self._expected[entry]
            if typical > _FAR * high or typical * _FAR < low:
                between = "jumps" if entry == "jump.dwell_time" else "rows"
                if entry in self._columns:
                    between = f"samples of {entry.split('.')[1]}"
                stated = f"{low:g}" if low == high else f"[{low:g}, {high:g}]"
                return [
                    f"{name}: {between} are {typical:g} apart and {entry} is {stated}. Are the "
                    "time stamps in the time unit of flow.A?"
                ]
        return []

    def _note(self, entry: str, times: Iterable[float]) -> None:
        intervals = self._intervals.get(entry)
        if intervals is None:
            return
        for t in times:
            if len(intervals) >= _MOST_INTERVALS:
                return
            if entry in self._last and t > self._last[entry]:
                intervals.append(t - self._last[entry])
            self._last[entry] = t


def _read_at(block: Block, columns: slice) -> list[float]:
    """Times of the rows with a sample in these columns of y."""
    if block.y is None:
        return []
    y = np.atleast_2d(np.asarray(block.y, dtype=np.float64))[:, columns]
    times: list[float] = np.atleast_1d(block.t)[np.isfinite(y).any(axis=1)].tolist()
    return times


def _ends(value: object) -> tuple[float, float]:
    """Shortest and longest time of an entry, a number or a pair whose end may be "inf"."""
    low, high = value if isinstance(value, list | tuple) else (value, value)
    return float(low), math.inf if high == "inf" else float(high)
