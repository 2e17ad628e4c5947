"""The sliding window: products, factors and the gain of the whole window."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from obsdesign.equations.impulsive.formulas import Core, window_gains
from obsdesign.runtime import Sample
from obsdesign.runtime.impulsive.observer import ImpulsiveObserver
from obsdesign.runtime.impulsive.window import Element, SlidingWindow
from tests.systems.impulsive import plant_gains


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6))
def test_the_queue_is_the_product_of_its_elements(seed: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    elements = [
        Element(rng.standard_normal((3, 3)), rng.standard_normal((1, 3))) for _ in range(25)
    ]
    queue = SlidingWindow.from_elements(elements[:length], 1.3)
    for k in range(length, len(elements)):
        queue = queue.push(elements[k]).pop()
        inside = elements[k - length + 1 : k + 1]
        assert [id(e) for e in queue.elements()] == [id(e) for e in inside]
        move, rows = np.eye(3), []
        for age, element in enumerate(inside):
            rows.append(1.3 ** -(length - 1 - age) * element.factor @ move)
            move = element.move @ move
        product = queue.product
        assert product is not None
        assert product.count == length
        np.testing.assert_allclose(product.move, move, rtol=1e-10, atol=1e-10)
        stacked = np.vstack(rows)
        np.testing.assert_allclose(
            product.factor.T @ product.factor, stacked.T @ stacked, rtol=1e-8, atol=1e-8
        )
    with pytest.raises(IndexError):
        SlidingWindow.from_elements([], 1.3).pop()


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(
    ("n", "p", "window"), [(2, 1, 2), (3, 1, 5), (4, 2, 3), (3, 2, 2), (2, 2, 1)]
)
def test_the_sliding_gain_is_that_of_the_whole_window(
    n: int, p: int, window: int, compressed: bool
) -> None:
    rng = np.random.default_rng(n * p * window)
    A, G, C = rng.standard_normal((n, n)), rng.standard_normal((n, n)), rng.standard_normal((p, n))
    gains = plant_gains(A, G, C, window=window)
    if compressed:
        U, S = rng.standard_normal((n, n - 1)), rng.standard_normal((n - 1, n))
        gains |= {"G": U @ S, "image": U, "coimage": S, "strategy": "compressed"}
        window = gains["window"] = max(window, -(-(n - 1) // p))
    observer = ImpulsiveObserver.from_gains(gains)
    core = Core.from_gains(observer.gains, np.asarray)
    times = np.cumsum(rng.uniform(0.1, 0.8, 25))
    state = observer.init(t=0.0)
    for k, t in enumerate(times):
        state, _ = observer.step(state, Sample(t, y=np.zeros(p), jump=True))
        m = core.spacings(window)
        if k >= m:
            spacings = np.diff(times[: k + 1])[len(times[: k + 1]) - 1 - m :]
            flows = np.array([expm(A * d) for d in spacings]).reshape(m, n, n)
            whole = window_gains(core, flows, 1.4)
            L, _ = observer._gain(state)
            assert np.abs(L - whole).max() <= 1e-8 * np.abs(whole).max()
