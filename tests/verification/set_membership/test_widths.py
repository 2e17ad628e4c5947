"""Certified and least possible widths: numbers, laws, and what the observer does at run time."""

from __future__ import annotations

import copy
import functools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.document import Claim
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Sample
from obsdesign.verification.set_membership import claims as set_membership_claims
from obsdesign.workflow import Outcome, investigate
from tests.systems.feasible_set import Program
from tests.systems.nominal_patterns import body_of, silent_samples
from tests.systems.set_membership import cases, flow_integral


@functools.cache
def outcome_of(
    name: str, period: float | None, dwell: tuple[float, float] | None = None
) -> Outcome:  # fmt: skip
    return _investigated(body_of(name, period, None if dwell is None else list(dwell)))


def _investigated(body: dict[str, Any]) -> Outcome:
    outcome = investigate(Problem.from_dict(body))
    assert outcome.verdict == "proved"
    assert outcome.design is not None
    return outcome


def claim(outcome: Outcome, name: str) -> Claim:
    return next(one for one in outcome.claims if one.id == name)


def numbers(outcome: Outcome, key: str) -> Matrix:
    return np.array([row[key] for row in outcome.result["states"]], dtype=float)


@pytest.mark.parametrize("dwell", [None, (1.0, 1.0)])
def test_both_sides_meet_at_the_exact_width(dwell: tuple[float, float] | None) -> None:
    """Of an unstable plant, by linear programs over 41 rows without any innovation."""
    outcome = outcome_of("rand2_21", 0.1, dwell)
    program = Program(cases()["rand2_21"], pieces=8)
    for sample in silent_samples(0.1, 0 if dwell is None else 10, 41, 1):
        program.add(sample)
    exact = program.bounds()
    assert exact.inside is not None
    inside, outside = exact.inside[1] - exact.inside[0], exact.outside[1] - exact.outside[0]
    assert numbers(outcome, "width") == pytest.approx(outside, rel=1e-4)
    assert numbers(outcome, "best") == pytest.approx(inside, rel=1e-4)


def test_numbers_of_a_loop_that_is_sampled_at_jumps() -> None:
    outcome = outcome_of("sampled", None, (1.0, 1.0))
    assert numbers(outcome, "best") == pytest.approx([0.04, 0.1293, 0.04], abs=5e-5)
    assert (numbers(outcome, "ratio") < 1.001).all()
    assert numbers(outcome, "strip")[0] == 0.04


PATTERNS = [
    ("rand2_21", 0.1, 0, None), ("rand2_21", 0.1, 10, (1.0, 1.0)), ("crane", 0.1, 0, None),
    ("sampled", None, 1, (1.0, 1.0)), ("degue", 0.1, 4, (0.4, 2.0)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "period", "every", "dwell"), PATTERNS)
def test_the_observer_is_between_both(
    name: str, period: float | None, every: int, dwell: tuple[float, float] | None
) -> None:
    """Without innovation it is nowhere narrower than the least, nor wider than the certified."""
    outcome, case = outcome_of(name, period, dwell), cases()[name]
    assert outcome.design is not None
    observer = from_design(outcome.design)
    samples = silent_samples(period or 1.0, every, 120, len(case.C))
    state = observer.init(0.0, lower=-np.ones(case.n), upper=np.ones(case.n))
    rows = [np.subtract(e.upper, e.lower) for e in observer.run(state, samples)]
    largest = np.max(rows[-2 * max(every, 1) :], axis=0)
    assert (largest <= numbers(outcome, "width") * (1 + 1e-7)).all()
    assert (largest >= numbers(outcome, "best") * (1 - 1e-9)).all()


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_disturbances_never_make_it_wider(seed: int) -> None:
    outcome, case = outcome_of("rand2_21", 0.1), cases()["rand2_21"]
    assert outcome.design is not None
    rng = np.random.default_rng(seed)
    Phi, integral = flow_integral(case.A, 0.1)
    x, samples = np.zeros(2), []
    for k in range(60):
        samples.append(Sample(0.1 * k, case.C @ x + case.V * rng.choice([-1, 1], 1)))
        x = Phi @ x + integral @ (case.b[1] * rng.choice([-1, 1], 2))
    observer = from_design(outcome.design)
    state = observer.init(0.0, lower=-np.ones(2), upper=np.ones(2))
    rows = [np.subtract(e.upper, e.lower) for e in observer.run(state, samples)]
    assert (np.array(rows[30:]) <= numbers(outcome, "width") * (1 + 1e-7)).all()


