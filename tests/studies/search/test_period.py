"""Longest period and shortest window of condition (13): brackets, traps, extensions."""

from __future__ import annotations

import copy
import json
import math
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import precision
from lmi.arithmetic.norms import float_below
from lmi.time_budget import UNLIMITED, TimeBudget
from obsdesign.analysis.finite_time.enclosed_gains import Sampled
from obsdesign.design_file import from_dict
from obsdesign.document import digest
from obsdesign.equations.finite_time.condition_13 import approx_log_longest_period
from obsdesign.studies.search import period as period_search
from obsdesign.studies.search.search import search
from obsdesign.synthesis.finite_time.injection import EFFORT, best_injection
from obsdesign.synthesis.finite_time.period_problem import PeriodProblem
from obsdesign.verification.finite_time.theorem_1 import Norms
from tests.cli.test_commands import ROOT, command
from tests.verification.finite_time.test_claims import ROTATION, L, sampled_problem

CHAIN = [[0, 1], [0, 0]]
A, C = np.array(ROTATION), np.array([[0.3, 0.0]])


def search_result(what: str = "longest_period", **changes: Any) -> dict[str, Any]:
    """The result of a search, which several tests may look at."""
    return copy.deepcopy(_result(what, json.dumps(changes)))


@cache
def _result(what: str, changes: str) -> dict[str, Any]:
    return fresh_result(what, **json.loads(changes))


def fresh_result(what: str = "longest_period", **changes: Any) -> dict[str, Any]:
    outcome = search(sampled_problem(**changes), what)
    assert outcome.verdict == "proved"
    return dict(outcome.result)


# --- the illustration: at least what is known ---------------------------------------------------


def test_given_window_and_gain() -> None:
    result = search_result(window=6, gains={"L": L})
    assert result["proved"] == pytest.approx(0.0515755343, rel=1e-9)
    assert result["proved"] < result["not_proved"] < result["proved"] * (1 + 1e-11)
    assert result["not_proved_verdict"] == "refuted"
    assert (result["samples"], result["admissible"]) == (117, 6 / 117)


def test_more_samples_than_a_design_holds_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(period_search, "MOST_SAMPLES", 116)
    remarks = fresh_result(window=6, gains={"L": L})["remarks"]
    assert any("117 samples in a window are more than" in text for text in remarks)
    monkeypatch.setattr(period_search, "MOST_SAMPLES", 117)  # the twin
    remarks = fresh_result(window=6, gains={"L": L}).get("remarks", [])
    assert not any("samples in a window" in text for text in remarks)


def test_given_gain() -> None:
    result = search_result(gains={"L": L})
    assert result["proved"] >= 0.0526887 * (1 - 1e-7)
    assert result["window"] == pytest.approx(5.2416, abs=1e-3)
    assert result["not_proved_verdict"] == "undecided"


def test_given_window() -> None:
    result = search_result(window=6)
    assert result["proved"] >= 0.0622
    # the limit for L -> 0 is never reached
    assert result["proved"] < 0.0623334890
    assert np.linalg.norm(np.array(result["gains"]["L"]) @ C) >= 1e-6 * 0.15


def test_nothing_given() -> None:
    result = search_result()
    assert 0.06257 < result["proved"] < 0.0625794167 * (1 + 1e-9)
    assert result["window"] == pytest.approx(5.66, abs=0.01)


@pytest.mark.parametrize(
    ("gains", "k", "window", "least"),
    [({}, 90, 5.6315, 0.062572), ({"gains": {"L": L}}, 99, 5.215, 0.0526768)],
)
def test_an_open_window_is_a_whole_number_of_the_longest_periods(
    gains: dict[str, Any], k: int, window: float, least: float
) -> None:
    result = search_result(**gains)
    assert result["samples"] == k
    assert result["admissible_window"] == pytest.approx(window, abs=2e-3)
    assert least * (1 - 1e-5) <= result["admissible"] < result["proved"]
    assert result["admissible_window"] == k * result["admissible"]
    gain = np.array(result["gains"]["L"])
    with precision(160):
        for factor, holds in ((1.0, True), (1 + 1e-9, False)):
            period = result["admissible"] * factor
            sizes = Norms.from_sampled(Sampled.from_plant(A, C, period, k), gain)
            assert sizes is not None
            assert sizes.condition(period) == ("proved" if holds else "refuted")
    design = obsdesign.design(
        sampled_problem(
            period=result["admissible"], window=result["admissible_window"], method="exact",
            gains={"L": gain},
        )
    )  # fmt: skip
    assert {c.id: c.evidence for c in design.claims}["theorem_1_numbers"]["condition_13"] == "true"


