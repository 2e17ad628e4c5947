"""Bounds of the noise that are not symmetric: the observer for their middle, on y less the middle."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import obsdesign
from obsdesign import InputError, Problem
from obsdesign.data.simulation import simulate
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.runtime.interval.fleet import Fleet
from tests.cli.test_commands import ROOT

PAIR, CENTRE, RADIUS = [-0.125, 0.375], 0.125, 0.25
KINDS = {
    "continuous": ("interval", "continuous", {}),
    "periodic": ("interval", "periodic", {}),
    "coordinates": ("interval", "continuous", {"form": "coordinates"}),
    "at_jumps": ("interval", "at_jumps", {}),
    "finite_time": ("finite_time", "periodic", {"window": 0.5}),
    "minimax": ("finite_time", "periodic", {"window": 0.5, "method": "minimax"}),
    "luenberger": ("luenberger", "continuous", {}),
    "impulsive": ("impulsive", "at_jumps", {}),
}


def problem(case: str, bound: Any) -> Problem:
    kind, measured, options = KINDS[case]
    period = {"period": 0.1} if measured == "periodic" else {}
    return Problem.from_dict({
        "flow": {"A": [[-1, 0.5], [1, -2]], "B": [[1], [0]],
                 "disturbance": {"lower": [-0.1, 0], "upper": [0.1, 0.2]}},
        "jump": {"G": [[0.5, 0.1], [0, 0.5]], "dwell_time": [0.7, 2.0]},
        "output": {"C": [[0, 1]], "noise_bound": bound, "measured": measured, **period},
        "observer": {"kind": kind, **options},
    })  # fmt: skip


def ran(observer: Any, record: Any, shift: float = 0.0) -> Any:
    box = {"lower": [0, 0], "upper": [2, 2]} if observer.kind == "interval" else {"x": [1, 1]}
    given = {name: record.block(name) for name in ("u", "w") if record.block(name).size}
    jump = record.columns["jump"]
    return observer.run_batch(record.t, record.block("y") - shift, **given, jump=jump, **box)


@pytest.mark.parametrize("case", KINDS)
def test_a_pair_is_the_symmetric_design_on_y_less_the_middle(case: str) -> None:
    asked = problem(case, [PAIR])
    pair, symmetric = (obsdesign.design(p) for p in (asked, problem(case, [RADIUS])))
    assert obsdesign.verify(pair).verdict == "proved"
    assert pair.gains["noise_centre"].tolist() == [CENTRE]
    assert "noise_centre" not in symmetric.gains
    for name, gain in symmetric.gains.items():
        assert np.array_equal(pair.gains[name], gain)
    for disturbance in ("extreme", "random", "sine"):
        record = simulate(
            asked.plant, until=6.0, disturbance=disturbance, rng=np.random.default_rng(4)
        )
        own = ran(from_design(pair), record)
        other = ran(from_design(symmetric), record, CENTRE)
        assert own.status == other.status
        x = record.block("x")
        for one, two in ((own.x, other.x), (own.lower, other.lower), (own.upper, other.upper)):
            assert (one is None) == (two is None)
            assert one is None or np.allclose(one, two, rtol=1e-12, atol=1e-13)
        if own.lower is not None and own.upper is not None:
            assert ((own.lower <= x) & (x <= own.upper)).all()


def test_noise_is_drawn_between_its_ends() -> None:
    for disturbance, width in (("random", 0.45), ("sine", 0.3), ("zero", 0.0)):
        record = simulate(
            problem("continuous", [PAIR]).plant, until=20.0, disturbance=disturbance,
            rng=np.random.default_rng(1),
        )  # fmt: skip
        rows = record.columns["jump"] == 0  # a measurement at a jump is of the state before it
        noise = (record.block("y") - record.block("x")[:, 1:])[rows]
        assert (noise >= PAIR[0] - 1e-12).all()
        assert (noise <= PAIR[1] + 1e-12).all()
        assert np.ptp(noise) >= width
        assert abs(noise.mean() - CENTRE) < 0.05


@pytest.mark.parametrize("name", ["ahn_1", "mattsson_medvedev"])
@pytest.mark.parametrize("std", [0.0, 0.01])
def test_unknown_inputs_and_impulses_know_the_middle_too(name: str, std: float) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / f"{name}.toml").to_dict()
    p = len(body["output"]["C"])
    observers: list[Any] = []
    for bound in ([PAIR] * p, [RADIUS] * p):
        body["output"] |= {"noise_bound": bound, "noise_std": [std] * p}
        design = obsdesign.design(Problem.from_dict(body))
        assert obsdesign.verify(design).verdict == "proved"
        observers.append(from_design(design))
    record = simulate(Problem.from_dict(body).plant, until=6.0, rng=np.random.default_rng(3))
    pair, symmetric = observers
    y = record.block("y")
    u = {"u": record.block("u")} if record.block("u").size else {}
    one, two = pair.run_batch(record.t, y, **u), symmetric.run_batch(record.t, y - CENTRE, **u)
    assert np.allclose(one.x, two.x, rtol=1e-9, atol=1e-9)
    assert one.status == two.status
    assert one.d is None or np.allclose(one.d, two.d, rtol=1e-7, atol=1e-7, equal_nan=True)
    parts = list(pair.run(pair.init(float(record.t[0])), rows_of(record.t, y, **u)))
    assert np.allclose(np.array([part.x for part in parts]), two.x, rtol=1e-9, atol=1e-9)


def test_a_fleet_takes_the_middle_off_too() -> None:
    body = problem("periodic", [PAIR]).to_dict()
    del body["jump"], body["flow"]["B"]
    observer: Any = from_design(obsdesign.design(Problem.from_dict(body)))
    fleet = Fleet((observer, observer))
    state = fleet.init(0.0, lower=[0.0, 0.0], upper=[2.0, 2.0])
    record = simulate(
        Problem.from_dict(body).plant, until=5.0, disturbance="extreme",
        rng=np.random.default_rng(2),
    )  # fmt: skip
    for t, y, x in zip(record.t[1:], record.block("y")[1:], record.block("x")[1:], strict=True):
        state, estimate = fleet.step(state, float(t), y)
        assert {estimate.plant(k).status for k in (0, 1)} == {"ok"}
        assert (estimate.lower <= x[:, None]).all()
        assert (x[:, None] <= estimate.upper).all()


def test_the_normal_form_keeps_pairs_and_old_designs_their_bytes() -> None:
    asked = problem("continuous", [PAIR])
    assert asked.to_dict()["output"]["noise_bound"] == [PAIR]
    assert Problem.from_dict(asked.to_dict()) == asked
    plain = problem("continuous", [0.25])
    assert plain.to_dict()["output"]["noise_bound"] == [0.25]
    balanced = obsdesign.design(problem("continuous", [[-0.25, 0.25]]))
    gains = obsdesign.design(plain).gains
    assert balanced.gains.keys() == gains.keys()
    assert all(np.array_equal(balanced.gains[name], gains[name]) for name in gains)
    body = asked.to_dict()
    body["output"] = {"C": [[0, 1], [1, 0]], "noise_bound": [PAIR, 0.5]}
    del body["observer"]
    both = Problem.from_dict(body).plant.output
    assert both.noise_bound is not None
    assert both.noise_bound.tolist() == [PAIR, [-0.5, 0.5]]
    assert both.noise_centre is not None
    assert both.noise_centre.tolist() == [CENTRE, 0.0]


@pytest.mark.parametrize(
    ("bound", "line"),
    [
        ([[0.3, -0.1]], "output.noise_bound: lower must not exceed upper; got lower 0.3 > upper "
         "-0.1 for output 1. Are they swapped?"),
        ([[-0.1, 0.2, 0.3]], "output.noise_bound must hold numbers or pairs [lower, upper]; got "
         "[-0.1, 0.2, 0.3]."),
        ([[-0.1, 0.3], 0.1], "output.noise_bound must have 1 row, one pair per row of output.C "
         "(1x2); got 2x2."),
        ([[-0.1, "0.3"]], "output.noise_bound, row 1, column 2 must be a number; got '0.3'."),
        ([-0.1, 0.3], "output.noise_bound must hold numbers >= 0 or pairs [lower, upper]; got "
         "[-0.1, 0.3]. Is it one pair? That is written [[lower, upper]]."),
    ],
)  # fmt: skip
def test_pairs_that_are_none_are_refused(bound: Any, line: str) -> None:
    with pytest.raises(InputError) as refusal:
        problem("continuous", bound)
    assert str(refusal.value).startswith(line)
    assert len(str(refusal.value).splitlines()) == 1


@pytest.mark.parametrize("case", ["continuous", "luenberger", "finite_time"])
def test_a_middle_that_is_not_the_problems_does_not_run(case: str) -> None:
    design = obsdesign.design(problem(case, [PAIR]))
    without = {name: gain for name, gain in design.gains.items() if name != "noise_centre"}
    for gains in (without, {**design.gains, "noise_centre": np.array([0.2])}):
        forged = dataclasses.replace(design, gains=gains)
        assert obsdesign.verify(forged).verdict == "refuted"
        with pytest.raises(InputError, match=r"gains\.noise_centre differs from problem"):
            from_design(forged)


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(0, 1e6)), min_size=1, max_size=4))
def test_centre_and_radius_hold_the_pair(ends: list[tuple[float, float]]) -> None:
    pairs = np.array([[low, low + width] for low, width in ends])
    centre, radius = noise_box(pairs)
    middle = np.zeros(len(pairs)) if centre is None else centre
    for (low, high), c, r in zip(pairs.tolist(), middle.tolist(), radius.tolist(), strict=True):
        assert Fraction(c) - Fraction(r) <= Fraction(low)
        assert Fraction(high) <= Fraction(c) + Fraction(r)
