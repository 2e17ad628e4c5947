"""The filter that observers are compared with: against a batch solution, by its own statistics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.simulation import simulate
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample, rows_of
from obsdesign.studies.comparison.kalman import kalman_filter, tuned_walk
from tests.systems.clocks import renamed, two_clocks

EXAMPLES = Path(__file__).parents[3] / "examples"


def plant(rng: np.random.Generator, n: int, **output: object) -> obsdesign.Problem:
    body = {
        "flow": {"A": (rng.standard_normal((n, n)) - np.eye(n)).tolist()},
        "jump": {"G": (0.5 * rng.standard_normal((n, n))).tolist(), "dwell_time": [0.3, 1.0]},
        "output": {"C": rng.standard_normal((2, n)).tolist(), "noise_std": [0.3, 0.2], **output},
    }
    return obsdesign.Problem.from_dict(body)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), after=st.booleans())
def test_without_disturbance_it_is_weighted_least_squares(seed: int, n: int, after: bool) -> None:
    """The last state is the prior and all measurements, solved at once."""
    rng = np.random.default_rng(seed)
    when = "after" if after else "before"
    built = plant(rng, n, jump_measurement=when).plant
    t = np.cumsum(rng.uniform(0.1, 0.4, 12))
    jump = rng.random(12) < 0.4
    y = rng.standard_normal((12, 2))
    y[3] = np.nan
    Phi, rows, values = np.eye(n), [np.eye(n) / 5.0], [np.zeros(n)]
    assert built.jump is not None
    for k in range(12):
        if k:
            Phi = expm(built.flow.A * (t[k] - t[k - 1])) @ Phi
        if jump[k] and after:
            Phi = built.jump.G @ Phi
        if k != 3:
            rows.append((built.output.C @ Phi) / np.array([[0.3], [0.2]]))
            values.append(y[k] / np.array([0.3, 0.2]))
        if jump[k] and not after:
            Phi = built.jump.G @ Phi
    x0 = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    estimates = kalman_filter(built, rows_of(t, y, jump=jump), initial_variance=25.0)
    assert np.allclose(estimates.x[-1], Phi @ x0, atol=1e-7 * (1 + np.abs(Phi).max()))


def test_it_is_as_good_as_it_thinks_where_its_model_is_true() -> None:
    """The likelihood of records is highest at the noise they were made with."""
    rng = np.random.default_rng(5)
    problem = plant(rng, 2)
    record = simulate(problem.plant, until=60.0, step=0.1, rng=rng)
    samples = list(rows_of(record.t, record.block("y"), jump=record.columns["jump"]))

    def likelihood(factor: float) -> float:
        body = problem.to_dict()
        body["output"]["noise_std"] = [0.3 * factor, 0.2 * factor]
        return kalman_filter(obsdesign.Problem.from_dict(body).plant, samples).log_likelihood

    assert likelihood(1.0) > max(likelihood(0.7), likelihood(1.5))


@pytest.mark.parametrize("example", ["ahn_1", "luteinizing_hormone"])
def test_the_walk_is_tuned_and_nothing_is_told_elsewhere(example: str) -> None:
    built = obsdesign.load_problem(EXAMPLES / f"{example}.toml").plant
    rng = np.random.default_rng(1)
    record = simulate(built, until=20 * built.output.sample_period, rng=rng)
    samples = list(rows_of(record.t, record.block("y")))
    walk = tuned_walk(built, samples)
    best = kalman_filter(built, samples, walk=walk).log_likelihood
    assert all(
        best >= kalman_filter(built, samples, walk=w).log_likelihood
        for w in (walk / 10, walk * 10, 0.0)
    )
    still = obsdesign.load_problem(EXAMPLES / "mazenc_4.toml").plant
    assert tuned_walk(still, [Sample(0.0, [1.0])]) == 0.0


def test_known_inputs_and_the_unknown_one_are_used() -> None:
    body = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").to_dict()
    body["output"]["noise_std"] = [1e-3, 1e-3]
    built = obsdesign.Problem.from_dict(body).plant
    record = simulate(built, until=30.0, disturbance="extreme", rng=np.random.default_rng(2))
    d = record.block("d")[-1]
    estimates = kalman_filter(built, rows_of(record.t, record.block("y")), walk=1e-2)
    assert np.allclose(estimates.d[-1], d, atol=0.05 * (1 + np.abs(d).max()))
    assert np.allclose(estimates.x[-1], record.block("x")[-1], atol=0.05)


def test_named_events_and_sensors_are_filtered_as_a_jump_and_an_output() -> None:
    """One output of two rows is two sensors, and one jump is two events by turns."""
    plain: dict[str, Any] = two_clocks()
    plain["jump"]["E"] = [[1], [0.5]]
    plain["output"] = {"C": [[0, 1], [1, 1]], "noise_bound": [0.02, 0.1]}
    named = renamed(plain)
    event, (first, second) = named["event"][0], [[row] for row in plain["output"]["C"]]
    named["event"] = [event, {**event, "name": "other"}]
    named["sensor"] = [
        {"name": "level", "C": first, "noise_bound": 0.02, "every": "continuous"},
        {"name": "sum", "C": second, "noise_bound": 0.1, "every": "continuous"},
    ]
    plant = Problem.from_dict(plain).plant
    run = simulate(plant, until=12.0, step=0.1)
    rows = list(rows_of(run.t, run.block("y"), w=run.block("w"), jump=run.columns["jump"]))
    turns = [
        row._replace(
            events=(i % 2,) if row.jump else (),
            w=np.where(np.arange(2) == i % 2, np.asarray(row.w), np.nan),
        )
        for i, row in enumerate(rows)
    ]
    one = kalman_filter(plant, rows)
    other = kalman_filter(Problem.from_dict(named).plant, turns)
    assert sum(row.jump for row in rows) > 2
    assert np.allclose(one.x, other.x, rtol=1e-12, atol=1e-12)
    assert np.abs(one.x - run.block("x"))[20:].mean() < 0.2
