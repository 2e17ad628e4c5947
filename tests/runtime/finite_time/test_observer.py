"""Finite-time observers on data: exactness, bounds, gaps, irregular times, jumps, laws."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.errors import InputError
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.finite_time import observer as finite_time
from obsdesign.runtime.finite_time.window import flowed, held_input
from tests.systems.command_line import command
from tests.test_architecture import SOLVERS, run_blocked
from tests.verification.finite_time.test_claims import ROTATION, L, sampled_problem

METHODS = ("least_squares", "exact", "minimax")
# estimates of plants that neither amplify nor forget much in a window
ROUNDING = 1e-9


def observer_of(problem: obsdesign.Problem) -> Any:
    return from_design(obsdesign.design(problem))


def random_plant(rng: np.random.Generator, n: int, p: int) -> tuple[Any, Any]:
    """Eigenvalues on both sides of the axis, of size about one."""
    A = rng.standard_normal((n, n)) / np.sqrt(n)
    return A + rng.uniform(-0.5, 0.5) * np.eye(n), rng.standard_normal((p, n))


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10**6), n=st.integers(1, 6), p=st.integers(1, 3),
    method=st.sampled_from(["least_squares", "exact"]),
)  # fmt: skip
def test_random_plants_to_rounding_after_the_window(seed: int, n: int, p: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    A, C = random_plant(rng, n, min(n, p))
    B = rng.standard_normal((n, 2))
    given_gain = (
        {"gains": {"L": 0.3 * rng.standard_normal((n, len(C)))}} if method == "exact" else {}
    )
    k, period = 4 * n, 0.25
    problem = sampled_problem(
        A, C, period, window=k * period, method=method, flow={"B": B}, **given_gain
    )
    outcome = obsdesign.investigate(problem)
    if outcome.verdict != "proved":  # a random L may miss; least squares may not
        assert method == "exact"
        return
    # inputs change at every row, and rows lie between samples as well
    record = simulate(
        problem.plant, until=2.5 * k * period, step=period / 2, initial=rng.standard_normal(n),
        disturbance="zero", rng=rng,
    )  # fmt: skip
    batch = from_design(outcome.design).run_batch(record.t, record.block("y"), record.block("u"))
    full = np.array([status == "ok" for status in batch.status])
    x = record.block("x")
    assert full.sum() == len(record.t) - 2 * k
    amplified = {c.id: c for c in outcome.claims}["unbiased"].evidence["amplification"]
    size = np.abs(x).max()
    assert np.abs(batch.x - x)[full].max() <= 1e-13 * amplified * size * n


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 4), method=st.sampled_from(METHODS))
def test_bounds_hold_against_any_signal(seed: int, n: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    A, C = random_plant(rng, n, int(rng.integers(1, 3)))
    k, period = 3 * n, 0.25
    half = rng.uniform(0, 0.2, n)
    problem = sampled_problem(
        A, C, period, window=k * period, method=method,
        flow={"disturbance": {"lower": -half, "upper": 2 * half}, "B": rng.standard_normal((n, 1))},
        output={"noise_bound": rng.uniform(0.01, 0.1, len(C))},
        **({"gains": {"L": 0.3 * rng.standard_normal((n, len(C)))}} if method == "exact" else {}),
    )  # fmt: skip
    outcome = obsdesign.investigate(problem)
    if outcome.design is None or outcome.verdict != "proved":
        return
    observer: Any = from_design(outcome.design)
    for disturbance in ("extreme", "random", "sine"):
        record = simulate(
            problem.plant, until=3 * k * period, step=period / 2, disturbance=disturbance, rng=rng
        )
        batch = observer.run_batch(record.t, record.block("y"), record.block("u"))
        x = record.block("x")
        assert (batch.lower <= x).all()
        assert (x <= batch.upper).all()
        assert np.isfinite(batch.upper[-1]).all()


def test_bounds_are_attained_by_a_switching_disturbance() -> None:
    """b at its bounds with the signs of its weights, v too: within one per cent of the radius."""
    from lmi.arithmetic.exponential import expm

    problem = sampled_problem(
        window=6, method="exact", gains={"L": L}, output={"noise_bound": [0.01]},
        flow={"disturbance": {"lower": [-0.02, -0.02], "upper": [0.02, 0.02]}},
    )  # fmt: skip
    design = obsdesign.design(problem)
    G, A, C = (design.gains[name] for name in ("window_gain", "A", "C"))
    k, period, fine = 120, 0.05, 8
    for r in range(2):
        R, rows = np.zeros((2, 2)), []
        for j in range(k):
            R = R @ expm(-A * period) + G[:, j : j + 1] @ C
            rows += [R @ expm(-A * period * (i + 0.5) / fine) for i in range(fine)]
        push = -0.02 * np.sign(np.array(rows)[:, r])
        x, y = np.zeros(2), []
        block = np.zeros((4, 4))
        block[:2, :2], block[:2, 2:] = A, np.eye(2)
        step = expm(block * (period / fine))[:2]
        for i, b in enumerate(push):
            if i % fine == 0:
                y.append(C @ x + 0.01 * np.sign(G[r, i // fine]))
            x = step @ np.concatenate([x, b])
        t = np.round(period * np.arange(k + 1), 10)
        batch = observer_of(problem).run_batch(t, np.array([*y, C @ x]))
        error = abs(batch.x[-1] - x)[r]
        assert 0.99 * design.gains["radius"][r] <= error <= design.gains["radius"][r]
        assert batch.lower[-1][r] <= x[r] <= batch.upper[-1][r]


# --- gaps, times, jumps ---------------------------------------------------------------------------


def record_of(problem: obsdesign.Problem, until: float = 15.0) -> Any:
    return simulate(problem.plant, until=until, initial=[0, 2], disturbance="zero")


@pytest.mark.parametrize("method", ["least_squares", "exact", "approximate"])
def test_missing_samples(method: str) -> None:
    given_gain = {} if method == "least_squares" else {"gains": {"L": L}}
    problem = sampled_problem(
        period=0.25, window=3, method=method, flow={"B": [[1], [0]]}, **given_gain
    )
    record = record_of(problem)
    x, y, u = record.block("x"), record.block("y").copy(), record.block("u")
    y[[20, 21, 30]] = np.nan
    batch = observer_of(problem).run_batch(record.t, y, u)
    expected = ["window not full"] * 12 + ["ok"] * (len(y) - 12)
    for gap in (20, 21, 30):
        for i in range(gap + 1, gap + 13):
            expected[i] = "missing sample"
    assert list(batch.status) == expected
    if method != "approximate":  # what is left, or the plant's prediction
        assert np.abs(batch.x - x)[12:].max() < ROUNDING
    # a row that is not there is a missing sample as well
    kept = np.delete(np.arange(len(y)), [20, 21, 30])
    fewer = observer_of(problem).run_batch(record.t[kept], y[kept], u[kept])
    assert [batch.status[i] for i in kept] == list(fewer.status)
    if method != "approximate":
        held = np.delete(u, [20, 21, 30], axis=0)
        assert np.array_equal(held, u[kept])


def test_too_many_missing_samples_are_predicted() -> None:
    problem = sampled_problem(period=0.25, window=0.75)
    record = record_of(problem)
    y = record.block("y").copy()
    y[10:12] = np.nan  # one sample of three is left: not enough for two states
    batch = observer_of(problem).run_batch(record.t, y)
    assert np.abs(batch.x - record.block("x"))[3:].max() < ROUNDING
    assert set(batch.status[11:15]) == {"missing sample"}
    assert batch.status[15] == "ok"


def test_a_long_silence_empties_the_window() -> None:
    problem = sampled_problem(period=0.25, window=1)
    observer = observer_of(problem)
    state = observer.init()
    for i in range(6):
        state, estimate = observer.step(state, Sample(0.25 * i, y=[1.0]))
    assert estimate.status == "ok"
    state, estimate = observer.step(state, Sample(1e6, y=[1.0]))
    assert estimate.status == "window not full"


def test_times_are_regular_after_a_gap_of_more_than_a_window() -> None:
    observer = observer_of(sampled_problem(period=0.25, window=1))
    for first in (0, 1):  # the gap begins at the very first sample, or later
        state, statuses = observer.init(), []
        for i in [*range(first + 1), 10, 11, 12, 13, 14]:
            state, estimate = observer.step(state, Sample(0.25 * i, y=[1.0]))
            statuses.append(estimate.status)
        assert statuses == ["window not full"] * (first + 5) + ["ok"]


def test_irregular_times_start_again() -> None:
    problem = sampled_problem(period=0.25, window=1)
    observer = observer_of(problem)
    state = observer.init()
    statuses = []
    for t in (0, 0.25, 0.5, 0.75, 1.0, 1.32, 1.57, 1.82, 2.07, 2.32, 2.57):
        state, estimate = observer.step(state, Sample(t, y=[1.0]))
        statuses.append(estimate.status)
    assert statuses[4] == "ok"
    assert statuses[5] == "sampling time 0.32 is not a multiple of 0.25; window not full"
    assert statuses[6:9] == ["window not full"] * 3
    assert statuses[9:] == ["ok", "ok"]


def test_decimal_times_are_regular_for_long() -> None:
    problem = sampled_problem(period=0.1, window=1)
    observer = observer_of(problem)
    times = np.array([float(f"{i * 0.1:.1f}") for i in range(20000)]) + 1e5
    batch = observer.run_batch(np.round(times, 1), np.ones((20000, 1)))
    assert set(batch.status[10:]) == {"ok"}


@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_a_jump_starts_the_window_again(when: str) -> None:
    problem = sampled_problem(
        period=0.25, window=2, flow={"B": [[1], [0]]}, output={"jump_measurement": when},
        jump={"G": [[1, 0], [0.5, -1]], "dwell_time": [5, 5]},
    )  # fmt: skip
    record = record_of(problem, until=14)
    jump = record.columns["jump"]
    batch = observer_of(problem).run_batch(
        record.t, record.block("y"), record.block("u"), jump=jump
    )
    full = np.array([status == "ok" for status in batch.status])
    assert np.abs(batch.x - record.block("x"))[full].max() < ROUNDING
    since = 8 if when == "after" else 9  # the sample of the jump's row counts only if taken after
    for row in np.flatnonzero(jump):
        assert not full[row : row + since].any()
        assert full[row + since : row + 15].all()
    with pytest.raises(ValueError, match="this plant has no jumps"):
        observer_of(sampled_problem(window=1)).step(
            observer_of(sampled_problem(window=1)).init(), Sample(0.0, jump=True)
        )


# --- laws -----------------------------------------------------------------------------------------


BOUNDS = {"disturbance": {"lower": [-0.02, 0], "upper": [0.02, 0.01]}}


@pytest.mark.parametrize("driven", [False, True])
@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("method", ["least_squares", "exact", "approximate", "corrected"])
def test_the_usual_step_is_the_general_one(
    method: str, bounded: bool, driven: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: dict[str, Any] = {} if method == "least_squares" else {"gains": {"L": L}}
    if method == "corrected":
        method, kept = "approximate", kept | {"half_sample_correction": True}
    flow = {"B": [[1], [0]]} if driven else {}
    problem = sampled_problem(
        period=0.25, window=2, method=method, flow=flow | (BOUNDS if bounded else {}),
        output={"noise_bound": [0.1]} if bounded else {}, **kept,
    )  # fmt: skip
    record = record_of(problem, until=60)
    y, u = record.block("y"), record.block("u") if driven else None
    observer = observer_of(problem)
    usual = observer.run_batch(record.t, y, u)
    monkeypatch.setattr(finite_time, "steady_step", lambda *_: None)
    general = observer.run_batch(record.t, y, u)
    assert usual.status == general.status
    # (14) integrates known inputs by other products, whose rounding M_T^-1 amplifies
    amplified = 10 if method == "approximate" and driven else 1
    assert np.abs(usual.x - general.x).max() < 1e-12 * amplified
    assert (
        (usual.lower is None) == (general.lower is None) == (method == "approximate" or not bounded)
    )
    if usual.lower is not None and general.lower is not None:
        full = np.isfinite(general.lower).all(axis=1)
        assert full.sum() == len(y) - 8
        assert np.abs(usual.lower[full] - general.lower[full]).max() < 1e-11
        assert np.abs(usual.upper[full] - general.upper[full]).max() < 1e-11


def test_lists_and_arrays_are_the_same_samples() -> None:
    problem = sampled_problem(period=0.25, window=2, flow={"B": [[1], [0]]})
    record = record_of(problem, until=20)
    y, u = record.block("y"), record.block("u")
    observer = observer_of(problem)
    from_arrays, from_lists = observer.init(), observer.init()
    for i, t in enumerate(record.t.tolist()):
        from_arrays, first = observer.step(from_arrays, Sample(t, y[i], u[i]))
        from_lists, second = observer.step(from_lists, Sample(t, y[i].tolist(), u[i].tolist()))
        assert np.array_equal(first.x, second.x)
        assert first.status == second.status


def test_one_state_may_be_continued_twice() -> None:
    """Windows of both futures share their past in memory, and nothing else."""
    observer = observer_of(sampled_problem(period=0.25, window=1))
    rng = np.random.default_rng(0)
    past, futures = rng.standard_normal((20, 1)), rng.standard_normal((2, 1500, 1))
    state = observer.init()
    for i, y in enumerate(past):
        state, _ = observer.step(state, Sample(0.25 * i, y))
    branches, estimates = [state, state], [[], []]  # type: ignore[var-annotated]
    for i in range(len(futures[0])):
        for j in range(2):
            branches[j], estimate = observer.step(
                branches[j], Sample(0.25 * (20 + i), futures[j][i])
            )
            estimates[j].append(estimate.x)
    for j in range(2):
        y = np.concatenate([past, futures[j]])
        whole = observer.run_batch(0.25 * np.arange(len(y)), y)
        assert np.array_equal(np.array(estimates[j]), whole.x[20:])


def test_units_of_time_do_not_matter() -> None:
    record = record_of(sampled_problem(period=0.25, window=2))
    first = observer_of(sampled_problem(period=0.25, window=2)).run_batch(
        record.t, record.block("y")
    )
    fast = 64.0 * np.array(ROTATION)
    scaled = observer_of(sampled_problem(fast, period=0.25 / 64, window=2 / 64))
    second = scaled.run_batch(record.t / 64, record.block("y"))
    assert np.abs(first.x - second.x).max() < 1e-12
    assert first.status == second.status


def test_a_step_leaves_its_state_alone() -> None:
    observer = observer_of(sampled_problem(period=0.25, window=1))
    state = observer.init()
    for i in range(8):
        state, _ = observer.step(state, Sample(0.25 * i, y=np.array([1.0])))
    before = [np.array(part, copy=True) for part in state if isinstance(part, np.ndarray)]
    _, first = observer.step(state, Sample(2.0, y=np.array([3.0])))
    _, second = observer.step(state, Sample(2.0, y=np.array([3.0])))
    assert np.array_equal(first.x, second.x)
    after = [part for part in state if isinstance(part, np.ndarray)]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


def test_messages_of_a_start() -> None:
    observer = observer_of(sampled_problem(window=1))
    with pytest.raises(InputError) as error:
        observer.start(0.0, [1.0])
    assert str(error.value) == "--initial must be the 2 finite numbers x1,x2; got 1 numbers."
    state, first = observer.step(observer.start(0.0, [1.0, 2.0]), Sample(0.0, y=[1.0]))
    assert first.x.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="time must increase"):
        observer.step(state, Sample(0.0, y=[1.0]))


# --- from the command line --------------------------------------------------------------------


def test_the_whole_way(tmp_path: Path) -> None:
    text = """
