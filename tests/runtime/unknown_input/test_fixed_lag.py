"""The differentiator with a delay: what is decided when, and what smoothing gains."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.data.simulation import simulate
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of
from tests.systems.designs import designed

EXAMPLES = Path(__file__).parents[3] / "examples"
PERIOD, SIGMA = 0.1, 0.01


def observer(lag: int | None = 4, differentiator: str | None = "fixed_lag", **output: Any) -> Any:
    body = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").to_dict()
    body["output"] |= {"noise_std": [SIGMA, SIGMA], **output}
    body["observer"].pop("differentiator", None)
    if differentiator is not None:
        body["observer"]["differentiator"] = differentiator
        if lag is not None and differentiator == "fixed_lag":
            body["observer"]["lag"] = lag
    return from_design(designed(body))


def record(
    rows: int = 60, seed: int = 0, disturbance: str = "sine"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(t, noisy y, true d of the interval before each row)."""
    plant = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").plant
    rng = np.random.default_rng(seed)
    made = simulate(plant, until=PERIOD * (rows - 1), step=PERIOD, disturbance=disturbance, rng=rng)
    y = made.block("y") + SIGMA * rng.standard_normal(made.block("y").shape)
    return made.t, y, made.block("d")


def same(rows: Any, others: Any) -> None:
    assert [row.t for row in rows] == [row.t for row in others]
    assert [row.status for row in rows] == [row.status for row in others]
    for name in ("x", "d"):
        np.testing.assert_array_equal(
            [getattr(row, name) for row in rows], [getattr(row, name) for row in others]
        )


def test_rows_are_decided_when_the_lag_has_passed_and_not_before() -> None:
    running, lag = observer(lag=5), 5
    t, y, _ = record(30)
    state = running.init(float(t[0]))
    for k, sample in enumerate(rows_of(t, y)):
        state, prediction = running.step(state, sample)
        assert prediction.t == t[k]
        assert [row.t for row in state.decided] == ([t[k - lag]] if k >= lag else [])
    assert [row.t for row in running.finish(state)] == list(t[-lag:])


def test_what_follows_after_the_lag_changes_nothing() -> None:
    running = observer(lag=5)
    t, y, _ = record(40)
    other = y.copy()
    other[30:] += 1.0
    first, second = (
        list(running.run(running.init(0.0), rows_of(t, values))) for values in (y, other)
    )
    same(first[:25], second[:25])
    assert not np.array_equal(first[25].d, second[25].d)  # the twin: one row later it does


def test_a_lag_as_long_as_the_record_is_the_smoother_of_the_whole_record() -> None:
    t, y, _ = record(50)
    whole = observer(differentiator="batch").run_batch(t, y)
    lagged = observer(lag=len(t)).run_batch(t, y)
    np.testing.assert_allclose(lagged.x, whole.x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lagged.d, whole.d, rtol=0, atol=1e-9)


def test_blocks_batches_and_streams_are_one() -> None:
    running = observer()
    t, y, _ = record()
    y[[7, 8, 30]] = np.nan
    samples = list(rows_of(t, y))
    stream = list(running.run(running.init(float(t[0])), samples))
    state, blocks = running.init(float(t[0])), []
    for part in (samples[:1], samples[1:20], samples[20:]):
        state = running.block(state, part)
        blocks += state.decided
    same(stream, [*blocks, *running.finish(state)])
    batch = running.run_batch(t, y)
    np.testing.assert_array_equal(batch.d, [row.d for row in stream])
    assert [row.t for row in stream] == list(t)
    missing = [k for k, row in enumerate(stream) if row.status == "missing sample"]
    assert missing == [7, 8, 30]


def test_a_prediction_is_the_cell_at_the_present() -> None:
    lagged, cell = observer(), observer(differentiator="cell")
    t, y, _ = record(20)
    state, other = lagged.init(0.0), cell.init(0.0)
    for sample in rows_of(t, y):
        state, streamed = lagged.step(state, sample)
        other, expected = cell.step(other, sample)
        same([streamed], [expected])


