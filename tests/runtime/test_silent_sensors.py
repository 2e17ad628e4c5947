"""Sensors that send on change: bounds between their samples, in both kinds that know them."""

from __future__ import annotations

import copy
from contextlib import nullcontext as nothing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.execution import execute
from obsdesign.data.simulation import Simulation, simulate
from obsdesign.design_file import from_dict
from obsdesign.document import Design, digest
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate, Sample, rows_of
from obsdesign.runtime.stored_state import Progress, progress_from_text, state_text
from tests.systems.designs import designed

KINDS = ("interval", "set_membership")
_START = {"lower": np.full(2, -2.0), "upper": np.full(2, 2.0)}
# a spring that is kicked; two outputs of one sensor, and a sensor that sees what a kick leaves
SPRING: dict[str, Any] = {
    "flow": {
        "A": [[0, 1], [-1, -0.3]], "disturbance": {"lower": [0, -0.2], "upper": [0, 0.2]},
    },
    "event": [{"name": "kick", "G": [[1, 0], [0.3, 0.8]], "every": [3, 7]}],
    "sensor": [
        {
            "name": "place", "C": [[1, 0], [1, 0.2]], "noise_bound": [[-0.01, 0.03], [-0.02, 0.02]],
            "every": [0, 4], "sends_on_change": [0.1, 0.2],
        },
        {
            "name": "speed", "C": [[0, 1]], "noise_bound": 0.02, "every": [0, 5],
            "sends_on_change": 0.15, "sees": "after",
        },
    ],
}  # fmt: skip


def design_of(kind: str, body: dict[str, Any] = SPRING) -> Design:
    return designed({**body, "observer": {"kind": kind}}, allow_undecided=True)


def without_change(body: dict[str, Any]) -> dict[str, Any]:
    """The same plant with sensors that do not send on change."""
    plain = copy.deepcopy(body)
    for sensor in plain["sensor"]:
        del sensor["sends_on_change"]
    return plain


def without_event() -> dict[str, Any]:
    """A place that moves on, and the sensor of it alone."""
    body = copy.deepcopy(SPRING)
    del body["event"], body["sensor"][1]
    body["flow"]["A"] = [[0, 1], [0, 0]]
    return body


def record(seed: int, body: dict[str, Any] = SPRING, disturbance: str = "sine") -> Simulation:
    plant, rng = Problem.from_dict({**body, "observer": {"kind": "interval"}}).plant, seed
    return simulate(
        plant, until=30.0, step=0.1, disturbance=disturbance, rng=np.random.default_rng(rng)
    )


def samples_of(run: Simulation) -> list[Sample]:
    return list(rows_of(run.t, run.block("y"), jump=run.happened))


def estimates(design: Design, rows: list[Sample]) -> list[Estimate]:
    observer = from_design(design)
    return list(observer.run(observer.init(rows[0].t, **_START), rows))


def widths(listed: list[Estimate]) -> Matrix:
    return np.array([x.upper - x.lower for x in listed])  # type: ignore[operator]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("disturbance", ["extreme", "sine"])
def test_the_state_never_leaves(kind: str, disturbance: str) -> None:
    design = design_of(kind)
    for seed, late in enumerate((0.0, 1.7e9)):
        run = record(seed, disturbance=disturbance)
        rows = [row._replace(t=row.t + late) for row in samples_of(run)]
        for one, x in zip(estimates(design, rows), run.block("x"), strict=True):
            assert one.status == "ok"
            assert (one.lower <= x).all()
            assert (x <= one.upper).all()


def test_silence_narrows_an_unknown_input_too() -> None:
    body = copy.deepcopy(SPRING)
    body["flow"] |= {"D": [[0], [1]], "d_bounds": {"lower": [0], "upper": [2], "rate": [0.1]}}
    run, listed = record(1, body), []
    for plain in (False, True):
        design = design_of("set_membership", without_change(body) if plain else body)
        listed.append(estimates(design, samples_of(run)))
        for one, x in zip(listed[-1], run.block("x"), strict=True):
            assert one.status == "ok"
            assert (one.lower <= x).all()
            assert (x <= one.upper).all()
    assert widths(listed[0]).mean() < 0.9 * widths(listed[1]).mean()
    own, plain_widths = (np.array([np.diff(x.d_bounds, axis=0) for x in each]) for each in listed)
    assert own.mean() < plain_widths.mean()


