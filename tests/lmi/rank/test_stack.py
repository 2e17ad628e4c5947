"""Stacks in floats: products one by one, their derivative, and coordinates."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact, middle, precision
from lmi.rank import stack as stacks
from lmi.rank.normalised_stack import RAISED, magnitudes, norm_above, normalised
from lmi.rank.stack import Stack
from lmi.rank.stack_box import Box


def random_stack(seed: int, r: int = 3, blocks: int = 4, flows_first: bool = False) -> Stack:
    rng = np.random.default_rng(seed)
    F, H = rng.standard_normal((2, 3, 3))
    C, right = rng.standard_normal((2, 3)), rng.standard_normal((3, r))
    return Stack(exact(F), exact(H), exact(C), exact(right), blocks, flows_first)


def by_hand(s: Stack, thetas: np.ndarray, growth: float = 0.0) -> np.ndarray:
    F, H, C, X = (np.array(M, dtype=float) for M in (s.F, s.H, s.C, s.right))
    F, rows, steps = F - growth * np.eye(3), [], list(thetas)
    if s.flows_first:
        X = expm(F * steps.pop(0)) @ X
    rows.append(C @ X)
    for theta in steps:
        X = expm(F * theta) @ H @ X
        rows.append(C @ X)
    return np.vstack(rows)


@pytest.mark.parametrize("flows_first", [True, False])
@pytest.mark.parametrize("growth", [0.0, 0.7])
def test_a_stack_is_its_products(flows_first: bool, growth: float) -> None:
    s = random_stack(0, r=2, flows_first=flows_first)
    assert s.thetas == (4 if flows_first else 3)
    assert s.shape == (8, 2)
    assert s.growth == pytest.approx(np.trace(np.array(s.F, dtype=float)) / 3)
    points = np.random.default_rng(1).uniform(0.1, 0.6, (5, s.thetas))
    values, changes = s.approx(points, growth), s.approx_change(points, growth)
    assert values.shape == changes.shape == (5, 8, 2)
    for point, value, change in zip(points, values, changes, strict=True):
        np.testing.assert_allclose(value, by_hand(s, point, growth), rtol=1e-10, atol=1e-12)
        d = 1e-5
        ends = [by_hand(s, (1 + e) * point, growth) for e in (-d, d)]
        np.testing.assert_allclose(change, (ends[1] - ends[0]) / (2 * d), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("blocks", [2, 4])
def test_coordinates_make_the_stack_orthonormal_in_the_middle(seed: int, blocks: int) -> None:
    s = random_stack(seed, blocks=blocks)
    R, full = stacks.coordinates(s, 0.1, 0.5)
    assert full
    rows = s.approx(np.full((1, s.thetas), 0.3), s.growth)[0] @ np.linalg.inv(R)
    step = expm((np.array(s.F, dtype=float) - s.growth * np.eye(3)) * 0.3) @ np.array(
        s.H, dtype=float
    )
    factor = 2.0 ** np.round(np.log2(np.abs(np.linalg.eigvals(step)).max()))
    rows /= np.repeat(factor ** np.arange(blocks), 2)[:, None]
    np.testing.assert_allclose(rows.T @ rows, np.eye(3), atol=1e-9)
    # whatever basis the state had, the coordinates z = R x are the same
    S = np.random.default_rng(9).standard_normal((3, 3))
    rebased = Stack(s.F, s.H, s.C, exact(np.array(s.right, dtype=float) @ S), blocks)
    other, _ = stacks.coordinates(rebased, 0.1, 0.5)
    np.testing.assert_allclose(other, R @ S, rtol=1e-6, atol=1e-8)


def test_columns_that_nothing_shows_have_no_coordinates() -> None:
    # x3 drives nothing: its column is zero, and as large as the largest, 2^2 here
    s = Stack(
        exact(np.zeros((3, 3))),
        exact(np.eye(3)),
        exact([[4.0, 0, 0], [0, 1.0, 0]]),
        exact(np.eye(3)),
        2,
    )
    R, full = stacks.coordinates(s, 0.1, 0.5)
    assert not full
    assert R.tolist() == np.diag([4.0, 1.0, 4.0]).tolist()
    dark = Stack(s.F, s.H, exact(np.zeros((1, 3))), s.right, 2)
    R, full = stacks.coordinates(dark, 0.1, 0.5)
    assert not full
    assert (np.eye(3) == R).all()


def test_margins_by_singular_values() -> None:
    s = random_stack(2)
    R, _ = stacks.coordinates(s, 0.1, 0.5)
    points = np.array([[0.1, 0.3, 0.5], [0.2, 0.2, 0.4]])
    for point, margin in zip(points, stacks.approx_margin(s, points, R), strict=True):
        rows = by_hand(s, point, s.growth) @ np.linalg.inv(R)
        for block in range(4):
            rows[2 * block : 2 * block + 2] /= np.linalg.norm(rows[2 * block : 2 * block + 2])
        assert margin == pytest.approx(np.linalg.svd(rows)[1][-1], rel=1e-9)
    # a unit that includes the change is larger: the margin is not
    vanishing = stacks.approx_vanishing(s, points, R)
    assert np.all(vanishing <= stacks.approx_margin(s, points, R) + 1e-12)
    assert np.all(vanishing > 0)
    few = random_stack(2, blocks=1)
    assert stacks.approx_margin(few, np.zeros((1, 0)), np.eye(3)).tolist() == [0.0]
    huge = Stack(exact(np.diag([1e4, 0.0, 0.0])), s.H, s.C, s.right, 2)
    assert np.isnan(stacks.approx_margin(huge, np.array([[1e12]]), np.eye(3))).all()


def test_blocks_of_unit_size() -> None:
    rows = np.array([[3.0, 0.0], [0.0, 4.0], [0.0, 0.0], [0.0, 0.0], [1e-9, 0.0], [0.0, 0.0]])
    scaled = stacks.unit_blocks(rows, 3)
    np.testing.assert_allclose(scaled, [[0.6, 0], [0, 0.8], [0, 0], [0, 0], [1, 0], [0, 0]])
    assert (stacks.unit_blocks(rows[None], 3)[0] == scaled).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_basis_of_the_states_starts_with_the_columns(seed: int) -> None:
    s = random_stack(seed, r=2)
    R = np.array([[2.0, 1.0], [0.0, 0.5]])
    basis = stacks.state_basis(s, R)
    columns = np.array(s.right, dtype=float) @ np.linalg.inv(R)
    np.testing.assert_allclose(basis[:, :2], columns, rtol=1e-12)
    assert np.linalg.matrix_rank(basis) == 3
    whole = random_stack(seed)
    np.testing.assert_allclose(
        stacks.state_basis(whole, np.eye(3)), np.array(whole.right, dtype=float)
    )
    # what the jump destroys completes it, as large as what it drives in a unit of time
    destroys = Stack(s.F, exact(np.diag([1.0, 1.0, 0.0])), s.C, exact(np.eye(3)[:, :2]), 4)
    last = stacks.state_basis(destroys, np.eye(2))[:, 2]
    driven = np.linalg.norm(np.array(s.F, dtype=float)[:2, 2])
    np.testing.assert_allclose(np.abs(last), [0, 0, 1 / driven], rtol=1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        stacks.state_basis(s, np.zeros((2, 2)))


@pytest.mark.parametrize("high", [0.5, 6.0])
def test_normalised_coordinates_give_the_same_stack(high: float) -> None:
    s, low = random_stack(1), 0.1
    R, _ = stacks.coordinates(s, low, high)
    with precision(128):
        n = normalised(s, low, high, R)
        assert n is not None
        assert n.unit == 2.0 ** round(math.log2(high))
        for key in ((0, 0), (2, 0), (2, 3)):
            level, index = key
            centre = low + (index + 0.5) * (high - low) / 2**level
            assert n.centre(key) * n.unit == pytest.approx(centre)
            half = (high - low) / 2 ** (level + 1) / n.unit
            assert half <= n.half(key) <= half * (1 + 1e-9)
            rows = middle(n.C * n.flow(key) * n.H * n.right) @ R
            expected = by_hand(s, np.array([centre] * 3), s.growth)[2:4]
            np.testing.assert_allclose(rows, expected, rtol=1e-6, atol=1e-9)
        assert (n.size >= np.abs(middle(n.F))).all()
        np.testing.assert_allclose(middle(n.back) @ R, np.eye(3), atol=1e-9)
    assert n.growth == s.growth * n.unit
    assert normalised(s, low, high, np.zeros((3, 3))) is None


def test_norms_from_entries() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        bound = rng.random((3, 4))
        signs = rng.choice([-1, 1], bound.shape)
        norm = np.linalg.norm(bound * signs, 2)
        assert norm <= norm_above(bound)
    assert norm_above(np.ones((2, 2))) == pytest.approx(2 * RAISED, rel=1e-12)
    assert norm_above(np.diag([3.0, 4.0])) == pytest.approx(4.0, rel=1e-9)
    assert norm_above(np.array([[3.0], [4.0]])) == pytest.approx(5.0, rel=1e-9)
    assert norm_above(np.array([[1.0, 1.0], [1.0, 0.0]])) == pytest.approx(math.sqrt(3), rel=1e-9)
    with precision(64):
        sizes = magnitudes(exact_ball(np.array([[-3.0, 0.5]])))
    assert np.all(sizes >= [[3.0, 0.5]])
    np.testing.assert_allclose(sizes, [[3.0, 0.5]], rtol=1e-9)


def exact_ball(X: np.ndarray) -> object:
    from lmi.arithmetic.balls import ball

    return ball(exact(X))


def test_halves_of_a_box_cover_it_and_no_more() -> None:
    box = Box(((0, 0), (2, 3), (1, 1)))
    for i, (level, index) in enumerate(box.sides):
        low, high = index / 2**level, (index + 1) / 2**level
        first, second = box.halves(i)
        ends = []
        for half in (first, second):
            assert half.sides[:i] == box.sides[:i]
            assert half.sides[i + 1 :] == box.sides[i + 1 :]
            finer, place = half.sides[i]
            ends.append((place / 2**finer, (place + 1) / 2**finer))
        assert ends == [(low, (low + high) / 2), ((low + high) / 2, high)]
