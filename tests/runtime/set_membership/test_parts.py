"""Parts of the multiplier observer, each against exact numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT
from obsdesign.errors import InputError
from obsdesign.runtime.boxes import stated_bounds
from obsdesign.runtime.set_membership.evaluation import _residuals, upper_bounds
from obsdesign.runtime.set_membership.model import observer_model, unscaled
from obsdesign.runtime.set_membership.series import _DEGREE, FlowSeries, _terms
from obsdesign.runtime.set_membership.stages import Targets, sampled_strip
from tests.systems.set_membership import cases, observer_of, window_after

CRANE = cases()["crane"]


def exact(values: Matrix) -> Matrix:
    return np.vectorize(Fraction, otypes=[object])(np.asarray(values, dtype=np.float64))


@pytest.mark.parametrize(("directions", "lag"), [(0, None), (2, None), (0, 3), (2, 3)])
def test_names_and_estimates_have_what_is_stated(directions: int, lag: int | None) -> None:
    rows = {"directions": np.eye(4)[:directions]} if directions else {}
    observer = observer_of(CRANE, 4, fixed_lag=lag, **rows)
    own = ["l1_lo", "l1_hi", "l2_lo", "l2_hi"][: 2 * directions]
    lagged = [f"x{i}_lag_{end}" for i in (1, 2, 3, 4) for end in ("lo", "hi")]
    assert list(observer.names[8:]) == own + (lagged if lag else [])
    state = observer.init(0.0, lower=CRANE.x0[0], upper=CRANE.x0[1])
    _, estimate = observer.step(state, CRANE.record().samples[0])
    assert (estimate.lagged is None) is (lag is None)
    assert (estimate.directions is None) is (directions == 0)


def test_a_bound_of_the_state_before_the_window_is_that_of_its_box() -> None:
    """No multipliers: the largest l'z in the box before the oldest stage."""
    stages = window_after(CRANE, 6)[0]
    rows = np.random.default_rng(0).standard_normal((20, 4))
    upper = upper_bounds(
        stages, Targets(rows, np.full(20, -1)), np.zeros((20, len(stages), len(CRANE.C)))
    )
    box = exact(stages.start)
    for row, bound in zip(exact(rows), upper, strict=True):
        largest = np.maximum(row * box[0], row * box[1]).sum()
        assert largest <= Fraction(bound)
        assert float(bound) - float(largest) < 1e-12 * max(abs(float(largest)), 1.0)


@pytest.mark.parametrize("place", [-1, 2, 5])
def test_residuals_cover_the_rounding_of_the_walk(place: int) -> None:
    """Stages that do not flow: what is left are the roundings of samples and of the target."""
    stages = window_after(CRANE, 6)[0]
    T, n, p = len(stages), 4, len(CRANE.C)
    still = np.broadcast_to(np.eye(n), (T, n, n))
    stages = replace(stages, Phi=still, phi_error=np.zeros((T, n, n)))
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((8, n))
    mu = rng.standard_normal((8, T, p)) * np.exp(3 * rng.standard_normal((8, T, p)))
    mu *= stages.sampled
    P, Q = np.zeros((T + 1, 8, n)), np.zeros((T, 8, n))
    for k in reversed(range(T)):
        Q[k] = P[k + 1] + (rows if k == place else 0.0) - mu[:, k] @ stages.C
        P[k] = Q[k]
    P[0] += rows if place < 0 else 0.0
    bound = _residuals(stages, Targets(rows, np.full(8, place)), P, Q, mu)
    left = np.zeros(8, dtype=object)
    for k in range(T):
        entering = exact(rows) if k == place else 0 * exact(rows)
        step = exact(P[k + 1]) + entering - exact(mu[:, k]) @ exact(stages.C) - exact(Q[k])
        left = left + abs(step) @ exact(stages.sizes[k + 1])
    start = exact(Q[0]) + (exact(rows) if place < 0 else 0 * exact(rows)) - exact(P[0])
    left = left + abs(start) @ exact(stages.sizes[0])
    assert (left > 0).any()
    assert (left <= exact(bound)).all()
    # a few roundings of the largest number for each entry of each stage
    sizes = np.abs(Q).max() + np.abs(mu).max() * np.abs(stages.C).max() + np.abs(rows).max()
    assert bound.max() < 20 * UNIT * p * sizes * stages.sizes.sum()


