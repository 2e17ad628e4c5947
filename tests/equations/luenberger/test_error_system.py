"""Cells of a schedule of gains, and which may follow each other; the post-jump inequality."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.equations.luenberger import error_system as equations


def test_cells_divide_the_range_a_little_wider_than_their_borders() -> None:
    room = equations.BORDER
    cells = equations.schedule_cells(1.0, 4.0, [2.0, 3.0])
    assert cells == ((1.0, 2 * (1 + room)), (2 * (1 - room), 3 * (1 + room)), (3 * (1 - room), 4.0))
    assert equations.schedule_cells(1.0, math.inf, []) == ((1.0, math.inf),)
    # a border at the end of the range stays inside it
    assert equations.schedule_cells(1.0, 4.0, [1.0, 4.0]) == (
        (1.0, 1 + room), (1.0, 4.0), (4 * (1 - room), 4.0),
    )  # fmt: skip
    assert [equations.cell_count(one) for one in (3, [2.0, 3.0], [])] == [3, 3, 1]


@pytest.mark.parametrize(
    ("jitter", "apart"),
    [(math.inf, []), (1.0, []), (0.999999, [(0, 2), (2, 0)]), (0.0, [(0, 2), (2, 0)])],
)
def test_cells_that_are_apart_do_not_follow_each_other(jitter: float, apart: list) -> None:
    cells = equations.schedule_cells(1.0, 4.0, [2.0, 3.0])
    every = [(i, j) for i in range(3) for j in range(3)]
    pairs = equations.schedule_pairs(cells, jitter)
    assert list(pairs) == [pair for pair in every if pair not in apart]


def test_pairs_of_cells_without_end() -> None:
    cells = ((1.0, 2.0), (5.0, math.inf))
    assert equations.schedule_pairs(cells, 2.5) == ((0, 0), (1, 1))
    assert len(equations.schedule_pairs(cells, 3.0)) == 4


@pytest.mark.parametrize("seed", range(3))
def test_the_inequality_says_that_the_error_shrinks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, G = rng.standard_normal((2, 3, 3))
    M, output = 0.1 * rng.standard_normal((3, 1)), rng.standard_normal((1, 3))
    X = rng.standard_normal((3, 3))
    P, before = X @ X.T + np.eye(3), np.diag([1.0, 2.0, 3.0])
    flows = np.array([expm(A * theta) for theta in (0.1, 0.5)])
    for earlier, block in ((P, None), (before, before)):
        whole = equations.post_jump_inequality(P, P @ M, G, output, flows, before=block)
        assert whole.shape == (2, 6, 6)
        for E, one in zip(flows, whole, strict=True):
            assert (one == one.T).all()
            for size in (0.01, 100.0):  # Schur's complement of the lower right block
                H = (G - M @ output) @ E
                scaled = np.block([[earlier / size, one[:3, 3:]], [one[3:, :3], one[3:, 3:]]])
                shrinks = np.linalg.eigvalsh(earlier / size - H.T @ P @ H).min() > 0
                assert (np.linalg.eigvalsh(scaled).min() > 0) == shrinks
            assert (one[:3, :3] == earlier).all()
            assert (one[3:, 3:] == P).all()