def test_feasible_windows_at_the_printed_gain() -> None:
    result = search_result("shortest_window", gains={"L": L})
    assert (result["proved"], result["not_proved"]) == (pytest.approx(4.2), pytest.approx(4.15))
    assert (result["samples"], result["not_proved_verdict"]) == (84, "refuted")
    with precision(160):
        for k, holds in ((83, False), (84, True), (129, True), (130, False)):
            sizes = Norms.from_sampled(Sampled.from_plant(A, C, 0.05, k), L)
            assert sizes is not None
            assert sizes.condition(0.05) == ("proved" if holds else "refuted")


def test_the_admissible_design_has_theorem_1() -> None:
    result = search_result(window=6, gains={"L": L})
    design = obsdesign.design(
        sampled_problem(period=result["admissible"], window=6, method="approximate", gains={"L": L})
    )
    entries = [entry for entry in design.guarantees if entry.statement.startswith("Theorem 1")]
    assert [entry.given for entry in entries] == [True]
    with precision(160):
        sizes = Norms.from_sampled(Sampled.from_plant(A, C, 6.0, 1), L)
        assert sizes is not None
        assert sizes.constants(result["admissible"]).second < 1
        assert float_below(sizes.constants(result["admissible"]).second) == pytest.approx(
            0.99420, abs=0.5e-5
        )


# --- traps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1e-3, 1e-9, 1e-16, 1e-100, 1e-300])
def test_a_small_gain_does_not_cancel(size: float) -> None:
    # by differences M_T is noise at 1e-16, and 0.82 seems possible; the supremum is 0.0623334890
    value = math.exp(approx_log_longest_period(A, C, size * np.array(L), 6.0))
    assert 0.062 < value < 0.0623334890


def test_large_exponents_do_not_overflow() -> None:
    chain, gain = 40.0 * np.array([[0, 1.0], [0, 0]]), np.array([[-2.0], [-1.0]])
    for window in (1.0, 10.0, 100.0):
        value = approx_log_longest_period(chain, np.array([[1.0, 0]]), gain, window)
        assert not math.isnan(value)
        assert value < 0
        with precision(160):
            sizes = Norms.from_sampled(
                Sampled.from_plant(chain, np.array([[1.0, 0]]), window, 1), gain
            )
            assert sizes is not None
            assert sizes.condition(1e-3) == "refuted"
            ball = sizes.longest_period()
            assert ball > 0
            assert math.isinf(value) or float(ball.log().mid()) == pytest.approx(value, rel=1e-6)


def test_a_period_is_never_longer_than_its_window() -> None:
    # one state: as T -> 0 (13) alone would allow periods beyond T
    result = search_result(A=[[-1]], C=[[2]], period=0.1)
    assert result["proved"] <= result["window"]
    assert result["admissible"] == result["admissible_window"] / result["samples"]
    assert result["samples"] == 1
    assert result["admissible"] == pytest.approx(result["proved"], rel=1e-9)
    tiny = search_result(A=[[-1]], C=[[2]], period=0.1, window=1e-9, gains={"L": [[0.5]]})
    assert tiny["proved"] == 1e-9
    assert tiny["not_proved"] is None


def test_enough_samples_for_the_state() -> None:
    # A = 0 leaves nothing to (13); the window has to hold one sample (C square) or cannot
    result = search_result(A=[[0, 0], [0, 0]], C=[[1, 0], [0, 1]], window=3, period=1)
    assert (result["proved"], result["not_proved"], result["samples"]) == (3.0, None, 1)


