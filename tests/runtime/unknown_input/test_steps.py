"""Steps that ring, irregular ones and coarse time stamps; noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import from_design
from tests.systems.designs import designed
from tests.systems.unknown_input import random_problem

EXAMPLES = Path(__file__).parents[3] / "examples"


def test_steps_that_ring_say_so() -> None:
    body = random_problem(1).to_dict()
    body["observer"]["poles"] = [-1, -2, -40]
    observer = from_design(designed(body))
    t = np.array([0.0, 0.04, 0.08, 0.2])
    batch = observer.run_batch(t, np.zeros((4, 3)), np.zeros((4, 2)))
    assert batch.status == ("ok", "ok", "ok", "sampling time 0.12 above 0.05 = 2/|f|")


# --- noise, and the filter ------------------------------------------------------------------------


def test_noise_table() -> None:
    from tests.long.noise_of_unknown_inputs import error

    for name, paper, limits in (
        ("ahn_1", 0.143, (0.035, 0.065, 0.22)),
        ("ahn_2", 0.151, (0.065, 0.065, 0.22)),
    ):
        for shape, limit in zip(("const", "sin", "step"), limits, strict=True):
            assert error(name, shape, "cell", 4) == pytest.approx(paper, rel=0.06)
            assert error(name, shape, "batch", 2) <= limit
        assert error(name, "const", "damped", 4) < 0.9 * paper


def test_neither_the_filter_nor_the_observer_wins_always() -> None:
    from tests.long.noise_of_unknown_inputs import error

    ours = error("ahn_1", "sin", "cell", 3)
    assert error("ahn_1", "sin", 1.0, 3) < ours  # told the right rate
    assert error("ahn_1", "sin", 0.01, 3) > 3 * ours  # told a wrong one
    assert error("ahn_1", "const", 0.01, 3) < ours / 3


@pytest.mark.parametrize("differentiator", ["cell", "damped"])
def test_irregular_periods_need_no_matrix_of_their_own(differentiator: str) -> None:
    """A step that is solved agrees with one by its matrix, and what ran before changes nothing."""
    body = random_problem().to_dict()
    body["observer"]["differentiator"] = differentiator
    observer = from_design(designed(body))
    rng = np.random.default_rng(5)
    y, u = rng.standard_normal((60, 3)), rng.standard_normal((60, 2))
    t = np.cumsum(rng.uniform(0.05, 0.15, 60))
    first = observer.run_batch(t, y, u)
    assert not observer._steps.cache
    observer.run_batch(0.1 * np.arange(60), y, u)
    assert len(observer._steps.cache) == 1
    np.testing.assert_array_equal(observer.run_batch(t, y, u).d, first.d)
    # regular samples, where the first step is solved and the others are products
    mixed = observer.run_batch(0.1 * np.arange(60), y, u)
    jittered = observer.run_batch(0.1 * np.arange(60) + 1e-13 * rng.random(60), y, u)
    np.testing.assert_allclose(jittered.x, mixed.x, atol=1e-9)
    np.testing.assert_allclose(jittered.d[1:], mixed.d[1:], atol=1e-8)


def test_time_stamps_too_coarse_for_the_step_are_told() -> None:
    observer = from_design(obsdesign.design(obsdesign.load_problem(EXAMPLES / "ahn_1.toml")))
    y = np.random.default_rng(0).standard_normal((20, 2))
    for step, is_coarse in ((5e-7, True), (1e-3, False)):
        batch = observer.run_batch(1.7e9 + step * np.arange(20), y)
        assert np.isfinite(batch.d[1:]).all()
        assert batch.status[5].startswith("time stamps resolve 4.8e-07") == is_coarse
        assert (batch.status[5] == "ok") != is_coarse


@pytest.mark.parametrize("size", [1e308, -1e200])
def test_measurements_beyond_arithmetic_are_not_used(size: float) -> None:
    observer = from_design(obsdesign.design(obsdesign.load_problem(EXAMPLES / "ahn_1.toml")))
    y = np.ones((10, 2))
    y[4, 1] = size
    batch = observer.run_batch(0.1 * np.arange(10), y)
    assert batch.status[4] == "measurement beyond 1e+150"
    assert [row for k, row in enumerate(batch.status) if k != 4] == ["ok"] * 9
    y[4] = np.nan
    missing = observer.run_batch(0.1 * np.arange(10), y)
    np.testing.assert_array_equal(batch.x, missing.x)
    np.testing.assert_array_equal(batch.d, missing.d)