def test_a_series_has_the_room_of_a_product_of_its_length() -> None:
    """A product of m numbers by floats errs by at most m units of the sum of sizes (Higham)."""
    A = np.random.default_rng(2).standard_normal((3, 3))
    mids, size, errors = _terms(A)
    assert (size == np.abs(mids)).all()
    assert len(mids) == _DEGREE + 1
    assert (errors >= (_DEGREE + 1) * UNIT * size).all()
    power = factorial = exact(np.eye(3))
    for k in range(1, _DEGREE + 1):
        power, factorial = power @ exact(A), factorial * k
        term = power / factorial.max()
        assert (abs(term - exact(mids[k].reshape(3, 3))) <= exact(errors[k].reshape(3, 3))).all()


@pytest.mark.parametrize("y", [0.1, 0.0, -3e5])
def test_an_exact_measurement_is_a_strip_without_width(y: float) -> None:
    zero = np.zeros(1)
    assert sampled_strip(np.array([y]), zero, zero).tolist() == [[y], [y]]
    wide = sampled_strip(np.array([y]), zero - 1.0, zero + 1.0)
    assert wide[0] < y - 1.0 < y + 1.0 < wide[1]


def test_units_are_exact_but_where_numbers_are_tiny() -> None:
    tiny = 5e-324
    box = np.array([[-1.5, 0.0, 3 * tiny, -tiny], [2.25, 0.0, 7 * tiny, tiny]])
    scales = np.array([8.0, 8.0, 4.0, 8.0])
    lower, upper = unscaled(box, scales)
    assert lower[:2].tolist() == [-0.1875, 0.0]
    assert upper[:2].tolist() == [0.28125, 0.0]
    assert (exact(lower) <= exact(box[0]) / exact(scales)).all()
    assert (exact(upper) >= exact(box[1]) / exact(scales)).all()


def test_a_model_in_other_units_is_the_same_plant() -> None:
    rng = np.random.default_rng(4)
    units = 2.0 ** np.array([0, 9, -7])
    A, G = rng.standard_normal((2, 3, 3)) * units[:, None] / units
    plain = {
        "A": A, "G": G, "B": rng.standard_normal((3, 2)), "E": rng.standard_normal((3, 1)),
        "C": rng.standard_normal((1, 3)) / units, "noise_bound": np.ones(1),
        "flow_lower": -units, "flow_upper": units, "jump_lower": -units, "jump_upper": units,
    }  # fmt: skip
    gains = replace(observer_of(CRANE, 4).gains, **plain)
    model = observer_model(gains)
    s = model.scales
    assert s.max() > 50 * s.min()
    assert (model.A * s / s[:, None] == A).all()
    (jump,) = model.jumps
    assert (jump.G * s / s[:, None] == G).all()
    assert (model.C * s == plain["C"]).all()
    assert (model.inputs / s[:, None] == plain["B"]).all()
    assert (jump.inputs / s[:, None] == plain["E"]).all()


def test_initial_bounds_that_are_none_are_named() -> None:
    for initial, words in ((None, "got nothing"), ([1.0, 2.0, 3.0], "got 3 numbers")):
        with pytest.raises(InputError, match=f"must be the 4 numbers x1_lo,x1_hi.*; {words}"):
            stated_bounds(2, initial)
    lower, upper = stated_bounds(2, [-1.0, 1.0, -2.0, 2.0])
    assert (lower.tolist(), upper.tolist()) == ([-1.0, -2.0], [1.0, 2.0])


@pytest.mark.parametrize("t", [0.5, 1.0, 50.0])
def test_the_end_of_a_long_chain_is_enclosed(t: float) -> None:
    """Entries that only powers beyond the series reach are within its remainder."""
    n, a = 19, 0.49 / t
    Phi, integral = FlowSeries(a * np.diag(np.ones(n - 1), 1)).flow(t, 0.0)
    for i in range(n):
        for j in range(i, n):
            power = (Fraction(a) * Fraction(t)) ** (j - i) / math.factorial(j - i)
            for whole, exact_value in ((Phi, power), (integral, power * Fraction(t) / (j - i + 1))):
                assert abs(Fraction(whole.mid[i, j]) - exact_value) <= Fraction(whole.rad[i, j])
