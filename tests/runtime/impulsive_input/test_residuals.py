"""Residuals larger than the noise widen deviations and say so; the state at first, and corrected."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design
from obsdesign.runtime.impulsive_input.residuals import LARGER, Residuals, birge_ratio
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit
from tests.systems.impulsive_input import CHAIN, observer_of, record

TWO: dict[str, Any] = {
    "flow": {"A": [[-1.0, 0], [1, -0.5]]},
    "jump": {"H": [[1], [0]], "dwell_time": [6, "inf"]},
    "output": {"C": [[0, 1]], "measured": "periodic", "period": 0.05, "noise_std": [0.03]},
    "observer": {"kind": "impulsive_input", "operator": "integral"},
}


def scores(body: Any, wrong: Any, seed: int, spike: float = 0.0) -> tuple[Any, list[str]]:
    """(error of the weight over its deviation, status) of 40 impulses; the plant is A + wrong."""
    rng = np.random.default_rng(seed)
    A, H = np.array(body["flow"]["A"]) + wrong, np.array(body["jump"]["H"])
    dwell, period = float(body["jump"]["dwell_time"][0]), body["output"]["period"]
    moments = np.cumsum(dwell * (1.2 + rng.exponential(0.5, 40)))
    train = [(float(t), float(g)) for t, g in zip(moments, rng.uniform(1, 3, 40), strict=True)]
    t = period * np.arange(int((moments[-1] + dwell) / period))
    still = body["flow"].get("disturbance")
    forced = None if still is None else np.array(still["lower"])
    y = record(A, H, train, t, np.zeros(len(A)), forced) @ np.array(body["output"]["C"]).T
    sizes = np.hypot(body["output"].get("noise_std", [0.0]),
                     np.array(body["output"].get("noise_cv", [0.0])) * np.abs(y))  # fmt: skip
    y = y + sizes * rng.standard_normal(y.shape)
    y[int(np.searchsorted(t, moments[2])) - 2] += spike
    events = observer_of(body).run_batch(t, y, x=np.zeros(len(A))).events
    nearest = [min(events, key=lambda e, m=m: abs(e.t - m)) for m, _ in train]
    errors = [
        (e.weights[0] - g) / e.weights_std[0] for e, (_, g) in zip(nearest, train, strict=True)
    ]
    return np.array(errors), [e.status for e in nearest]


@pytest.fixture
def precise(body: dict[str, Any]) -> dict[str, Any]:
    """The hormone with an assay so good that a wrong half-life shows."""
    proportional = copy.deepcopy(body)
    proportional["output"]["noise_cv"] = [0.01]
    return proportional


def wrong_by(body: Any, part: float, entry: tuple[int, int]) -> Any:
    A = np.zeros((2, 2))
    A[entry] = part * np.array(body["flow"]["A"])[entry]
    return A


@pytest.mark.parametrize("operator", ["samples", "integral"])
def test_a_wrong_plant_widens_deviations_and_is_told(
    operator: str, precise: dict[str, Any]
) -> None:
    body = precise if operator == "samples" else TWO
    wrong = (
        wrong_by(body, 0.1, (1, 1)) if operator == "samples" else 0.1 * np.array(TWO["flow"]["A"])
    )
    errors, status = scores(body, wrong, 0)
    fine = np.array([word == "ok" for word in status])
    # the first impulses come before the residuals of the record are significant
    assert not (fine & (np.abs(errors) > 5))[10:].any()
    assert sum(LARGER in word for word in status) >= 25
    assert np.sqrt(np.mean(errors**2)) < 3.5  # 4.7 for the hormone as the noise alone would have it
    # the twin: with the right plant nothing is widened, and deviations are what errors are
    errors, status = scores(body, 0.0, 0)
    assert not any(LARGER in word for word in status)
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.3


@pytest.mark.parametrize(("operator", "period"), [("samples", 0.5), ("integral", 0.05)])
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_deviations_of_time_and_weight_are_what_errors_are(
    operator: str, period: float, noise: float
) -> None:
    """Neither too small nor too large: 40 impulses, chi-square within four deviations."""
    body = copy.deepcopy(TWO)
    body["output"] |= {"noise_std": [noise], "period": period}
    body["observer"]["operator"] = operator
    rng = np.random.default_rng(7)
    moments = np.cumsum(6 * (1.2 + rng.exponential(0.5, 40)))
    weights = rng.uniform(1, 3, 40)
    t = period * np.arange(int((moments[-1] + 6) / period))
    train = list(zip(moments, weights, strict=True))
    y = record(np.array(body["flow"]["A"]), body["jump"]["H"], train, t, [0, 0])[:, 1:]
    events = (
        observer_of(body).run_batch(t, y + noise * rng.standard_normal(y.shape), x=[0, 0]).events
    )
    events = [min(events, key=lambda e, m=m: abs(e.t - m)) for m in moments]
    for errors, deviations in (
        ([e.t for e in events] - moments, [e.t_std for e in events]),
        (np.array([e.weights[0] for e in events]) - weights, [e.weights_std[0] for e in events]),
    ):
        assert 0.55 < np.sqrt(np.mean((errors / deviations) ** 2)) < 1.45


def test_one_bad_row_is_not_held_against_all_that_follow(precise: dict[str, Any]) -> None:
    _, status = scores(precise, 0.0, 1, spike=3.0)
    assert not any(LARGER in word for word in status[6:])
    assert any(word != "ok" for word in status[:4])


@pytest.mark.parametrize("freedom", [1, 3, 40])
def test_the_ratio_is_one_for_what_noise_explains(freedom: int) -> None:
    rng = np.random.default_rng(freedom)
    squares = rng.chisquare(freedom, 2000)
    assert np.mean([birge_ratio(cost, freedom) > 1 for cost in squares]) < 0.005
    noise = wide = Residuals()
    for cost in squares:
        noise, wide = noise.joined(cost, freedom), wide.joined(2 * cost, freedom)
    assert noise.ratio == 1
    assert wide.ratio == pytest.approx(2**0.5, rel=0.1)
    assert Residuals().ratio == birge_ratio(0.0, 0) == 1
    assert Residuals().joined(1e300, 1).joined(1e300, 0).cost == chi_squared_limit(1)


# --- state_correction and initial_std -----------------------------------------------------------------


def noisy(**observer: Any) -> dict[str, Any]:
    body = copy.deepcopy(CHAIN)
    body["output"]["noise_std"] = [0.3]
    body["observer"] |= observer
    return body


def designed(body: Any) -> Any:
    return obsdesign.design(obsdesign.Problem.from_dict(body))


def test_gls_corrects_the_state_unless_asked_not_to() -> None:
    design = designed(noisy())
    assert design.gains["state_correction"] is True
    assert designed(noisy(state_correction=False)).gains["state_correction"] is False
    # the plain norm has no covariance to weigh the state by
    assert designed(noisy(weighting="plain")).gains["state_correction"] is False
    # a design of before, which stored false, is still one; one that differs from its file is not
    before = replace(design, gains={**design.gains, "state_correction": False})
    assert obsdesign.verify(before).verdict == "proved"
    requested = designed(noisy(state_correction=True))
    other = replace(requested, gains={**requested.gains, "state_correction": False})
    assert obsdesign.verify(other).verdict == "refuted"


@pytest.mark.parametrize("operator", ["integral", "samples"])
def test_initial_deviations_are_the_first_covariance(operator: str) -> None:
    std = [0.5, 2.0, 1.0]
    body = (
        noisy(operator=operator) if operator == "integral" else noisy(operator=operator, window=2)
    )
    if operator == "samples":
        del body["observer"]["margin"]
    else:
        body["observer"]["exponents"] = [-0.65 - 0.05 * k for k in range(6)]
    given = copy.deepcopy(body)
    given["observer"]["initial_std"] = std
    design = designed(given)
    assert obsdesign.verify(design).verdict == "proved"
    forged = replace(design, gains={**design.gains, "initial_std": np.array([0.5, 2.0, 9.0])})
    assert obsdesign.verify(forged).verdict == "refuted"
    rows, moment = (1401, 32.0) if operator == "integral" else (301, 9.0)
    t = np.round(0.05 * np.arange(rows), 10)
    A, H = np.array(body["flow"]["A"]), body["jump"]["H"]
    rng = np.random.default_rng(4)
    start = np.array(std) * rng.standard_normal(3)
    y = record(A, H, ((moment, 4.0),), t, start)[:, 2:] + 0.3 * rng.standard_normal((len(t), 1))
    y[:5] = np.nan  # what is known of the state at first moves with the plant
    with_option, plain = from_design(design), from_design(designed(body))
    once = with_option.run_batch(t, y)
    np.testing.assert_array_equal(once.x, plain.run_batch(t, y, covariance=np.diag(std) ** 2).x)
    assert not np.array_equal(once.x, plain.run_batch(t, y).x)  # the twin: from the data
    flow = expm(A * float(t[5]))
    shifted = plain.run_batch(t[5:], y[5:], covariance=flow @ np.diag(std) ** 2 @ flow.T)
    np.testing.assert_allclose(once.x[5:], shifted.x, rtol=1e-6, atol=1e-6)


def test_a_known_state_is_not_taken_for_an_impulse() -> None:
    """Deviations near the errors of the first guess: its decay is explained by them."""
    t = np.round(0.05 * np.arange(1401), 10)
    A, H = np.array(CHAIN["flow"]["A"]), CHAIN["jump"]["H"]
    rng, start = np.random.default_rng(7), np.array([0.0, 0.0, 0.0])
    y = record(A, H, ((30.0, 4.0),), t, start)[:, 2:] + 0.3 * rng.standard_normal((len(t), 1))
    batch = from_design(designed(noisy(initial_std=[1e-3] * 3))).run_batch(t, y)
    (event,) = batch.events
    assert event.t == pytest.approx(30.0, abs=4 * event.t_std)
    data = from_design(designed(noisy())).run_batch(t, y)
    inside = (t > 5) & (t < 29)
    truth = record(A, H, ((30.0, 4.0),), t, start)
    assert np.abs(batch.x - truth)[inside].mean() <= np.abs(data.x - truth)[inside].mean()


@pytest.mark.parametrize(
    ("observer", "words"),
    [
        ({"initial_std": [1.0, 2.0]}, "observer.initial_std must have 3 entries, one per state; got 2."),
        ({"initial_std": [1.0, -2.0, 1.0]}, "a number >= 0"),
        ({"initial_std": [1.0, 1e120, 1.0]}, "observer.initial_std must be at most 1e.100, since it is squared; got 1e.120."),
        ({"initial_std": [1.0, 2.0, 1.0], "weighting": "plain"}, "observer.initial_std needs observer.weighting = 'gls'"),
    ],
)  # fmt: skip
def test_initial_deviations_are_checked(observer: Any, words: str) -> None:
    with pytest.raises(obsdesign.InputError, match=words):
        designed(noisy(**observer))
