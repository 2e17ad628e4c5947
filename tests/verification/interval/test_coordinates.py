"""Forms `coordinates` and `two_coordinates`: Theorem 7 as corrected, and what dominates it."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import obsdesign
from lmi.prove.common_matrix import prove_common
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem
from obsdesign.runtime import Sample, from_design
from obsdesign.runtime.interval.maps import jump_maps, step_maps
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.synthesis.interval.forms import gains_of_form

DIGITS = 1e-3  # the thresholds are known to four digits

# A = R = diag(-0.1, -0.2), T = diag(0.9, 0.8), S1 = I, S2 = [[1, 1], [1, 2]], no output correction
PRINTED_8_HOLDS: dict[str, Any] = {
    "flow": {"A": [[-0.1, 0], [0, -0.2]]},
    "jump": {"G": [[1, -0.1], [0.2, 0.7]], "dwell_time": [1, 1]},
    "output": {"C": [[1, 0]], "noise_bound": [0]},
    "observer": {
        "kind": "interval",
        "gains": {"L": [[0], [0]], "M": [[0], [0]], "S": [[1, 0], [0, 1]], "S2": [[1, 1], [1, 2]]},
    },
}
DEAD_BEAT: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]],
             "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [0, "inf"],
             "disturbance": {"lower": [-0.3, -0.3], "upper": [0.3, 0.3]}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {
        "kind": "interval",
        "form": "coordinates",
        "gains": {"L": [[0], [1]], "M": [[5], [5]], "S": [[0, 2], [1, 1]]},
    },
}  # fmt: skip


def problem_with(body: dict[str, Any], **changes: Any) -> obsdesign.Problem:
    changed = copy.deepcopy(body)
    for path, value in changes.items():
        block, key = path.split("__")
        changed[block][key] = value
    return obsdesign.Problem.from_dict(changed)


def verdicts(outcome: obsdesign.Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


def spectral_radius(W: np.ndarray, N: np.ndarray, theta: float) -> float:
    return float(max(abs(np.linalg.eigvals(expm(W * theta) @ N))))


# --- Theorem 7's boundedness is false -----------------------------------------------------------


def test_the_printed_condition_8_holds_for_the_counterexample() -> None:
    R, T = np.diag([-0.1, -0.2]), np.diag([0.9, 0.8])
    assert prove_common(R, T, np.eye(2), 0.0, math.inf).outcome == "proved"


def test_the_counterexample_is_refuted_by_the_corrected_condition() -> None:
    outcome = obsdesign.investigate(problem_with(PRINTED_8_HOLDS))
    assert outcome.result["form"] == "two_coordinates"
    assert verdicts(outcome)["flow_positive"] == verdicts(outcome)["jump_positive"] == "proved"
    assert verdicts(outcome)["dwell_stability"] == "refuted"


def test_the_widths_of_the_counterexample_do_explode() -> None:
    """Those of the recursion: what is reported is cut with |G|, which keeps them bounded here."""
    problem = problem_with(PRINTED_8_HOLDS)
    given_gains = problem.gains
    gains = gains_of_form(
        problem,
        "two_coordinates",
        given_gains["L"],
        given_gains["M"],
        {n: given_gains[n] for n in ("S", "S2")},
    )
    system = WidthSystem.from_gains(gains)
    np.testing.assert_allclose(system.N, [[2.6, 1.7], [3.4, 2.5]])
    assert max(abs(np.linalg.eigvals(system.N))) == pytest.approx(4.954683, abs=1e-6)
    observer = IntervalObserver(gains)
    model = observer.kernels.model
    flow = step_maps(model, 1.0, 0.0, is_periodic=False)["start"]
    jump = jump_maps(model, gains)[True]
    state = observer.init(0.0, lower=[0, 0], upper=[1, 1])
    radius, widths = np.array([0.5, 0.5]), []
    for k in range(1, 31):
        radius = jump.R @ (flow.R @ radius + flow.g) + jump.g
        widths.append(2 * radius)
        state, estimate = observer.step(state, Sample(float(k), jump=True))
        assert (estimate.upper - estimate.lower <= widths[-1] * (1 + 1e-12)).all()
        assert (estimate.upper - estimate.lower < 1.0).all()
    # from jump to jump by the radius of e^R N: what (8) holds to be below 1
    growth = spectral_radius(system.W, system.N, 1.0)
    assert growth == pytest.approx(4.2746, abs=1e-4)
    np.testing.assert_allclose(widths[29] / widths[28], growth, rtol=1e-9)
    np.testing.assert_allclose(widths[0], [3.7444, 5.1233], rtol=DIGITS)
    np.testing.assert_allclose(widths[9], [1.7767e6, 2.4535e6], rtol=DIGITS)
    np.testing.assert_allclose(widths[29], [7.37e18, 1.018e19], rtol=DIGITS)


def test_one_change_of_coordinates_holds_where_two_fail() -> None:
    gains = {"L": [[0], [0]], "M": [[0], [0]]}
    one = problem_with(PRINTED_8_HOLDS, observer__gains=gains | {"S": [[1, 0], [0, 1]]})
    design = obsdesign.design(one)
    system = WidthSystem.from_gains(IntervalGains.from_document(design.gains))
    assert spectral_radius(system.W, system.N, 1.0) == pytest.approx(0.944709, abs=1e-6)
    # and the two-coordinate observer needs dwell times twenty times as long
    for shortest, verdict in ((11.918, "proved"), (11.917, "refuted")):
        two = problem_with(PRINTED_8_HOLDS, jump__dwell_time=[shortest, shortest])
        assert obsdesign.investigate(two).verdict == verdict


@settings(max_examples=16, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_two_coordinates_are_never_narrower_than_one(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    p = int(rng.integers(1, n + 1))
    T, S2 = rng.random((n, n)), rng.standard_normal((n, n)) + 2 * np.eye(n)
    S, R = rng.standard_normal((n, n)) + 2 * np.eye(n), rng.random((n, n)) - 3 * np.eye(n)
    C, M = rng.standard_normal((p, n)), rng.standard_normal((n, p))
    A, G = S @ R @ np.linalg.inv(S), S2 @ T @ np.linalg.inv(S2) + M @ C
    body = {
        "flow": {"A": A, "disturbance": {"lower": -rng.random(n), "upper": rng.random(n)}},
        "jump": {"G": G, "dwell_time": [1, 1],
                 "disturbance": {"lower": -rng.random(n), "upper": rng.random(n)}},
        "output": {"C": C, "noise_bound": rng.random(p)},
        "observer": {"kind": "interval"},
    }  # fmt: skip
    problem = obsdesign.Problem(**body)
    L = np.zeros((n, p))
    one = WidthSystem.from_gains(gains_of_form(problem, "coordinates", L, M, {"S": S}))
    two = WidthSystem.from_gains(
        gains_of_form(problem, "two_coordinates", L, M, {"S": S, "S2": S2})
    )
    room = 1e-9 * np.abs(two.N).max()
    assert np.all(two.N + room >= one.N)
    assert np.all(one.h <= two.h + room)


# --- Example 4.2: the ball of the paper ---------------------------------------------------------

BALL: dict[str, Any] = {
    "flow": {"A": [[0, 1], [0, 0]]},
    "jump": {"G": [[1, 0], [0, -0.8]], "dwell_time": [1.05, 5]},
    "output": {"C": [[1, 0]], "noise_bound": [0]},
    "observer": {"kind": "interval", "gains": {"L": [[3], [2]], "M": [[0.1], [-0.5]]}},
}
S1 = [[-0.5, -0.5], [-0.5, -1.0]]  # eigenvectors of A - L C, as printed up to their lengths
S2 = [[0.386364, 0.386364], [0.613636, -0.386364]]
T = [[0.05, 0.85], [0.85, 0.05]]


def ball(dwell: list[float], **more: Any) -> obsdesign.Problem:
    gains = BALL["observer"]["gains"] | {"S": S1} | more
    return problem_with(BALL, observer__gains=gains, jump__dwell_time=dwell)


def test_the_printed_T_is_rejected_with_its_entry() -> None:
    printed = obsdesign.investigate(
        ball([1.05, 5], S2=[[0.5, 0], [0.5, 1]], T=[[-0.8, 0], [0, 0.9]])
    )
    claim = next(c for c in printed.claims if c.id == "jump_positive")
    assert claim.verdict == "refuted"
    assert claim.evidence["witness"]["reason"] == "T is not nonnegative: entry (1, 1) is -0.8"


def test_the_printed_R_serves_long_flights_without_end_and_no_short_ones() -> None:
    """The printed R decays, so no longest flight is needed; "all T_k > 0" is false."""
    for shortest, verdict in ((1.05, "proved"), (0.98, "refuted"), (0.0, "refuted")):
        outcome = obsdesign.investigate(ball([shortest, math.inf]))
        assert outcome.result["form"] == "coordinates"
        assert verdicts(outcome)["hurwitz"] == "proved"
        assert (outcome.verdict, verdicts(outcome)["dwell_stability"]) == (verdict, verdict)


def test_thresholds_of_the_bouncing_ball() -> None:
    gains = BALL["observer"]["gains"]
    one = WidthSystem.from_gains(
        gains_of_form(
            ball([1, 1]),
            "coordinates",
            np.array(gains["L"]),
            np.array(gains["M"]),
            {"S": np.array(S1)},
        )
    )
    np.testing.assert_allclose(one.W, np.diag([-2.0, -1.0]), atol=1e-12)
    assert spectral_radius(one.W, one.N, 0.0) == pytest.approx(3.916146, abs=1e-4)
    assert spectral_radius(one.W, one.N, 0.986839) == pytest.approx(1.0, abs=1e-4)
    problem = ball([1, 1], S2=S2)
    two = WidthSystem.from_gains(
        gains_of_form(
            problem,
            "two_coordinates",
            np.array(gains["L"], float),
            np.array(gains["M"]),
            {"S": np.array(S1), "S2": np.array(S2)},
        )
    )
    np.testing.assert_allclose(
        np.array(S2) @ T @ np.linalg.inv(S2), [[0.9, 0], [0.5, -0.8]], atol=1e-5
    )
    assert spectral_radius(two.W, two.N, 1.046921) == pytest.approx(1.0, abs=1e-3)


def test_no_range_down_to_zero_holds_for_the_ball_in_these_coordinates() -> None:
    assert obsdesign.investigate(ball([0, 5])).verdict == "refuted"
    assert obsdesign.investigate(ball([1.05, 5])).verdict == "proved"


# --- Example 4.1 in other coordinates -----------------------------------------------------------


def test_a_dead_beat_design_is_proved_for_all_dwell_times() -> None:
    design = obsdesign.design(problem_with(DEAD_BEAT))
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    # its twin, with the gain of the jump visibly off
    gains = DEAD_BEAT["observer"]["gains"] | {"M": [[5], [4]]}
    assert (
        obsdesign.investigate(problem_with(DEAD_BEAT, observer__gains=gains)).verdict == "refuted"
    )


def test_coordinates_are_found_when_none_are_given() -> None:
    gains = {"L": [[0], [1]], "M": [[5], [5]]}
    outcome = obsdesign.investigate(
        problem_with(DEAD_BEAT, observer__gains=gains, observer__form="auto")
    )
    assert (outcome.verdict, outcome.result["form"]) == ("proved", "coordinates")
    forms = outcome.result["forms"]
    assert {name: forms[name]["verdict"] for name in ("cooperative", "split")} == {
        "cooperative": "refuted", "split": "refuted",
    }  # fmt: skip
    assert obsdesign.verify(outcome.design).verdict == "proved"


@pytest.mark.parametrize("seed", range(3))
def test_the_state_stays_inside_in_other_coordinates(seed: int) -> None:
    from obsdesign.data.simulation import simulate

    design = obsdesign.design(problem_with(DEAD_BEAT, jump__dwell_time=[0.3, 1]))
    problem = obsdesign.Problem.from_dict(design.problem)
    record = simulate(problem.plant, until=12.0, step=0.02, initial=[1.0, 1.0],
                      disturbance=("extreme", "random", "sine")[seed],
                      rng=np.random.default_rng(seed))  # fmt: skip
    batch = from_design(design).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"], lower=[0.5, 0.5], upper=[1.5, 2]
    )
    x = record.block("x")
    assert np.all(batch.lower <= x)
    assert np.all(x <= batch.upper)
    assert set(batch.status) == {"ok"}
    assert (batch.upper - batch.lower)[-50:].max() < 6.0


# G - M C = [[2, -4], [1, -2]] is nilpotent: S2 turns it into T = [[0, 1], [0, 0]]
TWO_COORDINATES: dict[str, Any] = {
    **DEAD_BEAT,
    "observer": {
        "kind": "interval",
        "form": "two_coordinates",
        "gains": {**DEAD_BEAT["observer"]["gains"], "S2": [[2, 1], [1, 0]]},
    },
}


def test_observer_9_takes_the_noise_at_a_jump_into_its_bounds() -> None:
    """From a known state each sign of the noise reaches one end of the bounds after the jump."""
    problem = problem_with(TWO_COORDINATES, jump__dwell_time=[0.3, 1])
    plant = problem.plant
    assert plant.jump is not None
    design = obsdesign.design(problem, allow_undecided=True)
    assert design.gains["form"] == "two_coordinates"
    observer: Any = from_design(design)
    x, V, c = np.array([1.0, -2.0]), 0.03, np.array([0.3, 0.3])
    widths = []
    for v in (-V, 0.0, V):
        state = observer.init(t=0.0, lower=x.tolist(), upper=x.tolist())
        sample = Sample(t=0.0, y=plant.output.C @ x + v, jump=True)
        _, bounds = observer.step(state, sample)
        after = plant.jump.G @ x
        assert (bounds.lower <= after - c).all()
        assert (after + c <= bounds.upper).all()
        widths.append(bounds.upper - bounds.lower)
    S, S2, M = (np.array(design.gains[name]) for name in ("S", "S2", "M"))
    out = np.abs(S) @ np.abs(np.linalg.solve(S, S2))
    noise, disturbance = np.abs(np.linalg.solve(S2, M))[:, 0] * V, np.abs(np.linalg.inv(S2)) @ c
    recursion = 2 * out @ (noise + disturbance)
    jump = jump_maps(observer.kernels.model, observer.gains)[True]
    np.testing.assert_allclose(2 * np.abs(S) @ jump.g, recursion, rtol=1e-9)
    assert (np.array(widths) <= recursion * (1 + 1e-9)).all()  # cut with the jump of the plant


@pytest.mark.parametrize("disturbance", ["extreme", "random"])
def test_the_state_of_a_noisy_plant_stays_inside_in_two_coordinates(disturbance: str) -> None:
    from obsdesign.data.simulation import simulate

    body = copy.deepcopy(TWO_COORDINATES)
    for block in ("flow", "jump"):  # noise alone
        del body[block]["disturbance"]
    problem = problem_with(body, jump__dwell_time=[0.3, 1])
    rng = np.random.default_rng(5)
    record = simulate(problem.plant, until=12.0, step=0.02, initial=[1.0, 1.0],
                      disturbance=disturbance, rng=rng)  # fmt: skip
    design = obsdesign.design(problem, allow_undecided=True)
    batch = from_design(design).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"], lower=[1.0, 1.0], upper=[1.0, 1.0]
    )
    x = record.block("x")
    assert set(batch.status) == {"ok"}
    assert (batch.lower <= x).all()
    assert (x <= batch.upper).all()


# --- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gains", "form", "message"),
    [
        (
            {"S": [[1, 2], [2, 4]]},
            "coordinates",
            "observer.gains.S must be invertible; in floating point its rank is 1, of 2.",
        ),
        (
            {"S": [[1, 0], [0, 1]]},
            "split",
            "observer.gains.S belongs to the forms coordinates and two_coordinates; got it with form 'split'.",
        ),
        (
            {"S": [[1, 0], [0, 1]]},
            "two_coordinates",
            "observer.gains.S2 is required by form 'two_coordinates'; it is missing. Give S and S2, "
            "or R and T, from which they are built.",
        ),
        (
            {"T": [[1, 0], [0, 1]]},
            "auto",
            "observer.gains.S is required by form 'two_coordinates'; it is missing. Give S and S2, "
            "or R and T, from which they are built.",
        ),
        (
            {"D0": [[-1, 0], [0, -1]]},
            "cooperative",
            "observer.gains.D0 belongs to the forms split and coordinates; got it with form 'cooperative'.",
        ),
    ],
)
def test_gains_that_do_not_fit_the_form(gains: Any, form: str, message: str) -> None:
    body = {"L": [[0], [1]], "M": [[5], [5]]} | gains
    with pytest.raises(obsdesign.InputError) as error:
        obsdesign.investigate(problem_with(DEAD_BEAT, observer__gains=body, observer__form=form))
    assert str(error.value) == message


def test_a_design_with_singular_coordinates_is_refuted() -> None:
    design = obsdesign.design(problem_with(DEAD_BEAT))
    from obsdesign.verification.interval.claims import claims

    gains = dict(design.gains) | {"S": np.array([[1.0, 1], [1, 1]])}
    problem = obsdesign.Problem.from_dict(
        {**design.problem, "observer": {**design.problem["observer"], "gains": {}}}
    )
    (claim,) = claims(problem, gains, {})
    assert claim.evidence["witness"]["reason"] == "gains.S is singular"
