"""What rounding leaves for ever: small for every well-posed plant, told for every false design."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad_vec
from scipy.linalg import expm

import obsdesign
from lmi.arithmetic.balls import exact
from lmi.bounds.peak_gain import peak_gains
from obsdesign.equations.unknown_input import formulas as equations
from obsdesign.runtime import from_design
from obsdesign.verification.unknown_input import steady_state_error
from obsdesign.verification.unknown_input.claims import claims
from tests.systems.unknown_input import random_plant, unknown_input_problem


def verdicts(problem: obsdesign.Problem, gains: object) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in claims(problem, gains, {})}


@pytest.mark.parametrize("seed", range(6))
def test_peak_gains_enclose_the_integral(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, 5))
    F = rng.standard_normal((k, k)) * 10.0 ** rng.uniform(-2, 2)
    F -= (np.linalg.eigvals(F).real.max() + 0.5) * np.eye(k)
    B, C = rng.standard_normal((k, 2)), rng.standard_normal((3, k))
    low, high = peak_gains(exact(F), exact(B), exact(C))
    slowest = -np.linalg.eigvals(F).real.max()
    true = quad_vec(lambda s: abs(C @ expm(F * s) @ B), 0, 60 / slowest, epsrel=1e-6, limit=2000)[0]
    assert np.all(low <= true * (1 + 1e-4))
    assert np.all(true <= high * (1 + 1e-4))
    assert np.all(high < 30 * true + 1e-9)
    assert peak_gains(exact(-F), exact(B), exact(C)) is None  # the twin: nothing decays


def test_fast_modes_do_not_pay_for_slow_ones() -> None:
    F, B, C = np.diag([-1.0, -1e8]), np.array([[0.0], [1.0]]), np.ones((1, 2))
    peaks = peak_gains(exact(F), exact(B), exact(C))
    assert peaks is not None
    assert peaks[1][0, 0] < 1e-3  # 1e-8 in truth; a norm and one rate would give 1
    both = peak_gains(exact(F), exact(np.ones((2, 1))), exact(C))
    assert both is not None
    assert both[0][0, 0] > 1.0


def compartments(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    """Rates of one decimal; the total is measured and an inflow unknown, so that y' = d alone."""
    A = np.round(rng.uniform(0, 1, (n, n)), 1)
    np.fill_diagonal(A, 0.0)
    A -= np.diag(np.round(A.sum(axis=0), 1))
    return A, np.ones((1, n)), np.eye(n)[:, :1]


@pytest.mark.parametrize("seed", range(12))
def test_what_y_shows_may_be_the_unknown_input_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 2 + seed % 5
    assert obsdesign.design(unknown_input_problem(*compartments(rng, n)))
    A = rng.integers(-3, 4, (n, n)) - 8.0 * np.eye(n)
    A[-1] = 0  # x_n' = d, and x_n is measured
    C = D = np.eye(n)[:, -1:]
    S = rng.standard_normal((n, n))
    own = obsdesign.investigate(unknown_input_problem(A, C.T, D)).verdict
    rebased = unknown_input_problem(S @ A @ np.linalg.inv(S), C.T @ np.linalg.inv(S), S @ D)
    assert obsdesign.investigate(rebased).verdict == own == "proved"


def test_slow_zeros_are_proved_with_their_number() -> None:
    A = [[7.000000029802322, -9.000000059604645], [5.000000029802322, -6.000000059604645]]
    problem = unknown_input_problem(A, [[2, -2], [0, 0]], [[-2], [-1]])  # zero at -2.98e-8
    design = obsdesign.design(problem)
    bounds = next(c for c in design.claims if c.id == "rounding").evidence["bounds"]
    assert 1e-10 < max(bounds.values()) < equations.LARGEST_STEADY_STATE_ERROR
    # the twin: as slow, but an F that is off by a hundredth of the zero
    false = design.gains["F"] * 1.01
    assert verdicts(problem, design.gains | {"F": false})["rounding"] == "refuted"


@pytest.mark.parametrize("fast", [1e2, 1e6, 1e8])
def test_a_false_gain_in_a_stiff_plant_is_refuted(fast: float) -> None:
    problem = unknown_input_problem(
        np.diag([-1.0, -fast, -1.0]), [[0, 1, 0], [0, 0, 1]], [[0], [0], [1]]
    )
    design = obsdesign.design(problem)
    gains, step = dict(design.gains), 1e-4
    slow = int(np.argmax(np.abs(gains["T"][:, 0])))
    H = gains["H"].copy()
    H[slow, 1] += step
    assert verdicts(problem, gains | {"H": H})["rounding"] == "refuted"
    assert set(verdicts(problem, gains).values()) == {"proved"}  # the twin
    # and the claim is true: at rest with y = (0, 1), the false one is off for ever
    observer = type(from_design(design)).from_gains(gains | {"H": H})
    batch = observer.run_batch(0.1 * np.arange(400), np.tile([0.0, 1.0], (400, 1)), x=[0, 0, 1])
    assert abs(batch.x[-1, 0]) == pytest.approx(step, rel=1e-3)


