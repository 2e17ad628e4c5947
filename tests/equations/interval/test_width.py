"""Splits and the width of interval observers: laws, and the width that constant dwell times give."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from obsdesign.equations.interval import splits
from obsdesign.equations.interval.width import Coordinates, _jump_width, periodic_width


@pytest.mark.parametrize("seed", range(3))
def test_splits_are_exact_minimal_and_of_the_right_sign(seed: int) -> None:
    F = np.random.default_rng(seed).standard_normal((4, 4))
    off = ~np.eye(4, dtype=bool)
    D0, D1 = splits.metzler_split(F)
    assert (D0 - D1 == F).all()
    assert (D0[off] >= 0).all()
    assert (D1 >= 0).all()
    assert (np.diag(D1) == 0).all()
    assert ((D0 * D1)[off] == 0).all()  # minimal: one of both is zero
    assert (splits.absolute_metzler(F) == D0 + D1).all()
    assert (splits.absolute_metzler(F)[off] == np.abs(F)[off]).all()
    Gp, Gn = splits.nonnegative_split(F)
    assert (Gp - Gn == F).all()
    assert (Gp + Gn == np.abs(F)).all()
    assert (Gp * Gn == 0).all()
    # a rounded split is completed to one of F itself, and no entry gets smaller
    change = 1e-3 * np.random.default_rng(9).standard_normal((4, 4))
    plus, minus = splits.completed_split(F, Gp + change, Gn)
    np.testing.assert_allclose(plus - minus, F, atol=1e-15)
    assert (plus >= Gp + change).all()
    assert (minus >= Gn).all()


def test_flow_and_jump_that_the_splits_are_of() -> None:
    A, C, G = np.diag([1.0, 2.0]), np.array([[1.0, 0.0]]), 3 * np.eye(2)
    gains = {"L": np.array([[1.0], [1.0]]), "M": np.array([[2.0], [0.0]])}
    F, H = splits.flow_and_jump(A, C, G, **gains, jump_measurement="before", is_periodic=False)
    assert F.tolist() == [[0.0, 0.0], [-1.0, 2.0]]
    assert H is not None
    assert H.tolist() == [[1.0, 0.0], [0.0, 3.0]]
    for G_or_none in (G, None):
        own = splits.flow_and_jump(
            A, C, G_or_none, **gains, jump_measurement="before", is_periodic=True
        )
        assert own == (A, G_or_none) or (own[0] is A and own[1] is G_or_none)
    F, H = splits.flow_and_jump(A, C, None, **gains, jump_measurement="none", is_periodic=False)
    assert H is None


@pytest.mark.parametrize("seed", range(3))
def test_constant_dwell_times_lead_to_the_periodic_width(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, dwell = 1 + seed, 0.6
    W, N = rng.random((n, n)), rng.random((n, n)) / (2 * n)
    W -= np.diag(W.sum(axis=1) + rng.random(n))
    f, h = rng.random(n), rng.random(n)
    Z = np.zeros((n + 1, n + 1))
    Z[:n, :n], Z[:n, n] = W, f
    step, w = expm(Z * dwell / 2000), np.append(np.zeros(n), 1.0)
    for _ in range(30):
        path = [w]
        for _ in range(2000):
            path.append(step @ path[-1])
        w = np.append(N @ path[-1][:n] + h, 1.0)
    before, after, mean = periodic_width(W, N, f, h, dwell)
    np.testing.assert_allclose(before, path[-1][:n], rtol=1e-6)
    np.testing.assert_allclose(after, w[:n], rtol=1e-6)
    np.testing.assert_allclose(mean, np.mean(path, axis=0)[:n], rtol=1e-3)
    # the twin: it does not settle where a cycle does not shrink it
    with pytest.raises(ValueError, match=r"does not settle at dwell time 0.6"):
        periodic_width(W, 9 * n * np.eye(n) + N, f, h, dwell)
    with pytest.raises(ValueError, match="does not settle"):
        periodic_width(np.zeros((1, 1)), np.eye(1), f[:1], h[:1], dwell)


@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_second_coordinates_that_are_the_first_change_nothing(when: str) -> None:
    rng = np.random.default_rng(7)
    H, M, C = rng.random((3, 3)), rng.standard_normal((3, 1)), rng.standard_normal((1, 3))
    c = np.sort(rng.standard_normal((2, 3)), axis=0)
    gains: Any = SimpleNamespace(
        is_periodic=False, jump_measurement=when, M=M, C=C, noise_bound=np.array([0.25]),
        jump_disturbance=(np.eye(3), c[0], c[1]), jump_split=(H, 0 * H), T=H,
    )  # fmt: skip
    one, two = (
        _jump_width(
            gains, Coordinates.from_matrices(S, S, np.linalg.inv, np.asarray), H, np.asarray
        )
        for S in (None, np.eye(3))
    )
    for plain, other in zip(one, two, strict=True):
        np.testing.assert_allclose(plain, other, rtol=1e-12)
    np.testing.assert_allclose(one[0], H)
    through = {"before": np.eye(3), "after": np.eye(3) - M @ C, "none": np.eye(3)}[when]
    noise = 0.0 if when == "none" else 0.5 * np.abs(M[:, 0])
    np.testing.assert_allclose(one[1], np.abs(through) @ (c[1] - c[0]) + noise, rtol=1e-12)
