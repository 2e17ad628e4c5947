"""Bounds of convergence with numbers by hand, and rates that they show."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.balls import exact, number, scalar
from obsdesign.verification.impulsive import rate as rates
from obsdesign.verification.impulsive.blocks import Blocks
from obsdesign.verification.impulsive.claims import _nominal
from obsdesign.verification.impulsive.rate import Bound, RankProof, Rate


def core(**changes: Any) -> Any:
    """x' = 0, x+ = x, y = x: every spacing moves an error by one."""
    plain = {"A": exact([[0.0]]), "J": exact([[1.0]]), "C": exact([[1.0]]), "U": None, "S": None}
    return SimpleNamespace(**plain | changes)


@pytest.mark.parametrize("window", [2, 3, 5])
@pytest.mark.parametrize("alpha", [1.0, 1.5])
def test_the_reach_of_a_window_by_hand(window: int, alpha: float) -> None:
    s, largest, recalled = 0.5, 2.0, 3.0
    for known, proof in (
        (1, RankProof(1, (s,), largest, recalled, math.nan)),
        (window, RankProof(1, (s,), largest, math.inf, math.nan)),
    ):
        with rates.in_balls():
            reach = rates.window_reach(core(), (1.0, 1.0), window, alpha, proof)
            constant, factor, gain = (
                float(x.mid()) for x in (reach.bound.constant, reach.bound.factor, reach.gain)
            )
        ages, step = range(1, window), 1 + s
        if known == 1:
            outputs = math.sqrt(recalled**2 + sum(alpha ** (-2 * age) for age in ages))
            entered = 1.0
        else:
            outputs = math.sqrt(largest**2 + len(ages))
            entered = 1 + sum(s * alpha ** (window - 1) * step ** (j - 1) for j in range(1, window))
        settled = s * outputs * entered * alpha**known
        assert constant == pytest.approx(max(settled, (step * alpha) ** (known - 1), 1.0), rel=1e-6)
        assert factor == pytest.approx(1 / alpha)
        assert gain == pytest.approx(s, rel=1e-6)


@pytest.mark.parametrize("recalled", [3.0, math.inf])
def test_a_compressed_window_measures_one_impulse_later(recalled: float) -> None:
    compressed = core(U=exact([[1.0]]), S=exact([[1.0]]))
    s, largest, window, alpha = 0.5, 20.0, 3, 1.5
    with rates.in_balls():
        proof = RankProof(1, (s,), largest, recalled, math.nan)
        reach = rates.window_reach(compressed, (1.0, 1.0), window, alpha, proof)
        constant = float(reach.bound.constant.mid())
    step, entered = 1 + s, 1 + s
    if math.isfinite(recalled):
        known, outputs = 2, math.sqrt(recalled**2 + alpha**-2 + alpha**-4)
    else:
        known, outputs = window + 1, math.sqrt(largest**2 + 2)
        entered += sum(s * alpha ** (window - 1) * step ** (j - 1) for j in (2, 3))
    assert constant == pytest.approx(s * outputs * entered * alpha**known, rel=1e-6)


def test_spreads_by_age_count_for_the_errors_that_entered_so_long_ago() -> None:
    window, spread, largest = 4, (0.5, 0.25, 0.125), 20.0
    with rates.in_balls():
        proof = RankProof(3, spread, largest, math.inf, math.nan)
        reach = rates.window_reach(core(), (1.0, 1.0), window, 1.0, proof)
        constant = float(reach.bound.constant.mid())
    present, step = spread[-1], 1 + spread[-1]
    outputs = math.sqrt(largest**2 + 1)
    entered = 1 + sum(spread[min(window - j, 2)] * step ** (j - 1) for j in range(1, window))
    assert constant == pytest.approx(max(present * outputs * entered, step**3, 1.0), rel=1e-6)


