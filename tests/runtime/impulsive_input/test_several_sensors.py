"""More sensors, and better ones, lose no impulse; a sensor K decouples gives no unit of its own."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from obsdesign.equations.impulsive_input.gains import gains_from_document
from obsdesign.errors import InputError
from obsdesign.runtime import from_design
from obsdesign.runtime.impulsive_input.integral.matched_filter import MatchedFilter
from tests.systems.designs import designed
from tests.systems.impulsive_input import events_of, observer_of, record, rows_from

# a chain of tanks, y: the levels of the second and third
TANKS: dict[str, Any] = {
    "flow": {"A": [[-0.21, 0, 0], [0.21, -0.22, 0], [0, 0.22, -0.5]]},
    "jump": {"H": [[1], [0], [0]], "dwell_time": [16, "inf"]},
    "output": {"C": [[0, 1, 0], [0, 0, 1]], "measured": "periodic", "period": 0.28},
    "observer": {
        "kind": "impulsive_input", "operator": "integral",
        "exponents": [-0.62, -0.65, -0.68, -0.71, -0.74, -0.77, -0.8, -0.83],
    },
}  # fmt: skip
# a warm plate, heated at one end; y: the other two temperatures
PLATE = TANKS | {"flow": {"A": [[-0.5, 0.2, 0], [0.2, -0.45, 0.15], [0, 0.15, -0.25]]}}
TRAIN = tuple((24.03 + 21.7 * k, (0.7, 0.95, 1.4, 0.55)[k % 4]) for k in range(6))
TIMES = np.round(0.28 * np.arange(600), 10)


def body_of(plant: dict[str, Any], noise: tuple[float, ...], outputs: Any, **more: Any) -> Any:
    body = copy.deepcopy(plant)
    C = np.array(body["output"]["C"], float)[outputs]
    body["output"] |= {"C": C.tolist(), "noise_std": list(noise), **more}
    return body


def design_of(body: dict[str, Any]) -> Any:
    return designed(body)


@cache
def states(flow: tuple[tuple[float, ...], ...]) -> np.ndarray:
    return record(np.array(flow), TANKS["jump"]["H"], TRAIN, TIMES, np.zeros(3))


def found(design: Any, body: dict[str, Any]) -> list[Any]:
    """Impulses of a record with the stated noise, the same for all."""
    x = states(tuple(map(tuple, body["flow"]["A"])))
    C, std = np.array(body["output"]["C"]), np.array(body["output"]["noise_std"])
    noise = np.random.default_rng(5).standard_normal((len(TIMES), 2))[:, -len(std) :]
    return events_of(rows_from(from_design(design), TIMES, x @ C.T + noise * std, x=np.zeros(3)))


def check_found(events: list[Any]) -> None:
    for event, (moment, weight) in zip(events, TRAIN, strict=True):
        assert abs(event.t - moment) <= 5 * event.t_std
        assert abs(event.weights[0] - weight) <= 5 * event.weights_std[0]
        assert event.status == "ok"


@pytest.mark.parametrize("plant", [TANKS, PLATE], ids=["tanks", "plate"])
def test_a_better_second_sensor_loses_no_impulse(plant: dict[str, Any]) -> None:
    widths = []
    for std in (0.08, 0.008, 0.0005):
        body = body_of(plant, (0.035, std), [0, 1])
        design = design_of(body)
        assert design.gains["rule"] == "position"
        events = found(design, body)
        check_found(events)
        widths.append([event.weights_std[0] for event in events])
    assert (np.diff(widths, axis=0) < 0).all()  # and each makes them more certain


@pytest.mark.parametrize("coarse", [0.1, 3.0])
def test_a_bad_sensor_beside_an_exact_one_loses_no_impulse(coarse: float) -> None:
    alone, both = body_of(TANKS, (1e-6,), [1]), body_of(TANKS, (coarse, 1e-6), [0, 1])
    for body in (alone, both):
        check_found(found(design_of(body), body))


def test_the_size_of_features_hides_impulses(monkeypatch: pytest.MonkeyPatch) -> None:
    """|R|, in which noise of both sensors adds up, as designs without units search it."""
    body = body_of(TANKS, (0.035, 0.0005), [0, 1])
    design = design_of(body)
    older = replace(design, gains={**design.gains, "rule": "peak"})
    check_found(found(older, body))  # by the matched filter
    monkeypatch.setattr(MatchedFilter, "deviations", lambda self, R, oldest: 0 * oldest)
    assert not found(older, body)


# y1 = x2 and y2 = c x1 + x2: the K of the default poles hides the impulse from y1
@pytest.mark.parametrize("units", [(1.0, 1.0), (1e-3, 10.0)])
@pytest.mark.parametrize("A", [[[-0.64, -1.0], [1.0, -0.15]], [[-0.9, -2.0], [1.5, -0.3]]])
def test_no_unit_is_a_rounding_error(A: list[list[float]], units: tuple[float, float]) -> None:
    C = np.array(units)[:, None] * [[0.0, 1.0], [0.2, 1.0]]
    body: dict[str, Any] = {
        "flow": {"A": A}, "jump": {"H": [[1.0], [0.0]], "dwell_time": [6.0, "inf"]},
        "output": {"C": C.tolist(), "measured": "periodic", "period": 0.1},
        "observer": {"kind": "impulsive_input", "operator": "integral"},
    }  # fmt: skip
    train, times = (
        ((12.14, 0.968), (29.55, 0.714), (37.28, 1.462)),
        np.round(np.arange(600) / 10, 10),
    )
    x = record(np.array(A), [[1.0], [0.0]], train, times, np.zeros(2))
    design = design_of(body)
    assert (np.array(design.gains["output_units"]) / units > 0.05).all()
    events = events_of(rows_from(from_design(design), times, x @ C.T, x=np.zeros(2)))
    for event, (moment, weight) in zip(events, train, strict=True):
        assert event.t == pytest.approx(moment, abs=1e-4)
        assert event.weights[0] == pytest.approx(weight, rel=1e-4)


@pytest.mark.parametrize("operator", ["integral", "samples"])
@pytest.mark.parametrize("weighting", [None, "plain"])
def test_one_exact_output_beside_noise_is_refused(operator: str, weighting: str | None) -> None:
    body = body_of(TANKS, (0.035, 0.0), [0, 1])
    body["observer"] = {"kind": "impulsive_input", "operator": operator}
    body["observer"] |= {} if weighting is None else {"weighting": weighting}
    with pytest.raises(InputError, match=r"output.noise_std .* got 0 for output 2.*resolution"):
        design_of(body)


def test_proportional_noise_is_noise() -> None:
    """The twin: noise_std on one output, noise_cv on the other."""
    body = body_of(TANKS, (0.035, 0.0), [0, 1], noise_cv=[0.0, 0.02])
    assert design_of(body).gains["rule"] == "position"


def test_gains_with_one_exact_output_are_refused() -> None:
    design = design_of(body_of(TANKS, (0.035, 0.008), [0, 1]))
    forged = dict(design.gains) | {"noise_std": np.array([0.035, 0.0])}
    with pytest.raises(ValueError, match="noise_std must be > 0 for every output or for none"):
        gains_from_document(forged)


# bounded noise, nothing stated about its deviation: what is fitted is no impulse
@pytest.mark.parametrize("seed", [3, 8])
def test_no_impulse_is_younger_than_the_margin(seed: int) -> None:
    body: dict[str, Any] = {
        "flow": {"A": [[-0.8, 0], [0.8, -0.5]]},
        "jump": {"H": [[1], [0]], "dwell_time": [5, "inf"]},
        "output": {"C": [[0, 1]], "noise_bound": [0.02], "measured": "periodic", "period": 0.1},
        "observer": {"kind": "impulsive_input"},
    }
    y = 0.02 * np.random.default_rng(seed).uniform(-1, 1, (4000, 1))
    rows = rows_from(from_design(design_of(body)), np.arange(4000) / 10, y, x=np.zeros(2))
    assert max(abs(event.weights[0]) for event in events_of(rows)) < 0.5
    assert max(np.abs(row.x).max() for row in rows) < 0.5


@pytest.mark.parametrize("units", [(1e-4, 1.0), (1.0, 1e-4), (50.0, 3e5)])
def test_samples_start_alike_in_all_units(units: tuple[float, float]) -> None:
    A, H = [[-0.5, 0.0], [0.5, -0.3]], [[1.0], [0.0]]
    times = np.round(0.4 * np.arange(80), 10)
    x = record(np.array(A), H, ((17.1, 0.9),), times, [0.3, 0.5])
    noise = 0.02 * np.random.default_rng(2).standard_normal((80, 2))
    estimates = []
    for scale in (np.ones(2), np.array(units)):
        C = scale[:, None] * [[0.0, 1.0], [0.3, 1.0]]
        observer = from_design(design_of({
            "flow": {"A": A}, "jump": {"H": H, "dwell_time": [8, "inf"]},
            "output": {"C": C.tolist(), "noise_std": (0.02 * scale).tolist(),
                       "measured": "periodic", "period": 0.4},
            "observer": {"kind": "impulsive_input", "operator": "samples"},
        }))  # fmt: skip
        estimates.append([row.x for row in rows_from(observer, times, x @ C.T + noise * scale)])
    np.testing.assert_allclose(*estimates, rtol=1e-5, atol=1e-7)


CHAIN_A = np.array([[-0.5, 0, 0, 0], [0.7, -0.86, 0.33, 0], [0, 0, -1.12, 0], [0, 0, 0, -0.67]])
BLIND_C = np.array([[0.0, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]])  # impulses reach the last alone
EXPONENTS = [-1.32, -1.43, -1.53, -1.64, -1.75, -1.86, -1.97, -2.08]
CROSSED_K = [[0.1, 0.2, 0.1], [0.1, 0.9, -0.1], [0, 0.8, 0.6], [0.5, 0.8, 0.2]]


@pytest.mark.parametrize(
    "noise",
    [
        {"noise_std": [1e-8, 1e-8, 0.006]},
        {"noise_std": [1e-4, 1e-4, 0.006]},
        {"noise_cv": [0.003, 0.002, 0.007]},
    ],
)
def test_a_better_sensor_that_no_impulse_reaches_costs_no_impulse(noise: dict[str, Any]) -> None:
    """K copies the impulse into the residual of every sensor, sampled as the last one is."""
    body = {
        "flow": {"A": CHAIN_A.tolist()},
        "jump": {"H": [[1], [0], [0], [0]], "dwell_time": [8.0, math.inf]},
        "output": {"C": BLIND_C.tolist(), "measured": "periodic", "period": 0.1, **noise},
        "observer": {"kind": "impulsive_input", "operator": "integral", "weighting": "gls",
                     "gains": {"K": CROSSED_K}, "exponents": EXPONENTS},
    }  # fmt: skip
    t, rng = 0.1 * np.arange(800), np.random.default_rng(6)
    train = [(9.3 * k + rng.uniform(0, 1), rng.choice([-1, 1]) * rng.uniform(0.3, 2.5))
             for k in range(1, 8)]  # fmt: skip
    exact = record(CHAIN_A, np.eye(4)[:, :1], train, t, np.zeros(4)) @ BLIND_C.T
    relative = np.array(noise.get("noise_cv", [0, 0, 0])) * np.abs(exact)
    spread = noise.get("noise_std", relative)
    y = exact + spread * rng.standard_normal(exact.shape)
    events = events_of(rows_from(observer_of(body), t, y))
    assert len(events) == len(train)
    for event, (onset, weight) in zip(events, train, strict=True):
        assert event.status == "ok"
        assert abs(event.t - onset) < 5 * event.t_std
        assert abs(event.weights[0] - weight) < 5 * event.weights_std[0]
