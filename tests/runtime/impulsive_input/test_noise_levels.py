"""Noise of any size: units change no impulse, rounding is in deviations, noise makes no impulse."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.impulsive_input.event import FAINT
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, observer_of, record, rows_from

TWO: dict[str, Any] = {
    "flow": {"A": [[-0.5, 0.0], [0.5, -0.3]]},
    "jump": {"H": [[1.0], [0.0]], "dwell_time": [8, "inf"]},
    "output": {"C": [[0.0, 1.0], [1.0, 0.5]], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "impulsive_input", "operator": "integral"},
}
THREE: dict[str, Any] = {
    "flow": {"A": [[-0.4, 0.0, 0.0], [0.4, -0.5, 0.0], [0.0, 0.5, -0.9]]},
    "jump": {"H": [[1.0], [0.0], [0.0]], "dwell_time": [10, "inf"]},
    "output": {"C": [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "measured": "periodic", "period": 0.1},
    "observer": {
        "kind": "impulsive_input", "operator": "integral",
        "exponents": [-0.4125, -0.6, -0.8, -1.0, -1.2, -1.4],
    },
}  # fmt: skip
TRAIN = ((10.03, 1.0), (19.73, 0.7), (29.43, -1.4), (39.13, 0.9))
LONGER = tuple((12.03 + 11.7313 * k, (1.0, 0.7, -1.4, 0.9, 1.2)[k % 5]) for k in range(8))
TIMES, LONG_TIMES = np.round(0.1 * np.arange(500), 10), np.round(0.1 * np.arange(1100), 10)
CV, STD = 0.02, 0.002
NOISES = ("noise_cv", "noise_std", "both", "none")
OPTIONS: dict[str, dict[str, Any]] = {
    "gls": {"exponents": [-0.4125, -0.65, -0.9, -1.15]},
    "plain": {"exponents": [-0.4125, -0.65, -0.9, -1.15], "weighting": "plain"},
    "samples": {"operator": "samples"},
}


@cache
def noisy(noise: str, p: int) -> np.ndarray:
    """Outputs of a record that begins at rest."""
    x = record(np.array(TWO["flow"]["A"]), TWO["jump"]["H"], TRAIN, TIMES, np.zeros(2))
    y, rng = x @ np.array(TWO["output"]["C"])[:p].T, np.random.default_rng(3)
    y = y * (1 + (noise in ("noise_cv", "both")) * CV * rng.standard_normal(y.shape))
    return np.asarray(y + (noise in ("noise_std", "both")) * STD * rng.standard_normal(y.shape))


def estimates(noise: str, units: tuple[float, ...], **options: Any) -> list[Any]:
    body, scale, p = copy.deepcopy(TWO), np.array(units), len(units)
    C = np.array(body["output"]["C"])[:p]
    body["output"]["C"] = (scale[:, None] * C).tolist()
    if noise in ("noise_cv", "both"):
        body["output"]["noise_cv"] = [CV] * p
    if noise in ("noise_std", "both"):
        body["output"]["noise_std"] = (STD * scale).tolist()
    body["observer"] |= options
    observer = from_design(designed(body))
    return rows_from(observer, TIMES, noisy(noise, p) * scale, x=np.zeros(2))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("kind", OPTIONS)
def test_units_of_outputs_change_no_impulse(noise: str, kind: str) -> None:
    if noise == "none" and kind != "plain":
        return
    for reference, scaled in (
        ((1.0,), ((2.0**-30,), (1e9,))),
        ((1.0, 1.0), ((1e-6, 1e3),)),
    ):
        first = estimates(noise, reference, **OPTIONS[kind])
        events = events_of(first)
        assert len(events) == len(TRAIN)
        for units in scaled:
            rows = estimates(noise, units, **OPTIONS[kind])
            assert [row.status for row in rows] == [row.status for row in first]
            for event, same in zip(events, events_of(rows), strict=True):
                assert same.status == event.status == "ok"
                assert same.t == pytest.approx(event.t, abs=1e-8)
                assert same.weights == pytest.approx(event.weights, rel=1e-8)
                if event.t_std is not None:
                    assert same.t_std == pytest.approx(event.t_std, rel=1e-6)
            if len(units) == 1 and np.log2(units[0]) % 1 == 0:  # bit for bit
                assert all((a.x == b.x).all() for a, b in zip(rows, first, strict=True))


@pytest.mark.parametrize("kind", OPTIONS)
def test_impulses_after_rest_are_right(kind: str) -> None:
    events = events_of(estimates("noise_cv", (1e-6,), **OPTIONS[kind]))
    for event, (moment, weight) in zip(events, TRAIN, strict=True):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]


def events_in_noise(std: tuple[float, ...], seed: int = 0, **options: Any) -> list[Any]:
    body = copy.deepcopy(THREE)
    body["output"] |= {"C": body["output"]["C"][-len(std) :], "noise_std": list(std)}
    body["observer"] |= options
    if options.get("operator") == "samples":
        del body["observer"]["exponents"]
    x = record(np.array(body["flow"]["A"]), body["jump"]["H"], LONGER, LONG_TIMES, np.zeros(3))
    y = x @ np.array(body["output"]["C"]).T
    y = y + np.array(std) * np.random.default_rng(seed).standard_normal(y.shape)
    observer = from_design(designed(body))
    return events_of(rows_from(observer, LONG_TIMES, y, x=np.zeros(3)))


def scores(events: list[Any]) -> np.ndarray:
    """Errors of times and weights over their deviations, (events, 2)."""
    return np.array(
        [
            ((e.t - moment) / e.t_std, (e.weights[0] - weight) / e.weights_std[0])
            for e, (moment, weight) in zip(events, LONGER, strict=True)
        ]
    )


@pytest.mark.parametrize("options", [{}, {"weighting": "plain"}, {"operator": "samples"}], ids=str)
@pytest.mark.parametrize("std", [1e-5, 1e-8, 1e-11, 1e-14])
def test_deviations_hold_what_rounding_adds(options: dict[str, Any], std: float) -> None:
    events = events_in_noise((std,), **options)
    assert all(event.status == "ok" for event in events)
    z = scores(events)
    assert (np.abs(z) < 4).all()
    assert np.sqrt((z**2).mean()) < 1.5
    if std == 1e-5:  # the twin: noise above rounding is all there is
        assert np.sqrt((z**2).mean()) > 0.5
    assert max(event.t_std for event in events) < 1e3 * max(std, 1e-8)


K = [[0.2, 0.0], [1.0, 0.0], [0.5, 1.0]]


@pytest.mark.parametrize("seed", range(3))
def test_leftovers_of_the_plain_norm_are_no_impulses(seed: int) -> None:
    """A far better second sensor shows what the plain norm left of the state."""
    options = {"weighting": "plain", "gains": {"K": K}}
    events = events_in_noise((0.004, 1e-5), seed, **options)
    assert (np.abs(scores(events)) < 5).all()  # as many as there are: none of them false


@pytest.mark.parametrize("std", [(1e-8, 0.1), (0.1, 1e-8), (1e-10, 1e-3)])
def test_a_nearly_exact_sensor_makes_no_impulse(std: tuple[float, float]) -> None:
    assert (np.abs(scores(events_in_noise(std))) < 4).all()


def test_a_fit_below_the_noise_says_so() -> None:
    """The better sensor shows impulses that the plain norm cannot weigh: events, but none `ok`."""
    events = events_in_noise((3.0, 1e-5), weighting="plain", gains={"K": K})
    assert events
    assert all(FAINT in event.doubts for event in events)


def test_units_of_states_move_no_onset_of_samples() -> None:
    A, H, C = (np.array(THREE[a][b]) for a, b in (("flow", "A"), ("jump", "H"), ("output", "C")))
    times = np.round(0.25 * np.arange(300), 10)
    y = record(A, H, LONGER[:5], times, [0.2, 0.1, 0.3]) @ C.T
    y = y + 0.01 * np.random.default_rng(1).standard_normal(y.shape)
    rows = []
    for units in np.array([[1.0, 1, 1], [2.0**20, 1, 2.0**-20], [1e6, 1, 1e-6]]):
        body = copy.deepcopy(THREE)
        body["flow"]["A"] = (A * units[:, None] / units).tolist()
        body["jump"]["H"] = (H * units[:, None]).tolist()
        body["output"] |= {"C": (C / units).tolist(), "noise_std": [0.01, 0.01], "period": 0.25}
        body["observer"] = {"kind": "impulsive_input", "operator": "samples"}
        observer = from_design(designed(body))
        rows.append(rows_from(observer, times, y, x=np.zeros(3)))
        for row, first in zip(rows[-1], rows[0], strict=True):
            assert row.status == first.status
            np.testing.assert_allclose(row.x / units, first.x, atol=1e-11)
    assert [len(events_of(each)) for each in rows] == [5, 5, 5]
    for other in rows[1:]:
        for event, same in zip(events_of(rows[0]), events_of(other), strict=True):
            assert same.t == pytest.approx(event.t, abs=1e-11)


@pytest.mark.parametrize("noise", ["noise_cv", "noise_std", "none"])
@pytest.mark.parametrize("kind", ["gls", "plain"])
def test_a_record_row_by_row_has_the_impulses_of_the_whole(noise: str, kind: str) -> None:
    if (noise, kind) == ("none", "gls"):
        return
    observer = observed(noise, kind)
    y, state, rows = noisy(noise, 1), observer.init(0.0, x=np.zeros(2)), []
    for t, value in zip(TIMES.tolist(), y, strict=True):
        state, _ = observer.step(state, Sample(t, y=value))
        rows += state.decided
    rows += observer.finish(state)
    whole = rows_from(observer, TIMES, y, x=np.zeros(2))
    assert [row.status for row in rows] == [row.status for row in whole]
    for event, same in zip(events_of(rows), events_of(whole), strict=True):
        assert same.t == pytest.approx(event.t, abs=1e-10)
        assert same.weights == pytest.approx(event.weights, abs=1e-10)


@cache
def observed(noise: str, kind: str) -> Any:
    body = copy.deepcopy(TWO)
    body["output"] |= {"C": body["output"]["C"][:1]}
    if noise != "none":
        body["output"][noise] = [CV if noise == "noise_cv" else STD]
    body["observer"] |= OPTIONS[kind]
    return from_design(designed(body))


MOTOR = np.array([[0.0, 1.0, 0.0], [0.0, -0.7434, 0.0], [0.0, 2.5814, -2.5814]])


@pytest.mark.parametrize("share", [0.0, 0.11], ids=["every row", "rows missing"])
@pytest.mark.parametrize("seed", [1, 11])
def test_an_impulse_just_behind_a_window_is_no_older_one(share: float, seed: int) -> None:
    """A tacho that came to rest shows it at once; so small is its noise that others fit as well."""
    body = {
        "flow": {"A": MOTOR.tolist()},
        "jump": {"H": [[0], [1], [0]], "dwell_time": [4.745, "inf"]},
        "output": {"C": [[1, 0, 0], [0, 0, 1]], "measured": "periodic", "period": 0.0527,
                   "noise_cv": [0.0069, 0.0018]},
        "observer": {"kind": "impulsive_input", "operator": "integral"},
    }  # fmt: skip
    train, t = [(10.183296, -2.0), (16.413136, -1.5)], 0.0527 * np.arange(420)
    rng = np.random.default_rng(seed)
    y = record(MOTOR, [[0.0], [1.0], [0.0]], train, t, [-0.2615, -0.0449, -0.0620])[:, [0, 2]]
    y = y * (1 + np.array([0.0069, 0.0018]) * rng.standard_normal(y.shape))
    y[rng.random(len(t)) < share] = np.nan
    y[[192, 195, 196] if share else []] = np.nan  # around the first impulse
    events = events_of(rows_from(observer_of(body), t, y))
    assert [event.status for event in events] == ["ok", "ok"]
    for event, (moment, weight) in zip(events, train, strict=True):
        assert abs(event.t - moment) < 4 * event.t_std
        assert abs(event.weights[0] - weight) < 4 * event.weights_std[0]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_impulse_is_lost_where_its_peak_is_beside_the_margin(seed: int) -> None:
    """Noise makes its age at the peak less than the margin, and no later window is offered."""
    A, H, C = np.array([[-0.3, -0.716], [0.495, -0.4]]), [[1.0], [0.0]], np.array([[0.0, 0.9]])
    body = {
        "flow": {"A": A.tolist()}, "jump": {"H": H, "dwell_time": [7.25, "inf"]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.047,
                   "noise_std": [0.0064], "noise_cv": [0.043]},
        "observer": {"kind": "impulsive_input", "operator": "integral", "weighting": "plain"},
    }  # fmt: skip
    rng, t = np.random.default_rng(seed), 0.047 * np.arange(2600)
    train = [(15.3 + 9.83 * k, (2.3, -0.45, 2.9, -0.47)[k % 4]) for k in range(10)]
    y = record(A, H, train, t, np.zeros(2)) @ C.T
    y = y + np.hypot(0.0064, 0.043 * np.abs(y)) * rng.standard_normal(y.shape)
    events = events_of(rows_from(observer_of(body), t, y))
    assert len(events) == len(train)
    for event, (moment, _) in zip(events, train, strict=True):
        assert abs(event.t - moment) < 5 * event.t_std
