"""The streaming form: laws, missing samples, irregular periods, known inputs, random plants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from docs.figures import block_pulse
from obsdesign.data.simulation import simulate
from obsdesign.runtime import Sample, from_design
from tests.systems.designs import designed
from tests.systems.unknown_input import (
    plant_with_zeros,
    random_plant,
    random_problem,
    unknown_input_problem,
)

EXAMPLES = Path(__file__).parents[3] / "examples"


def truth(problem: obsdesign.Problem, t: np.ndarray, refine: int = 8) -> tuple[np.ndarray, ...]:
    """(x, u, mean of d over each interval) for a smooth d and a u that is held between rows."""
    flow = problem.plant.flow
    n, q = flow.D.shape
    B = np.zeros((n, 0)) if flow.B is None else flow.B
    m = B.shape[1]

    def d(s: Any) -> np.ndarray:
        s = np.asarray(s)[..., None]
        return np.sin((1 + np.arange(q)) * s + np.arange(q)) + 0.5

    u = np.sin(np.outer(np.round(t, 1), 1 + np.arange(m)))
    x, means = [np.linspace(1, 2, n)], []
    moves: dict[float, np.ndarray] = {}
    # Gauss-Legendre averages of d on each part: held there, the error is far below the test's
    points = np.arange(refine)[:, None] + np.array([0.5 - 3**-0.5 / 2, 0.5 + 3**-0.5 / 2])
    for k in range(1, len(t)):
        h = (t[k] - t[k - 1]) / refine
        key = round(h, 12)
        if key not in moves:
            block = np.zeros((n + q + m,) * 2)
            block[:n] = np.hstack([flow.A, flow.D, B]) * h
            moves[key] = expm(block)[:n]
        now, parts = x[-1], d(t[k - 1] + points * h).mean(axis=1)
        for mean in parts:
            now = moves[key] @ np.concatenate([now, mean, u[k - 1]])
        x.append(now)
        means.append(parts.mean(axis=0))
    return np.array(x), u, np.array(means)


def test_one_step_is_the_formulas_of_the_paper() -> None:
    problem = random_problem()
    g = obsdesign.design(problem).gains
    observer = from_design(obsdesign.design(problem))
    rng = np.random.default_rng(1)
    t, y, u = 0.1 * np.arange(20), rng.standard_normal((20, 3)), rng.standard_normal((20, 2))
    batch = observer.run_batch(t, y, u, x=np.ones(5))
    h, F, eye = 0.1, g["F"], np.eye(3)
    U = np.column_stack([u[:-1], np.ones(19)])  # u is held: its mean is its value
    Y, slopes = (
        block_pulse.coefficients(y),
        block_pulse.derivative(block_pulse.coefficients(y), y[0], h),
    )
    # (29), (30) as printed, for the averages W
    inverse = np.linalg.inv(eye - h / 2 * F)
    drive = h / 2 * (U @ g["Gu"].T + Y @ g["H"].T)
    W = [inverse @ (g["T"] @ np.ones(5) + drive[0])]
    for i in range(1, 19):
        W.append(inverse @ ((eye + h / 2 * F) @ W[-1] + drive[i] + drive[i - 1]))
    expected = np.array(W) @ g["Q"].T + Y @ g["R"].T + U @ g["S"].T + slopes @ g["N"].T
    np.testing.assert_allclose(batch.d[1:], expected, atol=1e-9)
    cells = np.array(W) @ g["X"].T + Y @ g["Xy"].T  # (31)
    np.testing.assert_allclose(block_pulse.coefficients(batch.x), cells, atol=1e-10)


@pytest.mark.parametrize("inputs", [1, 2])
def test_known_inputs_leave_no_error(inputs: int) -> None:
    rng = np.random.default_rng(4)
    A, C, D = random_plant(rng, 4, 2, 1)
    problem = unknown_input_problem(A - np.eye(4), C, D, rng.standard_normal((4, inputs)))
    t = np.round(0.02 * np.arange(400), 10)
    x, u, _ = truth(problem, t)
    batch = from_design(obsdesign.design(problem)).run_batch(t, x @ C.T, u, x=x[0])
    without = from_design(obsdesign.design(problem)).run_batch(t, x @ C.T, 0 * u, x=x[0])
    assert np.abs(batch.x - x).max() < 0.05 * np.abs(without.x - x).max()


@pytest.mark.parametrize("differentiator", ["cell", "damped"])
def test_a_stream_is_a_batch_and_a_state_can_be_kept(differentiator: str) -> None:
    body = random_problem().to_dict()
    body["observer"]["differentiator"] = differentiator
    observer = from_design(designed(body))
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.05, 0.2, 30))
    y, u = rng.standard_normal((30, 3)), rng.standard_normal((30, 2))
    y[[7, 8, 20]] = np.nan
    batch = observer.run_batch(t, y, u)
    state, rows = observer.init(float(t[0])), []
    saved = None
    for k in range(30):
        state, estimate = observer.step(state, Sample(t[k], y[k], u[k]))
        rows.append(estimate)
        saved = state if k == 14 else saved
    np.testing.assert_array_equal(batch.x, [row.x for row in rows])
    np.testing.assert_array_equal(batch.d, [row.d for row in rows])
    assert batch.status == tuple(row.status for row in rows)
    for k in range(15, 30):  # states are values: an old one goes on as if nothing had happened
        saved, estimate = observer.step(saved, Sample(t[k], y[k], u[k]))
    np.testing.assert_array_equal(estimate.x, rows[-1].x)


@pytest.mark.parametrize("seed", range(12))
def test_random_plants_are_recovered_at_the_rate_of_their_zeros(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = int(rng.integers(1, 4))
    n, p = int(rng.integers(q + 2, 9)), q + int(rng.integers(0, 3))
    if seed % 2 and n > q + 2 and p > q:
        A, C, D = plant_with_zeros(rng, n, p, q, np.array([[-0.8]]))
    elif p == q:  # all n - q poles are zeros: choose them
        A, C, D = plant_with_zeros(rng, n, p, q, -np.diag(rng.uniform(0.7, 3, n - q)))
    else:
        A, C, D = random_plant(rng, n, p, q)
    problem = unknown_input_problem(A, C, D)
    design = obsdesign.design(problem)
    slowest = -np.linalg.eigvals(design.gains["F"]).real.max()
    h = min(0.04, 0.3 / np.abs(np.linalg.eigvals(design.gains["F"])).max())
    t = h * np.arange(int(12 / slowest / h))
    x, _, means = truth(problem, t, refine=2)
    batch = from_design(design).run_batch(t, x @ C.T, x=np.zeros(n))
    off, d_off = np.abs(batch.x - x).max(axis=1), np.abs(batch.d[1:] - means).max(axis=1)
    size, reach = np.abs(x).max(), np.abs(batch.x).max() + 1
    assert off[0] > 1e-3  # it has something to do
    third = len(t) // 3
    assert off[-third:].max() < 5e-3 * size
    assert d_off[-third:].max() < 2e-2 * (1 + np.abs(design.gains["Q"]).max()) * reach


def test_second_order_in_the_period() -> None:
    problem = random_problem(3)
    design, errors = obsdesign.design(problem), []
    for h in (0.08, 0.04, 0.02):
        t = h * np.arange(int(12 / h))
        x, u, means = truth(problem, t)
        batch = from_design(design).run_batch(t, x @ problem.plant.output.C.T, u)
        late = t[1:] > 9
        errors.append(
            [np.abs((batch.x - x)[1:][late]).max(), np.abs((batch.d[1:] - means)[late]).max()]
        )
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(ratios > 3.4)


def test_missing_samples_and_irregular_periods() -> None:
    problem = random_problem(4)
    design = obsdesign.design(problem)
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.choice([0.005, 0.01, 0.02], 1500))
    x, u, means = truth(problem, t, refine=2)
    y = x @ problem.plant.output.C.T
    missing = rng.random(1500) < 0.1
    y[missing] = np.nan
    batch = from_design(design).run_batch(t, y, u)
    assert [s == "missing sample" for s in batch.status] == missing.tolist()
    assert np.isnan(batch.d[missing]).all()
    late = np.arange(1500) > 1000
    settled = late & ~missing
    assert np.abs(batch.x - x)[settled].max() < 2e-3 * np.abs(x).max()
    # held outputs are off by at most what y moves in the gap
    assert np.abs(batch.x - x)[late].max() < 0.3 * np.abs(x).max()
    # d is the mean since the last sample: weigh the intervals of the gap
    before, gaps = 0, 0
    for k in range(1, 1500):
        if missing[k]:
            continue
        steps = np.diff(t)[before:k]
        mean = steps @ means[before:k] / steps.sum()
        if k > 1000:
            np.testing.assert_allclose(batch.d[k], mean, atol=0.02)
            gaps += k - before > 1
        before = k
    assert gaps > 20


def test_a_known_input_that_changes_within_a_gap_counts_by_its_mean() -> None:
    problem = random_problem(5)
    design = obsdesign.design(problem)
    t = 0.02 * np.arange(800)
    x, u, _ = truth(problem, t, refine=2)
    y = x @ problem.plant.output.C.T
    y[1::2] = np.nan
    batch = from_design(design).run_batch(t, y, u)
    frozen = np.repeat(u[::2], 2, axis=0)  # as if the changes in the gaps were not seen
    other = from_design(design).run_batch(t, y, frozen)
    right = np.abs(batch.x - x)[600::2].max()
    assert right < np.abs(other.x - x)[600::2].max() / 5


def test_the_first_sample_sets_what_it_shows() -> None:
    problem = random_problem(1)
    observer = from_design(obsdesign.design(problem))
    x = np.random.default_rng(0).standard_normal(5)
    g, y = observer.gains, problem.plant.output.C @ x
    _, first = observer.step(observer.init(), Sample(0.0, y, [0.0, 0.0]))
    np.testing.assert_allclose(problem.plant.output.C @ first.x, y, atol=1e-9)
    w = g.first @ y
    np.testing.assert_allclose(g.Z @ problem.plant.output.C @ g.X @ w, g.Z @ y, atol=1e-9)
    _, guessed = observer.step(observer.init(x=x), Sample(0.0, y, [0.0, 0.0]))
    np.testing.assert_allclose(guessed.x, x, atol=1e-9)  # a guess that is right stays right
    assert np.isnan(first.d).all()


def test_missing_from_the_start_and_one_sample() -> None:
    observer = from_design(obsdesign.design(random_problem(1)))
    state, nothing = observer.step(observer.init(x=np.ones(5)), Sample(0.0, u=[0.0, 0.0]))
    assert nothing.status == "missing sample"
    np.testing.assert_array_equal(nothing.x, 1.0)
    state, first = observer.step(state, Sample(0.1, [1.0, 2, 3]))
    assert first.status == "ok"
    assert np.isnan(first.d).all()
    _, second = observer.step(state, Sample(0.2, [1.0, 2, 3]))
    assert np.isfinite(second.d).all()
    single = observer.run_batch([0.0], [[1.0, 2, 3]], [[0.0, 0.0]])
    assert single.x.shape == (1, 5)


def test_what_a_sample_may_not_be() -> None:
    observer = from_design(obsdesign.design(random_problem(1)))
    state, _ = observer.step(observer.init(), Sample(0.0, [1.0, 2, 3], [0.0, 0.0]))
    for wrong, text in (
        (Sample(0.0, [1.0, 2, 3]), "time must increase"),
        (Sample(1.0, [1.0, 2]), "y must have 3"),
        (Sample(1.0, [1.0, 2, 3], u=[1.0]), "u must have 2"),
        (Sample(1.0, [1.0, 2, 3], jump=True), "has no jumps"),
        (Sample(float("nan"), [1.0, 2, 3]), "time must be finite"),
    ):
        with pytest.raises(ValueError, match=text):
            observer.step(state, wrong)
    with pytest.raises(obsdesign.InputError, match=r"--initial must be the 5 finite numbers"):
        observer.start(0.0, [1.0])
    for name in ("F", "Q", "D", "differentiator", "first"):
        stored = observer.gains.to_document()
        gains = {key: value for key, value in stored.items() if key != name}
        with pytest.raises(ValueError, match=f"gains.{name}"):
            type(observer).from_gains(gains)


def test_the_middle_of_the_bounds_of_b_is_used() -> None:
    body = random_problem(2).to_dict()
    body["flow"]["disturbance"] = {"lower": [1.0] * 5, "upper": [3.0] * 5}
    problem = obsdesign.Problem.from_dict(body)
    record = simulate(problem.plant, until=20.0, step=0.01, disturbance="zero")
    design = obsdesign.design(problem)
    batch = from_design(design).run_batch(record.t, record.block("y"), record.block("u"))
    assert np.abs(record.block("x")[-1]).max() > 2
    np.testing.assert_allclose(batch.x[-1], record.block("x")[-1], atol=1e-3)
    np.testing.assert_allclose(batch.d[-1], 0.0, atol=1e-3)