def test_widths_scale_with_units_and_order_of_states() -> None:
    body = body_of("rand2_21", 0.1, window=16)
    units = np.array([1000.0, 0.03125])
    order = [1, 0]
    other = copy.deepcopy(body)
    A, C = np.array(body["flow"]["A"]), np.array(body["output"]["C"])
    other["flow"]["A"] = (A * units[:, None] / units)[np.ix_(order, order)].tolist()
    other["output"]["C"] = (C / units)[:, order].tolist()
    for end, values in body["flow"]["disturbance"].items():
        other["flow"]["disturbance"][end] = (np.array(values) * units)[order].tolist()
    before, after = _investigated(body), _investigated(other)
    for key in ("width", "best"):
        assert numbers(after, key) == pytest.approx((numbers(before, key) * units)[order], rel=1e-3)


def test_time_in_other_units_changes_nothing() -> None:
    body = body_of("rand2_21", 0.125, [1.0, 1.0], window=8)
    other = copy.deepcopy(body)
    slower = 64.0
    other["output"]["period"] *= slower
    other["jump"]["dwell_time"] = [slower, slower]
    other["flow"]["A"] = (np.array(body["flow"]["A"]) / slower).tolist()
    for end, values in body["flow"]["disturbance"].items():
        other["flow"]["disturbance"][end] = (np.array(values) / slower).tolist()
    before, after = _investigated(body), _investigated(other)
    for key in ("width", "best"):
        assert numbers(after, key) == pytest.approx(numbers(before, key), rel=1e-3)


@pytest.mark.parametrize("entry", ["noise", "disturbance"])
def test_larger_bounds_never_narrow(entry: str) -> None:
    body = body_of("rand2_21", 0.1, window=8)
    larger = copy.deepcopy(body)
    if entry == "noise":
        larger["output"]["noise_bound"] = [1.3 * v for v in body["output"]["noise_bound"]]
    else:
        box = larger["flow"]["disturbance"]
        larger["flow"]["disturbance"] = {k: [1.3 * v for v in box[k]] for k in box}
    before, after = _investigated(body), _investigated(larger)
    for key in ("width", "best"):
        assert (numbers(after, key) >= numbers(before, key) * (1 - 1e-3)).all()


def test_all_bounds_together_scale_the_widths() -> None:
    body = body_of("rand2_21", 0.1, window=8)
    larger = copy.deepcopy(body)
    larger["output"]["noise_bound"] = [2 * v for v in body["output"]["noise_bound"]]
    for end, values in body["flow"]["disturbance"].items():
        larger["flow"]["disturbance"][end] = [2 * v for v in values]
    before, after = _investigated(body), _investigated(larger)
    for key in ("width", "best"):
        assert numbers(after, key) == pytest.approx(2 * numbers(before, key), rel=1e-3)


@pytest.mark.parametrize("unit", [-1.0, 3.0])
def test_noise_off_zero_changes_no_width(unit: float) -> None:
    body = body_of("rand2_21", 0.1, window=8)
    shifted = copy.deepcopy(body)
    (v,) = body["output"]["noise_bound"]
    shifted["output"]["noise_bound"] = [[unit - v, unit + v]]
    assert numbers(_investigated(shifted), "width") == pytest.approx(
        numbers(_investigated(body), "width"), rel=1e-6
    )


def test_without_a_spacing_of_samples_no_width_is_claimed() -> None:
    body = body_of("degue", 0.1)
    body["output"] |= {"measured": "continuous"}
    del body["output"]["period"]
    outcome = _investigated(body)
    assert {one.id for one in outcome.claims} == {"consistent", "observable_window"}
    assert "spacing of the samples is not stated" in outcome.warnings[0]
    assert np.isnan(numbers(outcome, "width")).all()