@given(st.integers(0, 10_000), st.sampled_from([3, 5]))
@settings(max_examples=12, deadline=None)
def test_units_of_the_states_change_no_verdict(seed: int, decades: int) -> None:
    rng = np.random.default_rng(seed)
    n, q = int(rng.integers(2, 7)), int(rng.integers(1, 3))
    q = min(q, n - 1)
    A, C, D = random_plant(rng, n, min(n, q + int(rng.integers(0, 2))), q)
    kind = int(rng.integers(3))
    A = np.diag(np.diag(A)) if kind == 0 else np.tril(A) if kind == 1 else A
    s = 10.0 ** rng.choice([-decades, 0, decades], n)
    plain = obsdesign.investigate(unknown_input_problem(A, C, D))
    scaled = obsdesign.investigate(unknown_input_problem(A * s[:, None] / s, C / s, D * s[:, None]))
    assert plain.verdict == scaled.verdict
    assert [c.verdict for c in plain.claims] == [c.verdict for c in scaled.claims]


CELL = (
    [[-0.6, -2.6, 12000], [-2.3, -1.8, -22000], [0.00017, -3e-5, -4.5]],
    [[0.015, 0.041, 360], [-0.012, 0.001, 100]],
    [[180], [10], [-0.022]],
)


def test_units_hide_no_state_from_the_gain() -> None:
    assert (
        np.linalg.eigvals(obsdesign.design(unknown_input_problem(*CELL)).gains["F"]).real.max()
        < -0.1
    )
    placed = obsdesign.design(unknown_input_problem(*CELL, poles=[-3, -1.5]))
    poles = np.sort(np.linalg.eigvals(placed.gains["F"]).real)
    np.testing.assert_allclose(poles, [-3, -1.5], rtol=1e-8)
    with pytest.raises(obsdesign.InputError, match=r"must give 2 poles \(n - q = 2"):
        obsdesign.design(unknown_input_problem(*CELL, poles=[-3]))


def test_poles_that_grow_are_refuted() -> None:
    assert obsdesign.investigate(unknown_input_problem(*CELL, poles=[1, -2])).verdict == "refuted"
    assert obsdesign.investigate(unknown_input_problem(*CELL, poles=[-1, -2])).verdict == "proved"


@pytest.mark.parametrize("units", [1.0, 1e-10, 1e10])
def test_the_rank_is_in_no_unit_of_the_states(units: float) -> None:
    s = np.array([1.0, units, 1.0])
    A = np.array([[-1, 1, 0], [1, -3, 0], [0, 0, -1.0]]) * s[:, None] / s
    D, C = np.array([[1.0], [1], [0]]) * s[:, None], np.array([[1, 0.3, 0], [1, -0.5, 0]]) / s
    outcome = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert outcome.verdict == "proved"
    assert outcome.claims[1].evidence["approx_margin"] > 0.1
    # the twin: what cancels is refused in every unit, and said by how much
    C = np.array([[1, -1 + 1e-11, 0], [2, -2, 0]]) / s
    refused = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert refused.verdict == "refuted"
    assert "C D cancels to" in refused.claims[0].evidence["witness"]["reason"]


def test_the_first_state_is_checked() -> None:
    rng = np.random.default_rng(0)
    problem = unknown_input_problem(*random_plant(rng, 5, 3, 2))
    gains = dict(obsdesign.design(problem).gains)
    for change in (1e-4, 1e6):
        wrong = gains["first"] * (1 + change)
        assert verdicts(problem, gains | {"first": wrong})["consistent"] == "refuted"
    assert verdicts(problem, gains)["consistent"] == "proved"


@pytest.mark.parametrize("rate", [1.0, 0.5, 4.0])
def test_a_refuted_error_is_no_larger_than_the_true_one(rate: float) -> None:
    """e' = -rate e + step x1 leaves step / rate: exact in floats, and a lower bound lies below."""
    step = 2.0**-10
    zero, one = np.zeros((1, 1)), np.ones((1, 1))
    drives = equations.ErrorDrives(
        error=equations.Drive(x=exact(step * one), u=exact(zero), d=exact(zero)),
        state=equations.Drive(x=exact(zero), u=exact(zero), d=exact(zero)),
        input=equations.Drive(x=exact(zero), u=exact(zero), d=exact(zero)),
    )
    matrices = SimpleNamespace(F=exact(-rate * one), X=exact(one), Q=exact(zero))
    verdict = steady_state_error._verdict(drives, matrices, 1.0)  # type: ignore[arg-type]
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]
    assert witness["estimate"] == "x1"
    assert step / rate * (1 - 1e-8) < witness["error"] < step / rate


@pytest.mark.parametrize("parts", [(0.1, 0.2, 0.3), (0.7, 0.0, 0.1), (0.3, 1e-17, 1e-17)])
def test_a_proved_error_is_no_smaller_than_the_true_one(parts: tuple[float, ...]) -> None:
    """Nothing drives e, and x, u and d of unit size enter the estimate with one sign."""
    zero = np.zeros((1, 1))
    x, u, d = (1e-10 * part * np.ones((1, 1)) for part in parts)
    still = equations.Drive(x=exact(zero), u=exact(zero), d=exact(zero))
    direct = equations.Drive(x=exact(x), u=exact(u), d=exact(d))
    drives = equations.ErrorDrives(error=still, state=direct, input=still)
    matrices = SimpleNamespace(F=exact(-np.ones((1, 1))), X=exact(zero), Q=exact(zero))
    verdict = steady_state_error._verdict(drives, matrices, 1.0)  # type: ignore[arg-type]
    assert verdict.outcome == "proved"
    bound = Fraction(verdict.evidence["bounds"]["state"])
    true = sum(Fraction(part.item()) for part in (x, u, d))
    assert true <= bound <= true * Fraction(1 + 3e-9)
