"""Observers for impulsive inputs: laws of design and run time, odd records, refusals."""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.impulsive_input.integral.cells import CellFits
from obsdesign.runtime.impulsive_input.integral.rows import Rows
from tests.long.random_impulses import HIDDEN, outcome
from tests.systems.designs import designed
from tests.systems.impulsive_input import CHAIN, events_of, observer_of, record, rows_from

TRAIN = ((12.34567, 4.0), (45.5, -5.0), (80.0, 7.0))


def chain(**changes: Any) -> dict[str, Any]:
    body = copy.deepcopy(CHAIN)
    for path, value in changes.items():
        block, key = path.split("__")
        body[block][key] = value
    return body


def chain_record(h: float = 0.05, until: float = 110.0) -> tuple[Any, Any]:
    t = np.round(h * np.arange(round(until / h) + 1), 10)
    body = chain()
    return t, record(np.array(body["flow"]["A"]), body["jump"]["H"], TRAIN, t, [4, 20, 60])


def assert_found(rows: Any, train: Any, tolerance: float = 1e-6) -> None:
    events = events_of(rows)
    assert len(events) == len(train)
    for event, (moment, weight) in zip(events, train, strict=True):
        assert event.t == pytest.approx(moment, abs=tolerance)
        np.testing.assert_allclose(event.weights, np.atleast_1d(weight), atol=tolerance)


# --- run time ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("noisy", [False, True])
def test_a_stream_a_batch_and_blocks_agree(noisy: bool) -> None:
    t, x = chain_record(until=70.0)
    std = 0.3 if noisy else 0.0
    y = x[:, 2:] + std * np.random.default_rng(3).standard_normal((len(t), 1))
    y[np.random.default_rng(4).random(len(t)) < 0.1] = np.nan
    y[[0, 1, 700, 701, 702, -1]] = np.nan
    observer = observer_of(chain(output__noise_std=[std]))
    assert observer.gains.weighting == ("gls" if noisy else "plain")
    batch = observer.run_batch(t, y, x=[4, 20, 60])
    rows = list(observer.run(observer.init(0.0, x=[4, 20, 60]), rows_of(t, y)))
    np.testing.assert_array_equal([row.t for row in rows], t)
    np.testing.assert_allclose([row.x for row in rows], batch.x, rtol=1e-5, atol=1e-5)
    assert tuple(row.status for row in rows) == batch.status
    assert len(events_of(rows)) == len(events_of(rows_from(observer, t, y, x=[4, 20, 60]))) == 2
    missing = np.isnan(y[:, 0])
    reported = np.array(["missing sample" in row.status for row in rows])
    np.testing.assert_array_equal(reported, missing)


def test_step_predicts_and_settles_rows_later() -> None:
    observer = observer_of(chain())
    t, x = chain_record(until=50.0)
    state, given = observer.init(0.0, x=[4, 20, 60]), []
    for k in range(len(t)):
        state, estimate = observer.step(state, Sample(t[k], y=x[k, 2:]))
        assert estimate.t == t[k]
        assert estimate.status == "unresolved"
        given += [row.t for row in state.decided]
        if state.decided and not events_of(state.decided):
            assert t[k] - given[-1] >= observer.latency - 1e-9
    given += [row.t for row in observer.finish(state)]
    np.testing.assert_array_equal(given, t)


@pytest.mark.parametrize("h", [0.05, 0.07, 0.5])
def test_any_period_and_any_window(h: float) -> None:
    t, x = chain_record(h)
    body = chain(output__period=h, observer__window=20.013)
    assert_found(rows_from(observer_of(body), t, x[:, 2:], x=[4, 20, 60]), TRAIN, 1e-5)


def test_irregular_and_missing_samples() -> None:
    t, x = chain_record()
    rng = np.random.default_rng(5)
    kept = np.sort(rng.choice(np.arange(1, len(t)), 1500, replace=False))
    body = chain(output__measured="continuous")
    del body["output"]["period"]
    observer = observer_of(body)
    assert_found(rows_from(observer, t[kept], x[kept, 2:], x=x[kept[0]]), TRAIN, 1e-5)


