"""Gains that are found: as good as the theory allows, proved afterwards, refused with the reason."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import obsdesign
from lmi.time_budget import UNLIMITED
from obsdesign.equations.interval.gains import IntervalGains
from obsdesign.equations.interval.width import WidthSystem, periodic_width
from obsdesign.runtime import from_design
from obsdesign.synthesis.interval.descent import best_gains
from obsdesign.synthesis.interval.goals import growth, mean_width, shortest
from obsdesign.synthesis.interval.linear_program import clock_gains
from obsdesign.synthesis.interval.task import Task
from obsdesign.verification.answers import reason

EXAMPLES = Path(__file__).parents[3] / "examples"


def open_example(name: str, **options: Any) -> obsdesign.Problem:
    """An example with the gains taken out; dwell_time and options replaced."""
    body = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()
    body["jump"]["dwell_time"] = options.pop("dwell_time")
    body["observer"] = {"kind": "interval"} | options
    return obsdesign.Problem.from_dict(body)


def mean_of(design: obsdesign.Design, theta: float) -> float:
    system = WidthSystem.from_gains(IntervalGains.from_document(design.gains))
    mean = periodic_width(system.W, system.N, system.f, system.h, theta)[2]
    return float((system.out @ mean).sum())


# --- example 4.1 --------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["cooperative", "split", "auto"])
def test_the_narrowest_gains_of_41(form: str) -> None:
    problem = open_example(
        "degue_4_1", dwell_time=[5, 5], objective="narrowest", gain_limit=20, form=form
    )
    design = obsdesign.design(problem)
    # 0.4620724 is the optimum among constant gains in these coordinates; the paper's have 0.64082
    assert 0.4620 <= mean_of(design, 5.0) <= 0.4625
    assert np.abs(design.gains["L"]).max() <= 20
    assert obsdesign.verify(design, paranoid=True).verdict == "proved"
    evidence = next(c for c in design.claims if c.id == "width").evidence
    assert sum(evidence["constant_dwell"][0]["mean"]) == pytest.approx(
        mean_of(design, 5.0), rel=1e-9
    )


@pytest.mark.parametrize(("limit", "mean"), [(5, 0.5232), (1, 0.6524)])
def test_a_smaller_limit_gives_wider_bounds(limit: float, mean: float) -> None:
    problem = open_example("degue_4_1", dwell_time=[5, 5], objective="narrowest", gain_limit=limit)
    design = obsdesign.design(problem)
    assert mean_of(design, 5.0) <= mean * 1.001
    assert max(np.abs(design.gains[name]).max() for name in ("L", "M")) <= limit


def test_the_shortest_dwell_time_of_41() -> None:
    problem = open_example(
        "degue_4_1", dwell_time=[1, "inf"], objective="shortest_dwell", form="split"
    )
    design = obsdesign.design(problem)
    low, high = map(float, design.gains["dwell_time"])
    assert math.log(2) < low <= 0.70  # ln 2 itself is not attained in these coordinates
    assert high == math.inf
    assert design.problem["jump"]["dwell_time"] == [1.0, "inf"]
    assert obsdesign.verify(design).verdict == "proved"
    assert f"[{low!r}, inf)" in design.guarantees[1].statement
    observer = from_design(design)  # the guard is that of the range found
    assert observer.init(0.0, lower=[0, 0], upper=[1, 1]).guard.shortest == low


def test_other_coordinates_allow_every_dwell_time() -> None:
    problem = open_example("degue_4_1", dwell_time=[1, "inf"], objective="shortest_dwell")
    design = obsdesign.design(problem)
    assert design.gains["form"] == "coordinates"
    assert list(design.gains["dwell_time"]) == [0.0, math.inf]
    assert obsdesign.verify(design).verdict == "proved"


def test_a_range_that_is_narrower_than_asked_is_refuted_by_verify() -> None:
    problem = open_example(
        "degue_4_1", dwell_time=[1, "inf"], objective="shortest_dwell", form="split"
    )
    design = obsdesign.design(problem)
    from obsdesign.verification.interval.claims import claims

    gains = dict(design.gains) | {"dwell_time": [1.5, math.inf]}
    (claim,) = claims(problem, gains, {})
    assert claim.evidence["witness"]["reason"].startswith("gains.dwell_time differs")


def test_no_form_in_the_plants_coordinates_goes_below_ln_2() -> None:
    for form in ("cooperative", "split"):
        outcome = obsdesign.investigate(
            open_example("degue_4_1", dwell_time=[0.6931, "inf"], form=form)
        )
        assert outcome.verdict == "refuted"
        claim = next(c for c in outcome.claims if c.id == "attainable")
        assert reason(claim).startswith(
            "in these coordinates no gain can touch column 1 of A - L C"
        )


# --- example 4.3 and others ---------------------------------------------------------------------


def test_the_shortest_dwell_time_of_43() -> None:
    problem = open_example(
        "degue_4_3", dwell_time=[1, "inf"], objective="shortest_dwell", form="split"
    )
    low = obsdesign.design(problem).gains["dwell_time"][0]
    assert math.log(2) / 2 < low <= 0.352


def test_the_narrowest_gains_of_43() -> None:
    problem = open_example(
        "degue_4_3", dwell_time=[5, 5], objective="narrowest", gain_limit=20, form="split"
    )
    assert mean_of(obsdesign.design(problem), 5.0) <= 0.1637 * 1.001


def test_a_gain_that_is_given_is_kept() -> None:
    L = [[0.0], [3.25]]
    problem = open_example("degue_4_1", dwell_time=[2, 5], objective="narrowest", gains={"L": L})
    design = obsdesign.design(problem)
    assert design.gains["L"].tolist() == L
    assert np.any(design.gains["M"])


def random_task(rng: np.random.Generator, n: int) -> Any:
    p = int(rng.integers(1, n + 1))
    body = {
        "flow": {"A": rng.standard_normal((n, n)) - 2 * np.eye(n),
                 "disturbance": {"lower": -rng.random(n), "upper": rng.random(n)}},
        "jump": {"G": rng.standard_normal((n, n)), "dwell_time": [0.5, 1.0],
                 "disturbance": {"lower": -rng.random(n), "upper": rng.random(n)}},
        "output": {"C": rng.standard_normal((p, n)), "noise_bound": 0.1 * rng.random(p),
                   "jump_measurement": str(rng.choice(["before", "after"]))},
        "observer": {"kind": "interval", "gain_limit": 10.0, "objective": "narrowest"},
    }  # fmt: skip
    return obsdesign.Problem(**body)


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3))
def test_what_is_found_is_never_worse_than_no_gain(seed: int, n: int) -> None:
    problem = random_task(np.random.default_rng(seed), n)
    task = Task.from_problem(problem, False, None, {})
    (value, L, M), _ = best_gains(task, "narrowest", UNLIMITED)
    zero = np.zeros_like(L)
    assert value <= mean_width(task, zero, zero) * (1 + 1e-6)
    assert max(np.abs(gain).max() for gain in task.gains(L, M)) <= 10.0
    assert np.isinf(value) or growth(task, L, M) < 1


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3))
def test_the_task_measures_what_the_finished_gains_do(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    problem = random_task(rng, n)
    S = rng.standard_normal((n, n)) + 2 * np.eye(n)
    task = Task.from_problem(problem, False, S, {})
    L, M = rng.standard_normal((2, *task.limit_L.shape))
    from obsdesign.synthesis.interval.forms import gains_of_form

    system = WidthSystem.from_gains(
        gains_of_form(problem, "coordinates", *task.gains(L, M), {"S": S})
    )
    rough = task.system(L, M)
    np.testing.assert_allclose(rough.W * task.pace, system.W, atol=1e-9)
    np.testing.assert_allclose(rough.N, system.N, atol=1e-9)
    np.testing.assert_allclose(rough.f * task.pace, system.f, atol=1e-9)


def test_the_program_certifies_what_it_finds() -> None:
    # a feasible program at T means that its clock-dependent gains contract from T on; constant
    # ones are read off it, and those of 4.1 contract as well
    task = Task.from_problem(open_example("degue_4_1", dwell_time=[0.75, "inf"]), False, None, {})
    gains = clock_gains(task, task.low, 24, False, UNLIMITED)
    assert gains is not None
    assert min(growth(task, L, M) for L, M in gains) < 1
    assert (
        clock_gains(task, 0.69 * task.pace, 24, False, UNLIMITED) is None
    )  # below ln 2 there is nothing


def test_shortest_is_where_the_radius_crosses_one() -> None:
    task = Task.from_problem(open_example("degue_4_1", dwell_time=[1, "inf"]), False, None, {})
    L, M = np.array([[0.0], [1]]), np.array([[1.0], [2.8]])
    L, M = task.inward(L, M)
    theta = shortest(task, L, M)
    assert theta / task.pace == pytest.approx(math.log(2), abs=1e-9)
    system = task.system(L, M)
    assert max(abs(np.linalg.eigvals(expm(system.W * theta) @ system.N))) == pytest.approx(1.0)


# --- infeasible, with the reason ----------------------------------------------------------------


def investigated(A: Any, G: Any, C: Any, dwell: Any, **observer: Any) -> obsdesign.Outcome:
    body = {"flow": {"A": A}, "jump": {"G": G, "dwell_time": dwell}, "output": {"C": C, "noise_bound": 0},
            "observer": {"kind": "interval"} | observer}  # fmt: skip
    return obsdesign.investigate(obsdesign.Problem.from_dict(body))


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        # x1 grows, unseen
        (([[1, 0], [0, -1]], [[1, 0], [0, 0.5]], [[0, 1]], [0.5, 1]),
         "no observer exists: no output ever shows the direction x1, along flow and jumps, which does not shrink: at dwell time 1.0"),
        (([[0, 0], [0, -1]], [[0.5, 0], [0, 0.5]], [[0, 1]], [0.5, "inf"]),
         "no observer exists: no output shows the direction x1, where a mode of flow.A does not decay, and there is no longest dwell time"),
    ],
)  # fmt: skip
def test_a_plant_without_any_observer_is_refused(plant: Any, words: str) -> None:
    outcome = investigated(*plant)
    assert outcome.verdict == "refuted"
    assert reason(next(c for c in outcome.claims if c.id == "attainable")).startswith(words)


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (([[-2, 0], [-4, -3]], [[2, 0], [1, 0.2]], [[0, 1]], [5, 5]),
         "entry (2, 1) of A - L C is -4, and no gain can touch it"),
        (([[-2, 0], [4, -3]], [[-2, 0], [1, 0.2]], [[0, 1]], [5, 5]),
         "entry (1, 1) of the jump matrix of the error is -2, and no gain can touch it"),
        (([[-2, -1, -1], [1, -3, 0], [0, 0, -3]], np.diag([0.2, 0.1, 0.1]).tolist(), [[0, 1, -1]], [0.5, 1]),
         "entries (1, 2), (1, 3) of A - L C cannot all be made nonnegative: a positive combination of them that no gain can touch is negative"),
    ],
)  # fmt: skip
def test_a_sign_that_no_gain_can_mend_is_named(plant: Any, words: str) -> None:
    outcome = investigated(*plant, form="cooperative")
    assert outcome.verdict == "refuted"
    assert reason(next(c for c in outcome.claims if c.id == "attainable")) == words
    # the same plant is no obstacle to the split form
    assert investigated(*plant, form="split").verdict == "proved"


def test_a_failed_search_is_undecided() -> None:
    # observable, and nothing forbids gains as far as we can see: no answer is not a no
    body = open_example(
        "degue_4_1", dwell_time=[0.70, "inf"], form="split", gain_limit=0.01
    ).to_dict()
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "undecided"
    claim = next(c for c in outcome.claims if c.id == "dwell_stability")
    assert reason(claim).startswith("no gains or options that the problem leaves open")


def test_an_obstruction_is_told_again_by_verify() -> None:
    problem = open_example("degue_4_1", dwell_time=[0.75, "inf"], form="split")
    design = obsdesign.design(problem)
    body = copy.deepcopy(dict(design.problem))
    body["jump"]["dwell_time"] = [0.5, "inf"]
    from obsdesign.verification.interval.claims import claims

    gains = dict(design.gains) | {"dwell_time": [0.5, math.inf]}
    again = claims(obsdesign.Problem.from_dict(body), gains, {})
    assert next(c for c in again if c.id == "attainable").verdict == "refuted"


def test_entries_whose_cubes_overflow_leave_the_question_open() -> None:
    huge = obsdesign.Problem.from_dict({
        "flow": {"A": [[-1e150, 1e150], [1e150, -1e150]]},
        "jump": {"dwell_time": [0.5, 2]},
        "output": {"C": [[1, 0]], "noise_bound": 0},
        "observer": {"kind": "interval"},
    })  # fmt: skip
    assert obsdesign.investigate(huge).verdict == "undecided"


@pytest.mark.parametrize("measured", ["continuous", "periodic"])
def test_a_hidden_oscillation_that_never_decays_is_refused(measured: str) -> None:
    def body(damping: float) -> Any:
        output: dict[str, Any] = {"C": [[0, 0, 1]], "noise_bound": 0, "measured": measured}
        if measured == "periodic":
            output["period"] = 0.1
        return obsdesign.Problem.from_dict({
            "flow": {"A": [[-damping, 1, 0], [-1, -damping, 0], [0, 0, -1]],
                     "disturbance": {"lower": [-0.1] * 3, "upper": [0.1] * 3}},
            "jump": {"G": [[1, 0, 0], [0, 1, 0], [0, 0, 2]], "dwell_time": [0.5, 2]},
            "output": output, "observer": {"kind": "interval", "form": "split"},
        })  # fmt: skip

    outcome = obsdesign.investigate(body(0.0))
    refused = next(c for c in outcome.claims if c.id == "attainable")
    assert refused.verdict == "refuted"
    assert "no observer exists" in refused.evidence["witness"]["reason"]
    damped = obsdesign.investigate(body(0.1))
    assert all("no observer exists" not in str(c.evidence) for c in damped.claims)


def narrowest(seed: int | None, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """(mean width, width before jumps), at the one dwell time, of the narrowest split design."""
    A, G = [[-1.0, 0.0], [1.0, -2.0]], [[2.0, 1.0], [1.0, 3.0]]
    C: Any = [[0.0, 1.0]]
    if seed is not None:
        rng = np.random.default_rng(seed)
        A = rng.standard_normal((3, 3)) - 3 * np.eye(3)
        G, C = 0.7 * rng.standard_normal((3, 3)), rng.standard_normal((2, 3))
    n, p = len(A), len(C)
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict({
        "flow": {"A": np.array(A).tolist(), "disturbance": {"lower": [-0.1] * n, "upper": [0.1] * n}},
        "jump": {"G": np.array(G).tolist(), "dwell_time": [1.5, 1.5],
                 "disturbance": {"lower": [-0.3] * n, "upper": [0.3] * n}},
        "output": {"C": np.array(C).tolist(), "noise_bound": [0.03] * p},
        "observer": {"kind": "interval", "form": "split", "objective": "narrowest",
                     "gain_limit": 10, **options},
    }))  # fmt: skip
    (row,) = next(c for c in outcome.claims if c.id == "width").evidence["constant_dwell"]
    return np.array(row["mean"]), np.array(row["before_jump"])


@pytest.mark.parametrize("seed", [None, 1])
def test_what_is_asked_to_be_narrow_is_no_wider_than_without(seed: int | None) -> None:
    mean, before = narrowest(seed)
    again, _ = narrowest(seed, width_weights=[4.0] * len(mean))
    assert np.array_equal(again, mean)
    weights = np.array([1e6, *[1.0] * (len(mean) - 1)])
    heavy, _ = narrowest(seed, width_weights=weights.tolist())
    assert weights @ heavy <= (weights @ mean) * (1 + 1e-5)
    assert heavy[0] <= mean[0] * (1 + 1e-5)
    other, earlier = narrowest(seed, width="pre_jump")
    assert earlier.sum() <= before.sum() * (1 + 1e-5)
    assert mean.sum() <= other.sum() * (1 + 1e-5)


def test_a_width_is_asked_for_where_something_is_made_narrow() -> None:
    with pytest.raises(obsdesign.InputError, match="needs observer"):
        narrowest(None, objective="feasible", width="mean")
    with pytest.raises(obsdesign.InputError, match="2 entries, one per state; got 3"):
        narrowest(None, width_weights=[1, 2, 3])
    with pytest.raises(obsdesign.InputError, match="must not all be zero"):
        narrowest(None, width_weights=[0, 0])


@pytest.mark.parametrize("measured", ["continuous", "periodic"])
def test_a_hopeless_plant_is_refused_before_any_search(
    measured: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def searched(*args: Any) -> None:
        raise AssertionError("gains were looked for")

    for name in ("best_gains", "CoordinateSearch", "sampled_bases"):
        monkeypatch.setattr(f"obsdesign.synthesis.interval.candidates.{name}", searched)
    body = hidden_oscillation(np.eye(3))
    body["output"] |= {"measured": measured} | ({"period": 0.1} if measured != "continuous" else {})
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "refuted"
    forms = outcome.result["forms"]
    for form in ("cooperative", "split", "coordinates"):
        assert "no observer exists" in str(forms[form]["reasons"])
    body["flow"]["A"][2][0] = 1.0  # now the output sees it
    with pytest.raises(AssertionError, match="looked for"):
        obsdesign.investigate(obsdesign.Problem.from_dict(body))


def hidden_oscillation(S: Any) -> Any:
    """An oscillation that no output sees, beside a state that one does; in coordinates S."""
    A = S @ [[0, 1, 0], [-1, 0, 0], [0, 0, -1]] @ np.linalg.inv(S)
    C = [[0, 0, 1]] @ np.linalg.inv(S)
    return {
        "flow": {"A": A.tolist(), "disturbance": {"lower": [-0.1] * 3, "upper": [0.1] * 3}},
        "jump": {"G": np.eye(3).tolist(), "dwell_time": [0.5, 2]},
        "output": {"C": C.tolist(), "noise_bound": 0},
        "observer": {"kind": "interval"},
    }


def test_a_mode_that_is_hidden_but_for_rounding_is_told() -> None:
    body = hidden_oscillation(np.array([[1, 2, 0], [0, 1, 1], [1, 0, 1.0]]))
    body["observer"]["form"] = "split"
    outcome = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert outcome.verdict == "undecided"
    reasons = [reason(c) for c in outcome.claims if c.id == "dwell_stability"]
    assert "flow.A has a mode (0+-1i) that does not decay and is unobservable" in reasons[0]
    body["output"]["C"] = [[1, 0, 0]]
    measured = obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert all("unobservable" not in reason(c) for c in measured.claims)