def test_a_quadratic_bound_is_the_root_of_the_condition_number() -> None:
    with rates.in_balls():
        bound = rates.quadratic_bound(np.diag([4.0, 1.0]), 0.5)
        assert float(bound.constant.mid()) == pytest.approx(2.0, rel=1e-8)
        assert bound.constant >= 2
        assert float(bound.factor.mid()) == 0.5


def test_changes_of_a_flow_are_above_their_largest() -> None:
    A, nominal, high = np.array([[-1.0]]), np.array([[-1.1]]), 2.0
    times = np.linspace(0, high, 1001)
    with rates.in_balls():
        change, other = rates.flow_change(exact(A), exact(nominal), high)
        largest = np.abs(np.exp(-times) - np.exp(-1.1 * times)).max()
        assert largest <= float(change.mid()) <= 0.1 * high * 1.3
        assert 1.0 <= float(other.mid()) <= 1.2


@pytest.mark.parametrize(
    ("stored", "shown"),
    [
        (Rate(0.6, 3.0, 0.2), True),
        (Rate(0.5, 2.0, 0.2), True),
        (Rate(0.49, 3.0, 0.2), False),
        (Rate(0.6, 1.9, 0.2), False),
        (Rate(1.0, 3.0, 0.2), False),
        (Rate(0.6, math.inf, 0.2), False),
        (Rate(0.6, 3.0, 0.0), False),
        (Rate(0.6, 3.0, -math.log(0.6) / 2 * 0.999), True),
        (Rate(0.6, 3.0, -math.log(0.6) / 2 * 1.001), False),
    ],
)
def test_rates_that_a_bound_shows(stored: Rate, shown: bool) -> None:
    assert stored.follows_from(0.5, 2.0, 2.0) is shown
    with rates.in_balls():
        bound = Bound(number(1.999), number(0.4999))
        rate = rates.certified_rate(bound, 2.0, stored.to_evidence())
    assert rate is not None
    assert (rate == stored) is shown
    if not shown:
        assert rate.per_impulse == pytest.approx(0.4999, rel=1e-6)
        assert rate.per_impulse > 0.4999
        assert 1.999 <= rate.constant <= 1.999 * 1.2
        assert rate.in_time == pytest.approx(-math.log(0.4999) / 2, rel=1e-6)
        assert rate.follows_from(0.4999, 1.999, 2.0)


def test_no_rate_without_decay() -> None:
    with rates.in_balls():
        for bound in (Bound(number(2.0), number(1.0)), Bound(scalar(1) / scalar(0), number(0.5))):
            assert rates.certified_rate(bound, 2.0, {}) is None


def test_an_exact_plant_is_nominal_and_a_rounded_one_where_that_is_absorbed() -> None:
    exactly: Any = SimpleNamespace(is_exact=True)
    assert _nominal(exactly, None).evidence == {"exact": True}
    rounded: Any = SimpleNamespace(is_exact=False)
    assert _nominal(rounded, None).outcome == "undecided"
    for factor, outcome in ((0.9, "proved"), (1.0, "undecided")):
        with rates.in_balls():
            whole: Any = SimpleNamespace(
                bound=Bound(number(2.0), number(factor)), change=number(1e-9)
            )
        verdict = _nominal(rounded, whole)
        assert verdict.outcome == outcome
        assert verdict.evidence["exact"] is False
        assert verdict.evidence["largest_change"] == pytest.approx(1e-9)


@pytest.mark.parametrize("name", ["A", "G", "C"])
def test_a_nominal_plant_is_exact_where_no_entry_differs(name: str) -> None:
    matrices = {"A": np.eye(2), "G": np.diag([1.0, 2.0]), "C": np.ones((1, 2))}
    entries = {key: exact(value) for key, value in matrices.items()}
    entries |= {f"{key}0": exact(value) for key, value in matrices.items()}
    assert Blocks.is_exact.fget(SimpleNamespace(**entries))
    changed = matrices[name].copy()
    changed[0, 1] += 1e-16 if name != "C" else 2.0**-52
    entries[f"{name}0"] = exact(changed)
    assert not Blocks.is_exact.fget(SimpleNamespace(**entries))