def test_positive_exponents_give_the_same_answer() -> None:
    t, x = chain_record()
    for exponents in ([-0.65, -0.7, -0.75, -0.8], [0.05, -0.01, -0.3, 0.2, -0.7, 0]):
        body = chain(observer__exponents=exponents)
        assert_found(rows_from(observer_of(body), t, x[:, 2:], x=[4, 20, 60]), TRAIN, 1e-6)


def test_a_threshold_fires_instead_of_a_maximum() -> None:
    t, x = chain_record()
    # above what the largest weight leaves at the age of the margin, below what the smallest reaches
    body = chain(observer__threshold=80.0, observer__exponents=[-0.65, -0.7, -0.75, -0.8])
    observer = observer_of(body)
    assert observer.gains.rule == "threshold"
    assert_found(rows_from(observer, t, x[:, 2:], x=[4, 20, 60]), TRAIN, 1e-6)
    # the twin: a threshold above every impulse finds none
    high = observer_of(chain(observer__threshold=1e6))
    assert not events_of(rows_from(high, t, x[:, 2:], x=[4, 20, 60]))


@pytest.mark.parametrize("threshold", [40.0, 80.0, 200.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_threshold_separates_the_weights_whose_largest_features_it_lies_between(
    threshold: float, sign: float
) -> None:
    """|R| of an impulse of weight w reaches |w| max |b| (Mattsson and Medvedev, Section III-C)."""
    body = chain(observer__threshold=threshold, observer__exponents=[-0.65, -0.7, -0.75, -0.8])
    design = designed(body)
    expected = next(c.evidence["approx_expected"] for c in design.claims if c.id == "uniqueness")
    observer = from_design(design)
    t = np.round(0.05 * np.arange(round(60 / 0.05) + 1), 10)
    for share, count in ((0.98, 0), (1.02, 1)):
        train = ((12.34567, sign * share * threshold / expected["peak"]),)
        x = record(np.array(body["flow"]["A"]), body["jump"]["H"], train, t, [4, 20, 60])
        assert len(events_of(rows_from(observer, t, x[:, 2:], x=[4, 20, 60]))) == count


def test_records_that_hold_nothing() -> None:
    observer = observer_of(chain())
    t = np.round(0.05 * np.arange(1000), 10)
    nothing = observer.run_batch(t, np.full((1000, 1), np.nan), x=[1, 2, 3])
    assert set(nothing.status) == {"missing sample"}
    flow = np.array(chain()["flow"]["A"])
    from scipy.linalg import expm

    np.testing.assert_allclose(nothing.x[-1], expm(flow * t[-1]) @ [1, 2, 3], rtol=1e-8)
    short = observer.run_batch(t[:200], np.ones((200, 1)))
    assert set(short.status) == {"unresolved"}
    zero = rows_from(observer, t, np.zeros((1000, 1)))
    assert not events_of(zero)
    assert not np.any([row.x for row in zero])


def test_coordinates_time_units_and_signs_do_not_matter() -> None:
    t, x = chain_record()
    plain = events_of(rows_from(observer_of(chain()), t, x[:, 2:], x=[4, 20, 60]))
    T = np.array([[1.0, 0.5, 0], [0, 2, 0.25], [0.5, 0, 1]])
    back = np.linalg.inv(T)
    A, H, C = np.array(CHAIN["flow"]["A"]), np.array(CHAIN["jump"]["H"]), np.array([[0, 0, 1]])
    turned = chain(
        flow__A=(T @ A @ back).tolist(), jump__H=(T @ H).tolist(), output__C=(C @ back).tolist()
    )
    other = events_of(rows_from(observer_of(turned), t, x[:, 2:], x=T @ [4, 20, 60]))
    for first, second in zip(plain, other, strict=True):
        assert first.t == pytest.approx(second.t, abs=1e-6)
        np.testing.assert_allclose(first.weights, second.weights, atol=1e-6)
    unit = 2.0**10  # seconds for minutes, as it were
    slow = chain(
        flow__A=(A / unit).tolist(),
        jump__dwell_time=[25 * unit, "inf"],
        output__period=0.05 * unit,
        observer__window=20 * unit,
        observer__margin=5 * unit,
    )
    other = events_of(rows_from(observer_of(slow), t * unit, x[:, 2:], x=[4, 20, 60]))
    for first, second in zip(plain, other, strict=True):
        assert first.t * unit == pytest.approx(second.t, abs=1e-5 * unit)
    mirrored = events_of(rows_from(observer_of(chain()), t, -x[:, 2:], x=[-4, -20, -60]))
    for first, second in zip(plain, mirrored, strict=True):
        np.testing.assert_allclose(first.weights, -second.weights, atol=1e-6)


@pytest.mark.parametrize("weighting", ["gls", "plain"])
@pytest.mark.parametrize(("units", "second"), [(1e30, 1.0), (1e-9, 1e9)])
def test_deviations_scale_with_the_units(weighting: str, units: float, second: float) -> None:
    """Of y and of time: an age and a weight may be of any two sizes beside each other."""
    t = np.arange(0.0, 20.0, 0.2)
    ages = np.maximum(t - 3.03, 0.0)
    y = 5 * (np.exp(-0.3 * ages) - np.exp(-ages)) + 0.01 * np.random.default_rng(1).normal(
        size=len(t)
    )
    events = []
    for unit, scale in ((1.0, 1.0), (units, second)):
        body = {
            "flow": {"A": [[-1 / scale, 0], [0.5 / scale, -0.3 / scale]]},
            "jump": {"H": [[1], [0]], "dwell_time": [5 * scale, "inf"]},
            "output": {"C": [[0, 1]], "measured": "periodic", "period": 0.2 * scale,
                       "noise_std": [0.01 * unit]},
            "observer": {"kind": "impulsive_input", "operator": "integral",
                         "weighting": weighting},
        }  # fmt: skip
        rows = rows_from(observer_of(body), t * scale, unit * y[:, None])
        (event,) = events_of(rows)
        events.append((event.t / scale, event.weights[0] / unit, event.t_std / scale,
                       event.weights_std[0] / unit))  # fmt: skip
    np.testing.assert_allclose(*events, rtol=1e-3)
    assert 1e-3 < events[0][2] < 1


def test_known_inputs_and_drift_are_accounted_for() -> None:
    h, t = 0.05, np.round(0.05 * np.arange(1601), 10)
    A, B = np.array(CHAIN["flow"]["A"]), np.array([[0.0], [1], [0.5]])
    u = np.where(t < 20, 1.0, -2.0)
    first = record(
        A, CHAIN["jump"]["H"], TRAIN[:1], t[: 400 + 1], [4, 20, 60], B[:, 0] + [0, 0, 0.1]
    )
    following = record(
        A, CHAIN["jump"]["H"], TRAIN[1:], t[400:], first[-1], -2 * B[:, 0] + [0, 0, 0.1]
    )
    x = np.vstack([first[:-1], following])
    still = {"lower": [0, 0, 0.1], "upper": [0, 0, 0.1]}
    body = chain(flow__B=B.tolist(), flow__disturbance=still)
    rows = rows_from(observer_of(body), t, x[:, 2:], u, x=[4, 20, 60])
    assert_found(rows, TRAIN[:2], 1e-6)
    assert h == 0.05


def test_impulses_closer_than_the_dwell_time_are_flagged_in_noise() -> None:
    t = np.round(0.05 * np.arange(2001), 10)
    body = chain(output__noise_std=[0.5], observer__state_correction=True)
    A, H = np.array(body["flow"]["A"]), body["jump"]["H"]
    noise = 0.5 * np.random.default_rng(6).standard_normal((len(t), 1))
    statuses = {}
    for gap in (0.2, 8.0):
        x = record(A, H, ((40.0, 5.0), (40.0 + gap, 5.0)), t, [4, 20, 60])
        events = events_of(rows_from(observer_of(body), t, x[:, 2:] + noise, x=[4, 20, 60]))
        statuses[gap] = [event.status for event in events]
    assert any(status != "ok" for status in statuses[8.0])
    # this close they look like one impulse of twice the weight: no test can see that
    assert statuses[0.2] == ["ok"]


def test_impulses_closer_than_the_dwell_time_are_flagged_without_noise() -> None:
    t = np.round(0.05 * np.arange(2001), 10)
    A, H = np.array(CHAIN["flow"]["A"]), CHAIN["jump"]["H"]
    for gap, fits in ((10.0, False), (30.0, True)):
        x = record(A, H, ((30.0, 4.0), (30.0 + gap, 5.0)), t, [4, 20, 60])
        batch = observer_of(chain()).run_batch(t, x[:, 2:], x=[4, 20, 60])
        assert all((e.status == "ok") is fits for e in batch.events), gap
        assert len(batch.events) == 1 + fits
        flagged = {s for s in batch.status if "does not fit" in s}
        assert (flagged == set()) is fits


def test_proportional_noise_alone_and_outputs_that_are_zero() -> None:
    t = np.round(0.05 * np.arange(2001), 10)
    observer = observer_of(chain(output__noise_cv=[0.01]))
    x = record(np.array(CHAIN["flow"]["A"]), CHAIN["jump"]["H"], ((30.0, 4.0),), t, [0, 0, 0])
    (event,) = observer.run_batch(t, x[:, 2:]).events
    assert event.t == pytest.approx(30, abs=0.05)
    assert not observer.run_batch(t, 0 * x[:, 2:]).events


# --- random systems ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 6, 9, 1022, 1118])
def test_random_systems_are_recovered(seed: int) -> None:
    assert outcome(seed)[0] == "found", outcome(seed)


@pytest.mark.parametrize(
    ("A", "H", "C", "dwell", "h", "std"),
    [
        ([[-1, 0], [1, -2]], [[1], [0]], [[0, 1]], 100, 0.05, 0.02),  # fast, rarely hit
        ([[-0.1, 1], [-1, -0.1]], [[0], [1]], [[1, 0]], 30, 0.05, 0.05),  # rings
        ([[0, 1], [-25, -0.2]], [[0], [1]], [[1, 0]], 5, 0.01, 0.005),  # a spring, hardly damped
        ([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 10, 0.02, 0.01),  # a free mass
        ([[-0.3, 0, 0], [1, -0.5, 0], [0, 0.5, -0.2]], [[1, 0], [0, 0], [0, 1]],
         [[0, 1, 0], [0, 0, 1]], 20, 0.05, 0.05),  # two directions, two outputs
    ],
)  # fmt: skip
def test_what_is_left_open_suits_the_plant(
    A: Any, H: Any, C: Any, dwell: float, h: float, std: float
) -> None:
    body = {
        "flow": {"A": A}, "jump": {"H": H, "dwell_time": [dwell, "inf"]},
        "output": {"C": C, "measured": "periodic", "period": h, "noise_std": [std] * len(C)},
        "observer": {"kind": "impulsive_input"},
    }  # fmt: skip
    rng = np.random.default_rng(8)
    t = np.round(h * np.arange(round(7 * dwell / h)), 10)
    q = len(H[0])
    train = [(dwell * (1.3 * k + rng.uniform(0, 0.2)), rng.choice([-1, 1], q) * rng.uniform(1, 3, q))
             for k in range(1, 5)]  # fmt: skip
    x = record(np.array(A), H, train, t, np.zeros(len(A)))
    y = x @ np.array(C).T + std * rng.standard_normal((len(t), len(C)))
    events = observer_of(body).run_batch(t, y).events
    assert [e.status for e in events] == ["ok"] * len(train)
    for event, (moment, weights) in zip(events, train, strict=True):
        assert event.t_std < 0.05 * dwell
        assert abs(event.t - moment) < 5 * event.t_std
        assert (np.abs(event.weights - weights) < 5 * event.weights_std + 0.02).all()


def test_where_samples_cannot_show_the_onset_it_is_said() -> None:
    assert outcome(1000)[0] == HIDDEN
    body = {"flow": {"A": [[-1, 0], [0, -2]]}, "jump": {"H": [[1], [1]], "dwell_time": [3, "inf"]},
           "output": {"C": [[1, 1]], "measured": "periodic", "period": 0.01},
           "observer": {"kind": "impulsive_input"}}  # fmt: skip
    sentence = "samples show only between which two of them it came"
    for H, expected in (([[1], [1]], False), ([[1], [0]], True), ([[1, 0], [0, 1]], True)):
        body["jump"]["H"] = H
        design = obsdesign.investigate(obsdesign.Problem.from_dict(body)).design
        assert design is not None
        assert (sentence in design.guarantees[0].statement) is expected


# --- claims and refusals ------------------------------------------------------------------------------


def verdicts(body: dict[str, Any]) -> dict[str, str]:
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    return {claim.id: claim.verdict for claim in outcome.claims}


def reasons(body: dict[str, Any]) -> list[str]:
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "refuted"
    return [c.evidence["witness"]["reason"] for c in outcome.claims if c.verdict == "refuted"]


def test_a_design_is_proved_again_and_survives_its_file(tmp_path: Any) -> None:
    for body in (chain(), chain(output__noise_std=[0.1]), chain(observer__ratio=0.01)):
        design = designed(body)
        design.save(tmp_path / "design.json")
        again = obsdesign.load_design(tmp_path / "design.json")
        assert obsdesign.verify(again).verdict == "proved"
        t, x = chain_record(until=50.0)
        first, second = (from_design(d).run_batch(t, x[:, 2:]).x for d in (design, again))
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"observer__window": 1e9}, "the window 1000000000.0 is not below the shortest dwell time 25.0: impulses at t = 0 and t = 25.0 would share one window"),
        ({"observer__window": 25}, "the window 25.0 is not below the shortest dwell time 25.0: impulses at t = 0 and t = 25.0 would share one window"),
        ({"observer__exponents": [-0.5, -0.6]}, "2 features (exponents times outputs) cannot show 3 states"),
        ({"output__C": [[1, 0, 0]]}, "no output shows the direction x2 of the state"),
        ({"observer__gains": {"K": [[0], [0], [0]]}, "observer__exponents": [-0.2, -0.5, -0.7]}, "the exponent -0.2 is an eigenvalue of A - K C"),
        ({"observer__gains": {"K": [[0], [0], [-1]]}, "observer__exponents": [-0.4, -0.5, -0.7]}, "the flow has a mode that does not decay: eigenvalue 0.8"),
    ],
)  # fmt: skip
def test_refusals_have_their_witness(changes: dict[str, Any], reason: str) -> None:
    assert reason in reasons(chain(**changes))