def test_unobservable_plants_have_no_period() -> None:
    outcome = search(sampled_problem([[-1, 0], [0, -2]], [[1, 0]], window=1), "longest_period")
    assert (outcome.verdict, outcome.result["proved"]) == ("refuted", None)
    assert outcome.claims[0].id == "observable"


@pytest.mark.parametrize("what", ["longest_period", "shortest_window"])
def test_no_gain_is_no_period(what: str) -> None:
    outcome = search(sampled_problem(window=6, gains={"L": [[0], [0]]}), what)
    assert outcome.verdict != "proved"
    assert outcome.result["proved"] is None


def test_a_period_that_is_too_long_has_no_window() -> None:
    outcome = search(sampled_problem(period=1.0, gains={"L": L}), "shortest_window")
    assert outcome.verdict == "undecided"
    assert outcome.result["reason"] == "(13) holds for no window with period 1.0"


# --- laws -----------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 4))
def test_floats_and_balls_agree(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    plant, output = rng.standard_normal((n, n)), rng.standard_normal((1, n))
    gain, window = rng.standard_normal((n, 1)), float(rng.uniform(0.1, 2.0))
    value = approx_log_longest_period(plant, output, gain, window)
    with precision(160):
        sizes = Norms.from_sampled(Sampled.from_plant(plant, output, window, 1), gain)
        assert sizes is not None
        # floats lose the digits that the condition of M_T costs
        lost = 1e-16 * float((sizes.a * sizes.m * sizes.size_LC).mid())
        assert float(sizes.longest_period().log().mid()) == pytest.approx(value, abs=1e-6 + lost)
        longest = float(sizes.longest_period().mid())
        assert sizes.condition(longest * (1 - 1e-6)) == "proved"
        assert sizes.condition(longest * (1 + 1e-6)) == "refuted"


def test_freedom_never_hurts_and_units_do_not_matter() -> None:
    plant, output = np.array([[0.0, 1], [-1, -0.3]]), np.array([[1.0, 0.2]])
    fixed = best_injection(PeriodProblem(plant, output, 0.5, np.array([[0.3], [-0.1]])), UNLIMITED)
    free = best_injection(PeriodProblem(plant, output, 0.5), UNLIMITED)
    freest = best_injection(PeriodProblem(plant, output), UNLIMITED)
    assert fixed.log_period <= free.log_period + 1e-9
    assert free.log_period <= freest.log_period + 1e-6
    # C -> c C, L -> L / c changes nothing; time t -> t / 8 divides the period by 8
    scaled = approx_log_longest_period(plant, 8 * output, free.L / 8, 0.5)
    assert scaled == pytest.approx(free.log_period, abs=1e-9)
    faster = approx_log_longest_period(8 * plant, output, 8 * free.L, 0.5 / 8)
    assert faster == pytest.approx(free.log_period - math.log(8), abs=1e-9)


def test_the_program_against_true_norms() -> None:
    from obsdesign.synthesis.finite_time.period_program import PeriodProgram

    program = PeriodProgram(PeriodProblem(A, C))
    reached = []
    for start in program.starts(4):
        point = program.solve(start)
        true = math.exp(approx_log_longest_period(A, C, point.L, point.window))
        assert point.period <= true * (1 + 1e-6)  # smooth norms are above the true ones
        reached.append(true)
    assert max(reached) > 0.0618


def test_coordinates_are_part_of_the_program() -> None:
    from obsdesign.synthesis.finite_time.period_program import PeriodProgram

    chain, output = np.array([[0.0, 1], [0, 0]]), np.array([[1.0, 0]])
    program = PeriodProgram(PeriodProblem(chain, output, coordinates=True))
    plain = best_injection(PeriodProblem(chain, output), UNLIMITED).log_period
    best = -math.inf
    for start in program.starts(6):
        point = program.solve(start)
        assert point.S is not None
        S, back = point.S, np.linalg.inv(point.S)
        value = approx_log_longest_period(
            S @ chain @ back, output @ back, S @ point.L, point.window
        )
        best = max(best, value)
    assert best > plain  # here S helps; in the paper's example A is skew and S = I is best


def test_from_the_command_line(tmp_path: Path) -> None:
    file = ROOT / "examples" / "mazenc_4.toml"
    done = command("search", file, "--for", "longest_period", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    reply = json.loads(done.stdout)
    assert (reply["command"], reply["verdict"], reply["kind"]) == (
        "search",
        "proved",
        "finite_time",
    )
    assert reply["result"]["admissible"] == pytest.approx(6 / 117)
    done = command("search", file, "--for", "shortest_dwell", cwd=tmp_path)
    assert done.returncode == 2
    assert "--for shortest_dwell is not available for kind 'finite_time'" in done.stderr


def test_a_period_without_a_window_has_a_reason() -> None:
    outcome = search(
        sampled_problem([[0, 40], [0, 0]], [[1, 0]], window=10, gains={"L": [[-2], [-1]]}),
        "longest_period",
    )
    assert outcome.verdict == "undecided"
    assert outcome.result["reason"].endswith("only: too many samples")


def test_coordinates_that_allow_longer_periods() -> None:
    # with the printed L, A + L C is not skew
    result = search_result(window=6, gains={"L": L})
    extension = result["coordinates"]
    assert np.array_equal(extension["L"], result["gains"]["L"])
    assert extension["proved"] > 1.08 * result["proved"]
    S, back = np.array(extension["S"]), np.linalg.inv(extension["S"])
    value = approx_log_longest_period(S @ A @ back, C @ back, S @ extension["L"], 6.0)
    assert math.exp(value) == pytest.approx(extension["proved"], rel=1e-6)
    # A of the paper's example is skew: nothing is gained
    assert "coordinates" not in search_result(window=6)


def test_a_design_proves_theorem_1_in_coordinates_of_its_certificate() -> None:
    design = obsdesign.design(
        sampled_problem(CHAIN, [[1, 0]], period=1e-4, window=0.01, method="exact",
                objective="longest_period")
    )  # fmt: skip
    claims = {claim.id: claim for claim in design.claims}
    assert claims["theorem_1_numbers"].evidence["condition_13"] == "false"
    assert claims["theorem_1_coordinates"].evidence["condition_13"] == "true"
    entries = [entry for entry in design.guarantees if "coordinates S x" in entry.statement]
    assert [entry.given for entry in entries] == [True]
    assert obsdesign.verify(from_dict(design.to_dict())).verdict == "proved"
    # the twins: coordinates in which nothing is proved, and none
    for S in (np.eye(2).tolist(), [[1.0]]):
        body = design.to_dict()
        for claim in body["claims"]:
            if claim["id"] == "theorem_1_coordinates":
                claim["evidence"]["S"] = S
        body["digest"] = digest({name: x for name, x in body.items() if name != "digest"})
        assert obsdesign.verify(from_dict(body)).verdict == "refuted"


def test_a_search_ends_with_the_total() -> None:
    rng = np.random.default_rng(0)
    problem = PeriodProblem(
        rng.standard_normal((5, 5)), rng.standard_normal((2, 5)), coordinates=True
    )
    started = time.process_time()
    effort = EFFORT.times(100)
    best = best_injection(problem, TimeBudget.from_seconds(0.1), effort=effort)
    assert math.isfinite(best.log_period)
    assert best.remarks[0].evidence == {"ended_by": "time", "seconds": 0.1}
    assert time.process_time() - started < 2.0


def test_windows_of_least_noise() -> None:
    noisy = obsdesign.design(sampled_problem(objective="least_noise")).gains
    default = obsdesign.design(sampled_problem()).gains
    assert noisy["samples"] > default["samples"]
    assert np.linalg.norm(noisy["window_gain"]) < np.linalg.norm(default["window_gain"])
    # what a disturbance does grows with the window: the shortest that is nearly best
    bounded: dict[str, Any] = {
        "flow": {"disturbance": {"lower": [-1, -1], "upper": [1, 1]}},
        "output": {"noise_bound": [1.0]},
    }
    chosen = obsdesign.design(sampled_problem(objective="least_noise", **bounded)).gains
    assert chosen["samples"] < noisy["samples"]
    for count in (chosen["samples"] // 4, chosen["samples"] * 4):
        longer = obsdesign.design(sampled_problem(window=count * 0.05, **bounded)).gains
        assert (longer["radius"] > chosen["radius"]).any()