@pytest.mark.parametrize("kind", KINDS)
def test_silence_narrows(kind: str) -> None:
    rows = samples_of(record(1))
    narrowed = widths(estimates(design_of(kind), rows))
    plain = widths(estimates(design_of(kind, without_change(SPRING)), rows))
    if kind == "interval":  # the search for multipliers promises no order
        assert (narrowed <= plain * (1 + 1e-9)).all()
    # rows without a sample use up nothing of the window, which narrows the plain bounds too
    most = {"interval": 0.8, "set_membership": 0.85}[kind]
    assert narrowed.mean() < most * plain.mean()


@pytest.mark.parametrize("kind", KINDS)
def test_a_lost_sample_contradicts_until_the_sensor_is_late(kind: str) -> None:
    """The twin: what its silence would say is not true, and not used any more once it is late."""
    body = without_event()
    t = np.arange(0.0, 6.05, 0.1)
    lost = [Sample(float(now), [now, now + 0.2] if now == 0.0 else None) for now in t]
    bounds = {"lower": np.array([-0.1, 0.9]), "upper": np.array([0.1, 1.1])}
    observer = from_design(design_of(kind, body))
    listed = list(observer.run(observer.init(0.0, **bounds), lost))
    first = next(k for k, one in enumerate(listed) if one.status != "ok")
    assert 0.1 < t[first] < 0.5  # the position has left its strip by then
    assert all("void" in one.status for one in listed[first + 1 :])
    silent = list(observer.run(observer.init(0.0, **bounds), [lost[0], Sample(4.5)]))
    assert "time 4.5 since the last sample exceeds 4" in silent[-1].status
    assert silent[-1].lower[0] <= 4.5 <= silent[-1].upper[0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sample_with_one_output_ends_what_the_silence_of_the_others_says(kind: str) -> None:
    rows = [Sample(0.0, [0.0, 0.0, np.nan]), Sample(1.0, [0.9, np.nan, np.nan]), Sample(1.1)]
    body = copy.deepcopy(SPRING)
    listed = estimates(design_of(kind, body), rows)
    plain = estimates(design_of(kind, without_change(body)), rows)
    assert np.allclose(widths(listed[:2]), widths(plain[:2]), rtol=1e-6)
    assert listed[2].upper[0] <= 0.9 + 0.01 + 0.1 + 1e-9  # type: ignore[index]


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_in_parts_is_the_record(kind: str) -> None:
    design, rows = design_of(kind), samples_of(record(3))
    observer = from_design(design)
    whole = estimates(design, rows)
    state = observer.init(rows[0].t, **_START)
    for row in rows[:17]:
        state, _ = observer.step(state, row)
    text = state_text(design, Progress(state))
    resumed = progress_from_text(text, design, observer, "state.json").state
    for row, one in zip(rows[17:60], whole[17:60], strict=True):
        resumed, two = observer.step(resumed, row)
        assert np.array_equal(one.lower, two.lower)
        assert np.array_equal(one.upper, two.upper)


@pytest.mark.parametrize("kind", KINDS)
def test_a_smaller_change_in_a_design_is_refuted(kind: str) -> None:
    document = design_of(kind).to_dict()
    document["gains"]["sensors"][1]["sends_on_change"] = [0.01]
    outcome = obsdesign.verify(from_dict({**document, "digest": digest(document)}))
    assert outcome.verdict == "refuted"


def test_a_simulated_sensor_sends_what_has_changed_and_what_is_due() -> None:
    body = copy.deepcopy(SPRING)
    body["sensor"] = body["sensor"][:1]
    body["sensor"][0]["noise_bound"] = 0.0
    run = record(0, body)
    sent, clean = run.block("y"), run.block("x") @ np.array(body["sensor"][0]["C"]).T
    happened = run.happened
    assert happened is not None
    last, at, overdue = sent[0], 0.0, 0
    for k in range(1, len(sent)):
        assert run.t[k] - at <= 4 + 1e-9
        if np.isfinite(sent[k]).all():
            overdue += bool((np.abs(sent[k] - last) < [0.1, 0.2]).all())
            last, at = sent[k], run.t[k]
        elif not happened[k].any():
            assert (np.abs(clean[k] - last) < [0.1, 0.2]).all()
    assert 0 < overdue < np.isfinite(sent[:, 0]).sum() / 2 < len(sent) / 4


@pytest.mark.parametrize("kind", KINDS)
def test_the_guarantee_says_that_no_sample_may_be_lost(kind: str) -> None:
    with_change, plain = (design_of(kind, x).to_dict() for x in (SPRING, without_change(SPRING)))
    word = "but for place, speed (sends_on_change), of which no sample may be lost"
    assert word in with_change["guarantees"][0]["statement"]
    assert word not in plain["guarantees"][0]["statement"]


def test_no_row_may_be_left_out(tmp_path: Path) -> None:
    """Neither one that is malformed nor one that comes too late; with plain sensors both may."""
    lines = [
        "t,kick,place1,place2,speed,received",
        "0,,0,0,0,0",
        "1,,oh,,,1",
        "1.5,,,,.1,3",
        "2,,,,,2",
    ]
    data = tmp_path / "d.csv"
    for body in (SPRING, without_change(SPRING)):
        design, silence_counts = str(tmp_path / "design.json"), body is SPRING
        design_of("interval", body).save(design)
        for rows, skip in ((lines[:3], True), ([*lines[:2], *lines[3:]], False)):
            data.write_text("\n".join(rows) + "\n")
            expected = (
                pytest.raises(InputError, match="counts as silence")
                if silence_counts
                else nothing()
            )
            with expected:
                execute(design, str(data), f"{data}.e", [-2, 2, -2, 2], None, skip_bad=skip)


@pytest.mark.parametrize("kind", KINDS)
def test_silence_at_a_time_is_known_once_all_rows_of_it_are_there(kind: str) -> None:
    """After an event a sensor may send in a later row of the same time."""
    body: dict[str, Any] = {
        "flow": {"A": [[-0.1]]},
        "event": [{"name": "kick", "disturbance": {"lower": [0], "upper": [4]}}],
        "sensor": [
            {"name": "level", "C": [[1]], "noise_bound": 0.01, "every": [0, 9],
             "sends_on_change": 0.5},
            {"name": "other", "C": [[1]], "noise_bound": 2.0, "every": [0, 9]},
        ],
    }  # fmt: skip
    rows = [
        Sample(0.0, [0.0, np.nan]), Sample(2.0, events=(0,), jump=True), Sample(2.0, [np.nan, 3.0]),
        Sample(2.0, [3.0, np.nan]), Sample(3.0),
    ]  # fmt: skip
    observer = from_design(design_of(kind, body))
    start = {"lower": np.array([-0.1]), "upper": np.array([0.1])}
    listed = list(observer.run(observer.init(0.0, **start), rows))
    assert [one.status for one in listed] == ["ok"] * 5
    assert all(
        one.lower[0] <= x <= one.upper[0]
        for one, x in zip(listed[1:], (3.0, 3.0, 3.0, 3.0 * np.exp(-0.1)), strict=True)
    )
    assert listed[4].upper[0] - listed[4].lower[0] < 1.1  # the next time uses its silence


@pytest.mark.parametrize("kind", KINDS)
def test_new_bounds_end_what_a_silence_said(kind: str) -> None:
    body = without_event()
    observer = from_design(design_of(kind, body))
    start = {"lower": np.array([-0.1, 0.9]), "upper": np.array([0.1, 1.1])}
    state = observer.init(0.0, **start)
    for row in (Sample(0.0, [0.0, 0.2]), Sample(1.0), Sample(2.0)):
        state, one = observer.step(state, row)
    assert one.status != "ok"
    state = observer.reset(state, lower=np.array([1.9, 0.9]), upper=np.array([2.1, 1.1]))
    _, one = observer.step(state, Sample(2.1))
    assert one.status == "ok"
    assert one.lower[0] <= 2.1 <= one.upper[0]