def test_a_ratio_is_proved_below_and_refuted_above() -> None:
    given = {
        "observer__exponents": [-2.65, -2.7, -2.75],
        "observer__gains": {"K": [[0.0002], [0.0048], [0.02]]},
    }
    assert verdicts(chain(**given, observer__ratio=5.571e-8))["ratio"] == "proved"
    assert verdicts(chain(**given, observer__ratio=5.570e-8))["ratio"] == "refuted"


def test_one_exponent_leaves_two_answers() -> None:
    body = {"flow": {"A": [[-1]]}, "jump": {"H": [[1]], "dwell_time": [3, "inf"]},
            "output": {"C": [[1]]}, "observer": {"kind": "impulsive_input", "exponents": [-2], "window": 2}}  # fmt: skip
    assert verdicts(body)["uniqueness"] == "refuted"
    body["observer"]["exponents"] = [-2, -3]
    assert verdicts(body)["uniqueness"] == "proved"


def test_forged_gains_are_seen() -> None:
    design = designed(chain(observer__exponents=[-0.6, -0.7, -0.8, -0.9]))
    from dataclasses import replace

    for name, value in (
        ("exponents", np.array([-0.6, -0.7, -0.8])), ("H", np.array([[1.0], [1], [0]])),
        ("window", 19.0), ("rule", "whenever"), ("margin", -1.0), ("weighting", "gls"),
        ("nonnegative", True), ("state_correction", True),
    ):  # fmt: skip
        forged = replace(design, gains=dict(design.gains) | {name: value})
        assert obsdesign.verify(forged).verdict == "refuted", name


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"jump__G": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}, "jump.G must be the identity for kind 'impulsive_input': impulses add to the state at unknown times, and nothing else may happen then. Leave jump.G out."),
        ({"jump__E": [[1], [0], [0]]}, "jump.E is refused by kind 'impulsive_input': jump times are unknown, so that no known input can act at them."),
        ({"observer__window": 24.9, "flow__A": [[-8, 0, 0], [2, -15, 0], [0, 5, -20]], "observer__margin": 20, "observer__exponents": [-5, -6, -7]}, "observer.margin must be below 1.7, where less than a thousandth of an impulse is left in the features; got 20.0. Is observer.window = 24.9 too long for the plant, or the exponents too fast?"),
        ({"observer__weighting": "gls"}, "output.noise_std must be > 0 with observer.weighting = 'gls'; got 0 for output 1."),
        ({"observer__state_correction": True}, "observer.state_correction needs observer.weighting = 'gls', and output.noise_std > 0: without noise there is nothing to weigh the state by."),
        ({"jump__H": [[1, 0], [0, 1], [0, 0]], "observer__nonnegative": True}, "observer.nonnegative takes one direction of impulses; jump.H has 2."),
        ({"observer__operator": "samples", "observer__exponents": [-1, -2, -3]}, "observer.exponents belongs to operator 'integral'; with 'samples' all samples of the window are used as they are."),
    ],
)  # fmt: skip
def test_bad_input_has_its_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(chain(**changes)))
    assert str(error.value) == line