def test_the_window_is_the_shortest_that_is_narrow() -> None:
    """The least possible width is met within ten percent; a shorter window misses it."""
    outcome = outcome_of("rand2_21", 0.1)
    assert outcome.design is not None
    assert outcome.design.gains["window"] == 16
    assert (numbers(outcome, "ratio") <= 1.1).all()
    shorter = _investigated(body_of("rand2_21", 0.1, window=8))
    assert (numbers(shorter, "ratio") > 1.1).any()


def test_the_design_proves_itself_without_a_solver() -> None:
    for name, period, _, dwell in PATTERNS:
        design = outcome_of(name, period, dwell).design
        assert design is not None
        again = obsdesign.verify(design)
        assert again.verdict == "proved"
        assert again.result["states"] == outcome_of(name, period, dwell).result["states"]


# y = x2, noise far below what rounding of the disturbances comes to
TINY: dict[str, Any] = {
    "flow": {"A": [[-1, 0.5], [0.3, -2]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
    "output": {"C": [[0, 1]], "noise_bound": [0.0], "measured": "periodic", "period": 0.1},
    "observer": {"kind": "set_membership", "window": 8},
}


@pytest.mark.parametrize("noise", [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [0.3, 1.0]])
def test_what_no_observer_can_guarantee_is_never_above_what_one_does(noise: list[float]) -> None:
    """Also where an output without noise stands before or after another one."""
    body = {
        "flow": {"A": [[0, 1], [0, 0]], "disturbance": {"lower": [-0.1] * 2, "upper": [0.1] * 2}},
        "output": {
            "C": [[1, 0], [0, 1]], "noise_bound": noise, "measured": "periodic", "period": 0.25,
        },
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    states = obsdesign.investigate(obsdesign.Problem.from_dict(body)).result["states"]
    for row in states:
        assert row["best"] is None or row["best"] <= row["width"]
    assert all(row["ratio"] is None or row["best"] > 0 for row in states)
    if noise == [0.3, 1.0]:
        assert all(row["best"] > 0 for row in states)


def test_one_state_without_noise_is_known_after_every_sample() -> None:
    body = {
        "flow": {"A": [[0.3]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "jump": {"G": [[0.7]], "dwell_time": [2, 6]},
        "output": {
            "C": [[0.88]], "noise_bound": [0.0], "measured": "periodic", "period": 1.0,
            "jump_measurement": "after",
        },
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    (row,) = obsdesign.investigate(obsdesign.Problem.from_dict(body)).result["states"]
    assert row["width"] < 1e-6
    assert not row["best"]


@pytest.mark.parametrize("noise", [1e-9, 1e-12, 1e-14])
def test_noise_far_below_the_disturbances_keeps_both_widths(noise: float) -> None:
    """A measured state is known to its strip, the other one as without noise."""
    body = copy.deepcopy(TINY)
    body["output"]["noise_bound"] = [noise]
    outcome = _investigated(body)
    assert numbers(outcome, "width")[1] == pytest.approx(2 * noise, rel=1e-3)
    assert numbers(outcome, "best")[1] == pytest.approx(2 * noise, rel=1e-2)
    silent = numbers(_investigated(TINY), "width")
    assert numbers(outcome, "width")[0] == pytest.approx(silent[0], rel=1e-3)
    assert (numbers(outcome, "ratio") < 1.02).all()
    assert silent[1] < 1e-9 * silent[0]


def test_a_tube_of_rounding_alone_is_proved() -> None:
    """Both outputs are about the one state; in floats the sums of its tube come out too low."""
    body = {
        "flow": {"A": [[-0.397]], "disturbance": {"lower": [-0.09], "upper": [0.09]}},
        "jump": {"G": [[0.91]], "disturbance": {"lower": [-0.05], "upper": [0.05]},
                 "dwell_time": [0.3, "inf"]},
        "output": {"C": [[-2.32], [0.43]], "noise_bound": [2.032880371331315e-14, 0.05],
                   "measured": "periodic", "period": 0.1, "jump_measurement": "after"},
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    width = numbers(_investigated(body), "width")
    assert width == pytest.approx([2 * 2.032880371331315e-14 / 2.32], rel=0.05)


@pytest.mark.parametrize(
    ("noise", "b", "c", "period"),
    [
        ([0.0, 0.245], 3219.6, 3.3e7, 0.25),  # nothing, known exactly
        ([0.354, 1.6e-3], 11811.9, 0.066, 1.0),  # the first horizon shows no width at all
    ],
)
def test_an_output_of_nothing_changes_no_width(
    noise: list[float], b: float, c: float, period: float
) -> None:
    body = {
        "flow": {"A": [[0.779]], "disturbance": {"lower": [-b], "upper": [b]}},
        "jump": {"G": [[1.0]], "dwell_time": [3 * period, "inf"],
                 "disturbance": {"lower": [-c], "upper": [c]}},
        "output": {"C": [[0.0], [-1.91]], "noise_bound": noise, "measured": "periodic",
                   "period": period},
        "observer": {"kind": "set_membership"},
    }  # fmt: skip
    both = copy.deepcopy(body)
    both["output"] |= {"C": [[-1.91]], "noise_bound": noise[1:]}
    for key in ("width", "best"):
        alone = numbers(_investigated(both), key)
        assert numbers(_investigated(body), key) == pytest.approx(alone, rel=1e-6)


@pytest.mark.parametrize(
    ("dwell", "words"),
    [
        ([0.5, "inf"], "a sample every 0.5 and a jump every 1,"),
        ([0.3, 1.0], "a sample every 0.5 and a jump every 1,"),
        ([1.5, 2.0], "a sample every 0.5 and a jump every 1.5,"),
    ],
)
def test_a_pattern_has_samples_where_jumps_hide_them(dwell: list[Any], words: str) -> None:
    body = body_of("degue", 0.5, dwell, window=8)
    body["output"]["jump_measurement"] = "none"
    assert words in claim(_investigated(body), "width").statement


@pytest.mark.parametrize(
    ("noise", "b", "sentence"),
    [
        ([0.0, 0.0], [0.1, 0.1], None),
        ([0.0, 1.0], [0.0, 0.1], "No observer can guarantee widths of x2 below (0."),
        ([0.3, 1.0], [0.1, 0.1], "No observer can guarantee widths below (0."),
    ],
)
def test_a_least_width_of_zero_has_no_ratio(
    noise: list[float], b: list[float], sentence: str | None
) -> None:
    body = copy.deepcopy(TINY)
    body["output"] |= {"C": [[1, 0], [0, 1]], "noise_bound": noise}
    body["flow"] = {"A": [[-1, 0], [0, -2]], "disturbance": {"lower": [-x for x in b], "upper": b}}
    design = _investigated(body).design
    assert design is not None
    stated = [one.statement for one in design.guarantees if "No observer" in one.statement]
    assert len(stated) == (sentence is not None)
    for text in stated:
        assert sentence is not None
        assert text.startswith(sentence)
    assert not any("-," in one.statement or "(-" in one.statement for one in design.guarantees)


@pytest.mark.parametrize("excess", [0.5, 0.0])
def test_two_proofs_that_contradict_each_other_prove_nothing(
    monkeypatch: pytest.MonkeyPatch, excess: float
) -> None:
    """A forged least width above the certified one of x2; the twin below it is believed."""
    problem = Problem.from_dict(body_of("rand2_21", 0.1, window=8))
    honest = set_membership_claims.optimal_claims

    def forged(*args: Any) -> tuple[Claim, ...]:
        (least,) = honest(*args)
        above = args[-1].evidence["always"][1] + excess
        evidence = {**least.evidence, "least": [least.evidence["least"][0], above]}
        return (replace(least, evidence=evidence),)

    monkeypatch.setattr(set_membership_claims, "optimal_claims", forged)
    outcome = investigate(problem)
    if not excess:
        assert outcome.verdict == "proved"
        return
    assert outcome.verdict == "undecided"
    for name in ("width", "optimal"):
        assert claim(outcome, name).verdict == "undecided"
        reason = claim(outcome, name).evidence["reason"]
        assert reason.startswith("two proofs contradict each other: the least possible width of x2")
    assert all(row["width"] is row["best"] is row["ratio"] is None
               for row in outcome.result["states"])  # fmt: skip
