"""Which measurements refute the bounds: one entry of room for each side of each output."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.model import Model, completed, exactly


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


def test_the_middle_of_the_noise_is_taken_from_every_measurement() -> None:
    """K (y - middle - C z): the column for 1 loses K times the middle, for each K."""
    rng = np.random.default_rng(8)
    known, K, L = rng.standard_normal((2, 3)), rng.standard_normal((2, 1)), np.ones((2, 1))
    own: Any = SimpleNamespace(y_mid=np.array([0.75]))
    column = Model.less_middle(own, exactly(known), exactly(K), None, exactly(L))
    expected = known[:, 2] - 0.75 * (K + L)[:, 0]
    assert (np.abs(column.mid[:, 2] - expected) <= column.rad[:, 2] + 1e-15).all()
    assert (column.mid[:, :2] == known[:, :2]).all()
    own.y_mid = np.zeros(1)
    assert (Model.less_middle(own, exactly(known), exactly(K)).mid == known).all()