def test_a_missing_block_has_its_line() -> None:
    body = chain()
    del body["jump"]["H"]
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert str(error.value) == "jump.H is required by kind 'impulsive_input'; it is missing."


def test_the_first_covariance_does_not_matter_much() -> None:
    t, x = chain_record()
    y = x[:, 2:] + np.random.default_rng(8).normal(0, 0.5, (len(t), 1))
    observer = observer_of(chain(output__noise_std=[0.5]))
    for P in (None, np.diag([9.0, 100, 100])):
        events = events_of(rows_from(observer, t, y, x=[7, 30, 70], covariance=P))
        assert len(events) == 3
        for event, (moment, _) in zip(events, TRAIN, strict=True):
            assert abs(event.t - moment) < 5 * event.t_std
            assert math.isfinite(event.t_std)


@pytest.mark.parametrize("operator", ["integral", "samples"])
def test_time_increases_from_the_first_sample_on(operator: str) -> None:
    body = chain(output__noise_std=[0.1])
    if operator == "samples":
        body["observer"] = {"kind": "impulsive_input", "operator": operator}
    observer = observer_of(body)
    state = observer.init(0.0)
    state, _ = observer.step(state, Sample(0.0, y=[1.0]))  # the initial time is that of a sample
    for t in (0.0, -1.0):
        with pytest.raises(ValueError, match="time must increase"):
            observer.step(state, Sample(t, y=[1.0]))
    state, row = observer.step(state, Sample(0.05, y=[1.0]))
    assert row.t == 0.05


