"""Equal steps together: recursions by blocks are those one by one, and where equal steps end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.interval import stretches
from obsdesign.runtime.interval.stretches import Stretches


@pytest.mark.parametrize("count", [1, 2, 31, 33, 100, 257])
@pytest.mark.parametrize("n", [1, 3])
def test_recursions_by_blocks(count: int, n: int) -> None:
    rng = np.random.default_rng(count)
    A, driven, start = (
        rng.standard_normal((n, n)),
        rng.standard_normal((count, n)),
        rng.standard_normal(n),
    )
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    expected, upper, x, r = [], [], start, np.abs(start)
    R, added = np.abs(A) * 0.5, np.abs(driven)
    R[0, -1] = 0.0 if n > 1 else R[0, -1]
    for k in range(count):
        x, r = A @ x + driven[k], R @ r + added[k]
        expected.append(x)
        upper.append(r)
    np.testing.assert_allclose(
        stretches._recursion(A, driven, start), expected, rtol=1e-9, atol=1e-9
    )
    bound = stretches._upper_recursion(R, added, np.abs(start))
    assert np.all(bound >= np.array(upper) * (1 - 1e-15))
    np.testing.assert_allclose(bound, upper, rtol=1e-11)


def test_what_nothing_drives_stays_at_rest() -> None:
    R, added = np.diag([0.5, 0.25]), np.zeros((70, 2))
    bound = stretches._upper_recursion(R, added, np.array([1.0, 0.0]))
    np.testing.assert_allclose(bound[:, 0], 0.5 ** np.arange(1, 71), rtol=1e-11)
    assert np.all(bound[:, 1] < 1e-300)


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