[flow]
A = [[0, 0.15], [-0.15, 0]]
B = [[1], [0]]
disturbance = { lower = [-0.01, 0], upper = [0.01, 0] }
[output]
C = [[0.3, 0]]
measured = "periodic"
period = 0.25
noise_bound = [0.01]
[observer]
kind = "finite_time"
window = 4
"""
    (tmp_path / "p.toml").write_text(text)
    for arguments in (
        ("design", "p.toml"), ("verify", "design.json", "--paranoid"),
        ("simulate", "design.json", "--until", 20), ("run", "design.json", "data.csv", "-o", "est.csv"),
        ("plot", "est.csv", "data.csv", "-o", "fig.png"),
    ):  # fmt: skip
        done = command(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    with (tmp_path / "est.csv").open() as file:
        estimates = list(csv.DictReader(file))
    assert list(estimates[0]) == [
        "t", "x1", "x2", "x1_lo", "x1_hi", "x2_lo", "x2_hi", "status",
    ]  # fmt: skip
    with (tmp_path / "data.csv").open() as file:
        for row, truth in zip(estimates, csv.DictReader(file), strict=True):
            for i in "12":
                low, high = float(row[f"x{i}_lo"]), float(row[f"x{i}_hi"])
                assert low <= float(truth[f"x{i}"]) <= high
    piped = command("run", "design.json", cwd=tmp_path, stdin=(tmp_path / "data.csv").read_text())
    assert piped.stdout == (tmp_path / "est.csv").read_text()
    bad = command("design", "p.toml", "--json", cwd=tmp_path)
    assert bad.returncode == 0
    (tmp_path / "bad.toml").write_text(text.replace("window = 4", "window = 4.1"))
    done = command("design", "bad.toml", "-o", "no.json", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "obsdesign: bad.toml: observer.window must be a multiple of output.period = 0.25; got 4.1, "
        "which is 16.4 periods. The nearest multiples are 4 and 4.25.\n"
    )
    assert not (tmp_path / "no.json").exists()


def test_verify_needs_no_solver_and_the_runtime_numpy_alone(tmp_path: Path) -> None:
    path = tmp_path / "d.json"
    obsdesign.design(sampled_problem(window=2, period=0.25, method="exact")).save(path)
    code = f"""
