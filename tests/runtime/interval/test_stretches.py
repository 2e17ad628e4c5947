"""Equal steps together: their recursion, and where equal steps end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from obsdesign.runtime.interval.stretches import Stretches


def equal_until(times: list[float], last_jump: float | None = None, regular: int = 99) -> int:
    """Row at which the equal steps from row 1 on end; the state is at the first time."""
    record = SimpleNamespace(t=np.array(times))
    clock = SimpleNamespace(regular_steps=lambda steps, _: np.arange(len(steps)) < regular)
    state = SimpleNamespace(t=times[0], guard=SimpleNamespace(last_jump=last_jump, longest=0.55))
    own: Any = SimpleNamespace(record=record, clock=clock)
    return Stretches._end_of_equal_steps(own, state, range(1, len(times)))  # type: ignore[arg-type]


def test_equal_steps_end_at_the_first_other_one() -> None:
    even = [0.125 * k for k in range(1, 11)]
    assert equal_until(even) == 10
    assert equal_until([*even, 1.4]) == 10
    assert equal_until([*even[:4], *(t + 1e-6 for t in even[4:])]) == 4
    assert equal_until(even, regular=3) == 4
    assert equal_until(even, regular=0) == 1
    # no further than the longest dwell time after the last jump, .125 + .55
    assert equal_until(even, last_jump=0.125) == 5


def test_rows_that_may_be_one_stretch_end_where_the_size_of_times_changes() -> None:
    """A step at 1.5 is another one than at 2: its time stamps are rounded otherwise."""
    t = 0.25 * np.arange(1, 20)
    y, jump = np.zeros((19, 1)), np.zeros(19, dtype=bool)
    y[10], jump[13] = np.nan, True
    record: Any = SimpleNamespace(t=t, u=None, bounds=None, jump=jump)
    ends = Stretches._ends(SimpleNamespace(record=record, y=y))  # type: ignore[arg-type]
    for row in range(19):
        end = row
        while row > 0 and end < 19 and np.isfinite(y[end, 0]) and not jump[end]:
            if end > row and np.frexp(t[end])[1] != np.frexp(t[end - 1])[1]:
                break
            end += 1
        assert ends[row] == end
