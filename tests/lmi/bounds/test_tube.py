"""Tubes: proved from just above the exact threshold on, and never below it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from lmi.arithmetic.balls import exact
from lmi.bounds.tube import Affine, Tube, periodic_limit, prove_below, prove_tube

ROOM = 1e-3
E = math.e


def below(W: object, f: object, start: object, bound: object, low: float, high: float) -> str:
    """Verdict on u(theta) < bound."""
    system = Affine(exact(W), exact(f), exact(start))
    X = exact(np.eye(len(np.atleast_1d(np.asarray(bound)))))
    return prove_below(system, X, exact(bound), low, high).outcome


# u' = 1 - u from `start`: the largest u on [low, high]
SCALARS = [
    (0.5, 0.0, math.inf, 1.0),
    (0.5, 0.0, 1.0, 1 - 0.5 / E),
    (0.5, 2.0, 3.0, 1 - 0.5 / E**3),
    (2.0, 0.0, math.inf, 2.0),
    (2.0, 1.0, math.inf, 1 + 1 / E),
    (2.0, 1.0, 1.0, 1 + 1 / E),
    (0.0, 1.0, 1.0, 1 - 1 / E),
]


@pytest.mark.parametrize(("start", "low", "high", "largest"), SCALARS)
@pytest.mark.parametrize("unit", [1.0, 1e-3, 40.0])
def test_a_bound_holds_from_the_largest_value_on(
    start: float, low: float, high: float, largest: float, unit: float
) -> None:
    ends = ([[-1.0]], [unit], [unit * start])
    assert below(*ends, [unit * largest * (1 + ROOM)], low, high) == "proved"
    assert below(*ends, [unit * largest * (1 - ROOM)], low, high) == "undecided"


def test_a_mode_that_grows_is_bounded_for_a_while_and_not_for_ever() -> None:
    # u = e^theta (start + 1) - 1
    assert below([[1.0]], [1.0], [0.0], [(E - 1) * (1 + ROOM)], 0.0, 1.0) == "proved"
    assert below([[1.0]], [1.0], [0.0], [(E - 1) * (1 - ROOM)], 0.0, 1.0) == "undecided"
    assert below([[1.0]], [1.0], [0.0], [1e6], 0.0, math.inf) == "undecided"


def test_a_rise_and_fall_between_the_ends_is_not_overlooked() -> None:
    # x2' = x1 - x2, x1 = e^-theta: x2 = theta e^-theta has its largest value 1/e at 1
    W, f, start = [[-1.0, 0.0], [1.0, -1.0]], [0.0, 0.0], [1.0, 0.0]
    for low, high, largest in ((0, math.inf, 1 / E), (0, 9, 1 / E), (2, math.inf, 2 / E**2)):
        system = Affine(exact(W), exact(f), exact(start))
        for room, outcome in ((ROOM, "proved"), (-ROOM, "undecided")):
            bound = exact([largest * (1 + room)])
            verdict = prove_below(system, exact([[0.0, 1.0]]), bound, low, high)
            assert verdict.outcome == outcome


@pytest.mark.parametrize("seed", range(4))
def test_a_range_of_floats_is_reached_to_its_last_one(seed: int) -> None:
    """Rounded, low + (high - low) may be below high: a step of an ulp is left, a step like any."""
    rng = np.random.default_rng(seed)
    while not (high := rng.uniform(0, 0.1)) > (low := rng.uniform(0, high)) + (high - low):
        pass
    end = math.exp(high)
    assert below([[1.0]], [0.0], [1.0], [1.01 * end], low, high) == "proved"
    assert below([[1.0]], [0.0], [1.0], [0.999 * end], low, high) == "undecided"


@pytest.mark.parametrize("place", ["W", "f", "start", "X"])
def test_a_system_that_is_not_positive_is_undecided(place: str) -> None:
    parts = {"W": np.array([[-1.0, 0.1], [0.1, -1.0]]), "f": np.ones(2), "start": np.ones(2),
             "X": np.ones((1, 2))}  # fmt: skip
    signs = {name: exact(value) for name, value in parts.items()}

    def outcome() -> str:
        system = Affine(signs["W"], signs["f"], signs["start"])
        return prove_below(system, signs["X"], exact([9.0]), 0.0, 1.0).outcome

    assert outcome() == "proved"
    changed = parts[place].copy()
    changed[(0, 1) if changed.ndim == 2 else 1] = -1e-9
    signs[place] = exact(changed)
    assert outcome() == "undecided"


def tube_of(v: float, before: float, always: float, after: float | None = None) -> str:
    """Verdict on u' = 1 - u, u+ = u/2 + 1/4, with dwell times from 1 on."""
    tube = Tube(
        exact([v]), exact([v if after is None else after]), exact([before]), exact([always])
    )
    W, f, N, h, X = (exact(A) for A in ([[-1.0]], [1.0], [[0.5]], [0.25], [[1.0]]))
    return prove_tube(W, f, N, h, X, tube=tube, low=1.0, high=math.inf).outcome