import obsdesign
outcome = obsdesign.verify(obsdesign.load_design({str(path)!r}))
assert outcome.verdict == "proved", outcome.claims
"""
    done = run_blocked(SOLVERS, code)
    assert done.returncode == 0, done.stderr
    code = f"""
from obsdesign.runtime import Sample, load
observer = load({str(path)!r})
state = observer.init()
for k in range(30):
    state, estimate = observer.step(state, Sample(k / 4, y=[1.0]))
assert estimate.status == "ok"
"""
    blocked = (*SOLVERS, "scipy", "flint", "matplotlib", "jsonschema", "click", "rich")
    done = run_blocked(blocked, code)
    assert done.returncode == 0, done.stderr


def test_bounds_of_an_unstable_plant_that_feedback_keeps_small() -> None:
    # the known response alone grows like e^t: it is moved onto the estimate once per window
    observer: Any = from_design(obsdesign.design(
        obsdesign.Problem(
            flow={"A": [[1.0]], "B": [[1.0]]},
            output={"C": [[1.0]], "measured": "periodic", "period": 0.1, "noise_bound": [0.01]},
            observer={"kind": "finite_time", "window": 1.0},
        )
    ))  # fmt: skip
    rng = np.random.default_rng(0)
    state, x, u = observer.init(), 0.5, 0.0
    for i in range(1000):
        y = x + rng.uniform(-0.01, 0.01)
        state, estimate = observer.step(state, Sample(0.1 * i, [y], u=[u]))
        if i > 20:
            assert estimate.status == "ok"
            assert estimate.lower[0] <= x <= estimate.upper[0]
            width = estimate.upper[0] - estimate.lower[0]
            assert width <= 2 * observer.gains.radius[0] * (1 + 1e-9)
        u = -2.0 * estimate.x[0]
        # the sample's u holds from its time on: the one given with the next sample comes later
        state = state._replace(held=held_input(observer.constants, np.array([u])))
        x = np.exp(0.1) * x + np.expm1(0.1) * u


def test_stamps_that_drift_within_rounding_of_each_step() -> None:
    # at 1.7e9 s the stamps' own rounding hides 1.5e-6 s per step, but not per window
    design = obsdesign.design(
        sampled_problem(period=1e-3, window=0.064, output={"noise_bound": [1e-3]})
    )
    observer: Any = from_design(design)
    for period, good in ((1e-3, True), (1.0015e-3, False)):
        t = 1.7e9 + period * np.arange(300)
        batch = observer.run_batch(t, np.zeros((300, 1)))
        assert (set(batch.status[70:]) == {"ok"}) is good
        assert ("ok" in batch.status) is good


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dwell", [None, [0.2, 2.0]])
def test_jumps_may_come_whenever_the_problem_says_so(
    method: str, dwell: list[float] | None, tmp_path: Path
) -> None:
    """A problem without a dwell time makes a design that runs; a jump only empties the window."""
    jump = {"G": [[1, 0], [0, 1]], **({} if dwell is None else {"dwell_time": dwell})}
    gains = {"gains": {"L": L}} if method == "exact" else {}
    problem = sampled_problem(
        [[0.0, 3.5], [-3.5, 0.0]], output={"noise_bound": [0.1]}, jump=jump, method=method, **gains
    )
    obsdesign.design(problem).save(tmp_path / "d.json")
    design = obsdesign.load_design(tmp_path / "d.json")
    assert obsdesign.verify(design).verdict == "proved"
    assert ("dwell_time" in design.gains) == (dwell is not None)
    observer = from_design(design)
    state = observer.init(t=0.0)
    for k in range(1, 40):
        state, estimate = observer.step(state, Sample(0.05 * k, y=[0.0], jump=k in (1, 3)))
    assert estimate.status == "ok"


def test_errors_inside_of_a_period_count_at_its_end() -> None:
    """What a flow adds by rounding grows until the sample that ends the period."""
    problem = sampled_problem(
        [[3.0, 0.0], [0.0, 2.0]], [[1.0, 1.0]], 0.5, window=2, method="least_squares",
        flow={"B": [[1.0], [1.0]]}, output={"noise_bound": [0.1]},
    )  # fmt: skip
    observer = observer_of(problem)
    state, _ = observer.step(observer.init(), Sample(0.0, y=[1.0], u=[2.0]))
    constants, half = observer.constants, 0.25
    through = flowed(constants, state, half, 0.0).bounds.w_error
    carried = flowed(constants, state, half, half).bounds.w_error
    assert (through > 0).all()
    assert (carried >= np.exp(np.array([3.0, 2.0]) * half) * through).all()
    assert (carried <= 1.01 * np.exp(np.array([3.0, 2.0]) * half) * through).all()


def test_a_jump_without_its_sample_starts_an_empty_window() -> None:
    problem = sampled_problem(
        period=0.25, window=2, output={"jump_measurement": "after"},
        jump={"G": [[1, 0], [0.5, -1]], "dwell_time": [5, 5]},
    )  # fmt: skip
    record = record_of(problem, until=8)
    jump, y = record.columns["jump"], record.block("y").copy()
    (row,) = np.flatnonzero(jump)
    y[row] = np.nan
    batch = observer_of(problem).run_batch(record.t, y, jump=jump)
    assert set(batch.status[row + 1 : row + 9]) == {"window not full"}
    assert batch.status[row + 9] == "ok"