@pytest.mark.parametrize(("disturbance", "gain"), [("zero", 10.0), ("sine", 1.8)])
def test_smoothing_takes_noise_away(disturbance: str, gain: float) -> None:
    """A longer lag takes more of it where d rests; where d moves within a lag, less is to gain."""
    t, y, d = record(300, disturbance=disturbance)
    late = slice(100, -20)

    def error(running: Any) -> float:
        estimate = running.run_batch(t, y).d
        return float(np.sqrt(np.mean((estimate[1:] - d[:-1])[late] ** 2)))

    cell = error(observer(differentiator="cell"))
    errors = [error(observer(lag=lag)) for lag in (1, 3, 10)]
    assert errors[-1] < cell / gain
    if disturbance == "zero":
        assert all(longer < shorter / 1.5 for shorter, longer in pairwise([cell, *errors]))


def test_noise_chooses_it_and_its_absence_does_not() -> None:
    assert observer(differentiator=None).gains.lag == 10
    assert observer(differentiator=None, noise_std=[SIGMA, 0.0]).gains.differentiator == "cell"


def test_the_choice_is_announced_with_its_delay() -> None:
    body = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").to_dict()
    body["observer"].pop("differentiator", None)
    assert not obsdesign.investigate(obsdesign.Problem.from_dict(body)).result.get("remarks")
    body["output"]["noise_std"] = [SIGMA, SIGMA]
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    remarks = outcome.result["remarks"]
    assert any("10 samples late (1)" in text and "0.14" in text for text in remarks)


def test_a_design_of_before_the_choice_still_verifies() -> None:
    """With noise and no differentiator in the problem, older designs hold `cell`."""
    body = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").to_dict()
    body["output"]["noise_std"] = [SIGMA, SIGMA]
    body["observer"]["differentiator"] = "cell"
    made = designed(body).to_dict()
    del made["problem"]["observer"]["differentiator"]
    assert verdict(made) == "proved"
    made["gains"]["differentiator"] = "slow"
    assert verdict(made) == "refuted"


def verdict(body: dict[str, Any]) -> str:
    from obsdesign.design_file import from_dict
    from obsdesign.document import digest

    return obsdesign.verify(from_dict({**body, "digest": digest(body)})).verdict


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lag": 5}, "observer.lag is the delay of differentiator = 'fixed_lag'; got 'cell'. Drop one."),
        ({"differentiator": "fixed_lag"}, "output.noise_std is required by differentiator = 'fixed_lag', positive for every output; got [0.0, 0.0]."),
        ({"differentiator": "fixed_lag", "lag": 0}, "observer.lag must be a whole number of samples, from 1 to 1000; got 0."),
    ],
)  # fmt: skip
def test_refusals(options: dict[str, Any], message: str) -> None:
    body = obsdesign.load_problem(EXAMPLES / "ahn_1.toml").to_dict()
    body["observer"].pop("differentiator", None)
    body["observer"] |= options
    with pytest.raises(obsdesign.InputError) as caught:
        designed(body)
    assert str(caught.value) == message


@pytest.mark.parametrize("lag", [0, 2.0, True, None])
def test_a_lag_that_counts_nothing_does_not_run(lag: Any) -> None:
    running = observer()
    with pytest.raises(ValueError, match=r"gains\.lag must be a whole number >= 1"):
        type(running).from_gains({**running.gains.to_document(), "lag": lag})


def test_a_caller_may_reuse_its_arrays() -> None:
    running = observer()
    t, y, _ = record(20)
    expected = list(running.run(running.init(0.0), rows_of(t, y)))
    buffer, rows = np.empty(2), []
    state = running.init(0.0)
    for time, values in zip(t, y, strict=True):
        buffer[:] = values
        state, _ = running.step(state, Sample(float(time), buffer))
        rows += state.decided
    same([*rows, *running.finish(state)], expected)