@pytest.mark.parametrize("first", [0.0, 0.03, -7.25])
def test_samples_are_due_by_the_first_row(first: float) -> None:
    rows: Any = SimpleNamespace(run=SimpleNamespace(gains=SimpleNamespace(period=0.1)))
    for k in (1, 2, 50):
        assert Rows._missing(rows, first, first + 0.1 * k) == ("missing sample",)
        assert Rows._missing(rows, first, first + 0.1 * k + 0.04) == ()
    rows.run.gains.period = None
    assert Rows._missing(rows, first, first + 0.04) == ("missing sample",)


@pytest.mark.parametrize("shift", [0.0003, 0.02, 0.049])
def test_the_cell_of_an_onset_is_a_likely_one(
    shift: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the curve of all ages says: as samples show onsets, that cell stands out."""
    likely, cells = CellFits.likely, []

    def kept(self: Any, features: Any) -> Any:
        cells.append((self.t, likely(self, features)))
        return cells[-1][1]

    monkeypatch.setattr(CellFits, "likely", kept)
    t, body = np.round(0.05 * np.arange(1001), 10), chain()
    moment = 20.0 + shift
    x = record(np.array(body["flow"]["A"]), body["jump"]["H"], [(moment, 4.0)], t, [4, 20, 60])
    observer = observer_of(body)
    assert len(observer.run_batch(t, x[:, 2:], x=[4, 20, 60]).events) == 1
    near = [np.abs(times[sorted(found)] - moment).min() for times, found in cells if found]
    assert near
    assert max(near) <= 0.11