def test_a_tube_holds_from_its_exact_threshold_on() -> None:
    # after jumps at most 3/4, whatever the dwell time; before them and always below 1
    assert tube_of(0.751, 1.001, 1.001) == "proved"
    assert tube_of(0.749, 1.001, 1.001) == "undecided"
    assert tube_of(0.751, 0.999, 1.001) == "undecided"
    assert tube_of(0.751, 1.001, 0.999) == "undecided"
    assert tube_of(0.751, 1.001, 1.001, after=0.75) == "undecided"
    assert tube_of(-0.751, 1.001, 1.001) == "undecided"
    # above its rest the system falls: 2 at once, 1 + 1/e when the first jump may come
    assert tube_of(2.0, 1.3680, 2.001) == "proved"
    assert tube_of(2.0, 1.3677, 2.001) == "undecided"
    assert tube_of(2.0, 1.3680, 1.999) == "undecided"


@pytest.mark.parametrize(("start", "bound"), [(0.0, 1.0), (1.5, 1.6), (2.0, 2.001)])
def test_systems_of_one_flow_share_exponentials_and_no_verdict(start: float, bound: float) -> None:
    first, X = Affine(exact([[-1.0]]), exact([1.0]), exact([0.5])), exact([[1.0]])
    assert prove_below(first, X, exact([1.5]), 0.0, 2.0).outcome == "proved"
    other, count = replace(first, start=exact([start])), len(first.matrices)
    alone = Affine(first.W, first.f, other.start)
    shared, own = (
        prove_below(system, X, exact([bound]), 0.0, 2.0).evidence for system in (other, alone)
    )
    assert shared == own
    assert len(first.matrices) < count + len(alone.matrices)
    # the twin: a bound that the other start exceeds, and the first does not
    assert prove_below(other, X, exact([0.999 * start]), 0.0, 2.0).outcome == "undecided"


def test_the_steps_of_a_tube_are_those_of_its_three_bounds() -> None:
    tube = Tube(*(exact([x]) for x in (0.751, 0.751, 1.001, 1.001)))
    W, f, N, h, X = (exact(A) for A in ([[-1.0]], [1.0], [[0.5]], [0.25], [[1.0]]))
    system = Affine(W, f, tube.v)
    parts = [(N, tube.v - h, 1.0), (X, tube.before, 1.0), (X, tube.always, 0.0)]
    steps = [prove_below(system, *part, 3.0).evidence["steps"] for part in parts]
    verdict = prove_tube(W, f, N, h, X, tube=tube, low=1.0, high=3.0)
    assert verdict.evidence["steps"] == sum(steps)


@pytest.mark.parametrize("seed", range(4))
def test_a_periodic_limit_is_the_fixed_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, theta = 1 + seed, float(rng.uniform(0.2, 2))
    W, N = rng.random((n, n)), rng.random((n, n)) / (2 * n)
    W -= np.diag(W.sum(axis=1) + rng.random(n))
    f, h = rng.random(n), rng.random(n)
    Z = np.block([[W, np.eye(n)], [np.zeros((n, 2 * n))]])
    flow, once = np.hsplit(expm(Z * theta)[:n], 2)
    before = np.linalg.solve(np.eye(n) - flow @ N, flow @ h + once @ f)
    after = N @ before + h
    mean = np.linalg.solve(W, before - after - f * theta) / theta  # u' = W u + f, integrated
    limit = periodic_limit(exact(W), exact(N), exact(f), exact(h), theta)
    assert limit is not None
    for one, truth in zip(limit, (before, after, mean), strict=True):
        np.testing.assert_allclose(one, truth, rtol=1e-12)
    # the twin: a jump that makes the map singular has no limit
    assert periodic_limit(exact([[0.0]]), exact([[1.0]]), exact([1.0]), exact([0.0]), 1.0) is None


@pytest.mark.parametrize("fast", [30.0, 3e3])
def test_a_fast_state_that_has_settled_takes_few_steps(fast: float) -> None:
    """x2 follows x1 = 1 - e^-theta / 2: it is near its bound, and hardly moves."""
    W, f = exact([[-1.0, 0.0], [fast, -fast]]), exact([1.0, 0.0])
    start = exact([0.5, 0.5])
    x2 = 1 - 0.5 * (fast * math.exp(-5.0) - math.exp(-5.0 * fast)) / (fast - 1)
    for room, outcome in ((2e-6, "proved"), (-2e-6, "undecided")):
        bound = exact([x2 * (1 + room)])
        verdict = prove_below(Affine(W, f, start), exact([[0.0, 1.0]]), bound, 4.9, 5.0)
        assert verdict.outcome == outcome
        assert verdict.evidence["steps"] < 120
