"""Bounds of driven systems with jumps: above every adversary, and not by orders of magnitude."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact
from lmi.bounds import driven_jumps
from lmi.bounds.driven_jumps import DrivenJumps, Radius, driven_bounds, radius_before_jumps
from lmi.decide.stability import decide
from lmi.find.largest_rates import largest_rates
from lmi.time_budget import TimeBudget

Pair = tuple[np.ndarray, np.ndarray]
COLUMNS: Pair = (np.array([[0.0], [0.1]]), np.array([[0.0], [0.05]]))


def system(pair: Pair, low: float, high: float) -> DrivenJumps:
    F, H = (exact(X) for X in pair)
    E, K = (exact(X) for X in COLUMNS)
    return DrivenJumps(F, E, H, K, low, high)


def contraction(pair: Pair, low: float, high: float) -> tuple[np.ndarray, float]:
    evidence = decide(*pair, low, high).evidence
    rates = largest_rates(*pair, evidence["P"], low, high)
    assert rates is not None
    return np.linalg.cholesky(np.array(rates["P_per_jump"])).T, float(rates["per_jump"])


def reached(pair: Pair, thetas: np.ndarray) -> np.ndarray:
    """The largest |e| just before the last of these stays, from zero, by the worst courses."""
    F, H = pair
    E, K = COLUMNS
    result = np.zeros(2)
    for i, row in enumerate(np.eye(2)):
        for theta in thetas[::-1]:
            times = np.linspace(0, theta, 200)
            values = [abs(float((row @ expm(F * s) @ E)[0])) for s in times]
            row = row @ expm(F * theta)
            result[i] += np.trapezoid(values, times) + abs(float((row @ K)[0]))
            row = row @ H
    return result


@pytest.mark.parametrize("high", [1.0, 3.0, np.inf])
def test_no_course_leaves_the_bounds(high: float) -> None:
    pair = (np.array([[0, 1], [-1, -0.1]]), np.diag([1, 0.3]))
    driven = system(pair, 1.0, high)
    around = radius_before_jumps(driven, *contraction(pair, 1.0, high))
    bounds = driven_bounds(driven, None, around)
    assert bounds is not None
    before, always = bounds
    assert (always >= before * (1 - 1e-12)).all()
    rng = np.random.default_rng(5)
    worst = np.max([reached(pair, rng.uniform(1.0, min(high, 9.0), 10)) for _ in range(6)], axis=0)
    assert (worst <= before).all()
    assert (before < 4 * worst).all()


def test_a_box_is_made_smaller_from_jump_to_jump() -> None:
    """Where |e^(F theta) H| contracts, the box that is known at first does not matter."""
    pair = (np.diag([-1.0, -2.0]), np.array([[0.5, 0.1], [0.1, 0.5]]))
    driven = system(pair, 0.5, 20.0)
    one, other = (driven_bounds(driven, exact(np.full(2, size)), None) for size in (1.0, 50.0))
    assert one is not None
    assert other is not None
    assert other[0] == pytest.approx(one[0], rel=1e-2)
    assert (one[0] < 0.2).all()


def test_what_is_not_proved_gives_nothing() -> None:
    pair = (np.array([[0, 1], [-1, -0.1]]), np.diag([1, 0.3]))
    driven = system(pair, 1.0, 3.0)
    T, gamma = contraction(pair, 1.0, 3.0)
    assert driven_bounds(driven, None, None) is None
    assert isinstance(radius_before_jumps(driven, T, gamma), Radius)
    for wrong in ((T, 0.9 * gamma), (T, 1.0), (np.eye(2), gamma), (np.ones((2, 2)), gamma)):
        assert radius_before_jumps(driven, *wrong) is None


def test_a_total_ends_the_proof_of_a_contraction() -> None:
    pair = (np.array([[0, 1], [-1, -0.1]]), np.diag([1, 0.3]))
    driven = system(pair, 1.0, 3.0)
    T, gamma = contraction(pair, 1.0, 3.0)
    assert radius_before_jumps(driven, T, gamma, TimeBudget.from_seconds(1e-9)) is None
    # the twin has the time
    assert radius_before_jumps(driven, T, gamma, TimeBudget.from_seconds(60.0)) is not None


def test_a_longest_dwell_time_far_away_or_none_is_all_the_same() -> None:
    pair = (np.array([[0, 1], [-1, -0.4]]), np.diag([1, 0.3]))
    box = exact(np.full(2, 3.0))
    far, none = (driven_bounds(system(pair, 1.0, high), box, None) for high in (1e4, np.inf))
    assert far is not None
    assert none is not None
    assert np.array_equal(far, none)
    near = driven_bounds(system(pair, 1.0, 25.0), box, None)
    assert near is not None
    assert none[1] == pytest.approx(near[1], rel=1e-2)
    # the twin: a flow that does not decay is bounded for a finite time alone
    still = (np.array([[0.0, 1.0], [-1.0, 0.0]]), np.diag([0.1, 0.1]))
    assert driven_bounds(system(still, 1.0, 3.0), box, None) is not None
    assert driven_bounds(system(still, 1.0, np.inf), box, None) is None


def from_contraction(F: np.ndarray, high: float) -> Pair | None:
    """Bounds where |H x| <= 0.5 |x| at jumps, and no stay lets |x| grow much."""
    driven = system((F, np.diag([0.5, 0.3])), 1.0, high)
    around = radius_before_jumps(driven, np.eye(2), 0.97)
    return None if around is None else driven_bounds(driven, None, around)


@pytest.mark.parametrize("high", [200.0, np.inf])
@pytest.mark.parametrize("damping", [0.01, 0.001])
def test_slow_decay_does_not_let_bounds_grow(damping: float, high: float) -> None:
    """An oscillation that is driven without jumps comes to (2 / pi) |E| / damping."""
    bounds = from_contraction(np.array([[0, 1], [-1, -2 * damping]]), high)
    assert bounds is not None
    without_jumps = 0.2 / np.pi / damping
    assert (bounds[1] < 2 * without_jumps).all()
    if np.isinf(high):
        assert (bounds[1] > without_jumps).all()


@pytest.mark.parametrize("damping", [0.0, -0.001])
def test_no_decay_has_no_bound_without_jumps(damping: float) -> None:
    F = np.array([[0, 1], [-1, -2 * damping]])
    assert from_contraction(F, np.inf) is None
    # the twin, while jumps come
    assert from_contraction(F, 5.0) is not None


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_state_that_nothing_drives_settles(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its bound is zero; with a share of the other state's it is not, and settles as soon."""
    rounds, reached_on_cells = [], driven_jumps._reached

    def counted(steps: list[driven_jumps._Stretch], *known: Any) -> Any:
        rounds.append(len(steps))
        return reached_on_cells(steps, *known)

    monkeypatch.setattr(driven_jumps, "_reached", counted)
    driven = system((np.diag([-1.0, -2.0]), np.array([[0, share], [0, 0.5]])), 0.5, 3.0)
    bounds = driven_bounds(driven, exact(np.full(2, 1.0)), None)
    assert bounds is not None
    assert (bounds[0][0] == 0) == (share == 0)
    assert len(rounds) < 30
