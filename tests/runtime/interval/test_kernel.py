"""Which measurements refute the bounds: one entry of room for each side of each output."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.model import completed, exactly


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


@pytest.mark.parametrize("is_flow", [False, True])
def test_a_completed_split_is_above_the_matrix_and_keeps_its_zeros(is_flow: bool) -> None:
    rng = np.random.default_rng(5)
    X = rng.standard_normal((6, 6)) * (rng.random((6, 6)) < 0.6)
    plus, minus = np.maximum(X, 0.0), np.maximum(-X, 0.0)
    size = np.abs(X)
    if is_flow:  # the diagonal keeps its sign
        plus = np.where(np.eye(6) > 0, X, plus)
        minus = np.where(np.eye(6) > 0, 0.0, minus)
        size = np.where(np.eye(6) > 0, X, size)
    total = completed(exactly(X), plus, minus, is_flow=is_flow)
    assert (total[size == 0] == 0).all()
    assert (size <= total).all()
    assert (total <= size + 1e-15).all()
    wider = completed(exactly(X), plus + 1.0, minus + 0.5, is_flow=is_flow)  # misses X by a half
    assert (wider >= size + 1.5).all()
