"""Which measurements refute the bounds: one entry of room for each side of each output."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.interval.kernel import Kernel


@pytest.mark.parametrize(
    ("room", "outside"),
    [
        ([1, 1, 1, 1, 1, 1], []),
        ([0, 0, 0, 0, 0, 0], []),
        ([-1, 1, 1, 1, 1, 1], ["y1"]),
        ([1, 1, 1, -1, 1, 1], ["y1"]),
        ([1, 1, 1, 1, -1, 1], ["y2"]),
        ([1, 1, -1, 1, 1, -1], ["y3"]),
        ([1, -1, 1, -1, 1, 1], ["y1", "y2"]),
    ],
)
def test_outputs_outside_their_bounds(room: list[float], outside: list[str]) -> None:
    size: Any = SimpleNamespace(n=2, p=3)
    out = np.array([*room, -9.0, -9.0, 9.0])
    assert Kernel.implausible(size, out) == [f"{name} outside its bounds" for name in outside]
