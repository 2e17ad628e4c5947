"""The integrals of Theorem 1 against quadrature of their definitions."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from obsdesign.equations.finite_time.error_integrals import (
    ErrorBound,
    Integrals,
    WindowMaps,
    period_integrals,
)

PERIOD = 0.8


def gains(size: float) -> Any:
    rng = np.random.default_rng(3)
    A, C, L = (size * rng.standard_normal((2, 2)), rng.standard_normal((1, 2)),
               rng.standard_normal((2, 1)))  # fmt: skip
    return SimpleNamespace(A=A, C=C, injection=L, n=2, period=PERIOD, samples=3)


@pytest.mark.parametrize("size", [0.3, 4.0])
def test_a_period_by_its_definition(size: float) -> None:
    g, y = gains(size), np.array([0.7])
    inputs = [(0.0, np.array([1.0, -0.5])), (0.3, np.array([-2.0, 0.4]))]
    F = g.A + g.injection @ g.C

    def delta(s: float) -> np.ndarray:
        return inputs[0][1] if s < 0.3 else inputs[1][1]

    def integral(function: Any, end: float) -> Any:
        return quad_vec(function, 0, end, points=[0.3], epsrel=1e-9)[0]

    def Delta(s: float) -> np.ndarray:
        q = integral(lambda r: expm(-g.A * r) @ delta(r), s)
        return np.asarray(delta(s) - g.injection @ (g.C @ q) - g.injection @ y)

    result = period_integrals(g, y, inputs)
    forced = integral(lambda s: expm(-g.A * s) @ delta(s), PERIOD)
    np.testing.assert_allclose(result.forced, forced, rtol=1e-8)
    # the midpoint rule on both sides of the change is enough for the rest
    nodes = np.concatenate(
        [0.3 * (np.arange(60) + 0.5) / 60, 0.3 + 0.5 * (np.arange(100) + 0.5) / 100]
    )
    values = [Delta(s) for s in nodes]
    onwards = sum(expm(F * (PERIOD - s)) @ v for s, v in zip(nodes, values, strict=True)) * 0.005
    np.testing.assert_allclose(result.onwards, onwards, rtol=1e-3, atol=1e-4)
    assert result.size == pytest.approx(0.005 * sum(map(np.linalg.norm, values)), rel=1e-3)


def test_a_window_is_its_periods_moved() -> None:
    g = gains(0.5)
    F = g.A + g.injection @ g.C
    rng = np.random.default_rng(0)
    periods = [Integrals(*rng.standard_normal((2, 2)), float(j + 1)) for j in range(3)]
    window = WindowMaps.from_gains(g).integrals(periods)
    forced = sum(expm(-g.A * j * PERIOD) @ part.forced for j, part in enumerate(periods))
    onwards = sum(expm(F * (2 - j) * PERIOD) @ part.onwards for j, part in enumerate(periods))
    np.testing.assert_allclose(window.forced, forced, rtol=1e-12)
    np.testing.assert_allclose(window.onwards, onwards, rtol=1e-12)
    assert window.size == 6.0


def test_the_bound_is_the_sum_of_its_three_terms() -> None:
    window = Integrals(np.array([3.0, 4.0]), np.array([0.0, 2.0]), 7.0)
    assert ErrorBound(10.0, 100.0, 1000.0).value(window) == 50.0 + 200.0 + 7000.0
