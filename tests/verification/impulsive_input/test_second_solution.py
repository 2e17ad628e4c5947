"""Second answers to (17): every witness holds when evaluated anew, and none contradicts a theorem."""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import ball, exact, precision
from lmi.arithmetic.exponential import expm
from lmi.prove import exponential_sign as signs
from obsdesign.equations.impulsive_input.features import FeatureWindow, filtered_system
from obsdesign.verification.impulsive_input.second_solution import FeatureCurve, _meetings
from obsdesign.verification.impulsive_input.uniqueness import decide_uniqueness

TWO_MODES = (np.diag([-0.5, -1.0]), np.array([[1.0, 1.0]]), np.array([[2.0], [-3.0]]))


def features(D: Any, C: Any, H: Any, exponents: Any, age: float) -> Any:
    n = len(D)
    return expm(filtered_system(D, C, np.asarray(exponents)) * age)[n:, :n] @ H[:, 0]


def decided(
    D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float, nonnegative: bool = False
) -> Any:
    plant = exact(D), exact(C), exact(H)
    return decide_uniqueness(
        FeatureWindow(*plant, exponents=list(exponents), tau=window, margin=margin), nonnegative
    )


def middle(age: Any) -> float:
    return float(np.mean(age))


def random_plant(rng: np.random.Generator) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """D, C, H and three exponents; with three states a pair of complex modes."""
    n = int(rng.integers(2, 4))
    D = np.diag(-rng.uniform(0.2, 2, n))
    if n == 3:
        D[:2, :2] = [[-0.2, 2.0], [-2.0, -0.2]]
    C, H = rng.standard_normal((1, n)), rng.standard_normal((n, 1))
    return D, C, H, -np.cumsum(rng.uniform(0.3, 1.0, 3))


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_three_features_of_random_plants(seed: int) -> None:
    rng = np.random.default_rng(seed)
    refuted = 0
    for _ in range(4):
        D, C, H, exponents = random_plant(rng)
        window, margin = 5.0, 0.2
        verdict = decided(D, C, H, exponents, window, margin)
        if verdict.outcome != "refuted":
            continue
        refuted += 1
        witness = verdict.evidence["witness"]
        first, second = map(middle, witness["ages"])
        assert margin <= first < second <= window
        b1, b2 = (features(D, C, H, exponents, age) for age in (first, second))
        g1, g2 = witness["weights"]
        np.testing.assert_allclose(g1 * b1, g2 * b2, atol=1e-6 * np.abs(b1).max())
    assert refuted


@pytest.mark.parametrize("seed", [193, 0, 2])
def test_a_coarse_grid_leads_to_the_same_two_ages_as_a_fine_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    D, C, H, exponents = random_plant(rng)
    n, tau, margin = len(D), 5.0, 0.2
    F = filtered_system(exact(D), exact(C), exact(exponents))
    pairs = []
    for cells in (200, 40):
        b = [features(D, C, H, exponents, age) for age in np.linspace(margin, tau, cells + 1)]
        z = np.vstack([exact(H), exact(np.zeros((3, 1)))])
        curve = FeatureCurve(F=F, z=z, n=n, b=np.array(b), margin=margin, tau=tau)
        pairs.append(sorted({(round(s, 6), round(r, 6)) for s, r in _meetings(curve)}))
    assert pairs[0] == pairs[1] != []
    for ages in pairs[0]:
        first, second = (features(D, C, H, exponents, age) for age in ages)
        sine = np.linalg.norm(np.cross(first, second))
        assert sine < 1e-4 * np.linalg.norm(first) * np.linalg.norm(second)


def test_three_outputs_may_share_a_second_answer_too() -> None:
    D, C, H = TWO_MODES
    again = np.vstack([C, 2 * C, C])  # the same output: three features of one exponent each
    assert decided(D, again, H, [-2.0], 5.0, 0.1).outcome != "proved"


def test_outside_the_ages_that_are_searched_a_second_answer_does_not_count() -> None:
    D, C, H = TWO_MODES
    for margin, window, outcome in ((0.1, 5.0, "refuted"), (0.6, 5.0, "undecided"),
                                    (0.1, 2.1, "undecided"), (0.5, 2.2, "refuted")):  # fmt: skip
        verdict = decided(D, C, H, [-2.0, -3.0, -4.0], window, margin)
        # elsewhere it may be proved: the plane curve may turn one way
        assert verdict.outcome == outcome or (verdict.outcome, outcome) == ("proved", "undecided")


def test_a_plant_without_zeros_has_none() -> None:
    D = np.array([[-0.5, 0.0], [1.0, -1.0]])
    verdict = decided(D, np.array([[0.0, 1.0]]), np.array([[1.0], [0.0]]), [-2, -3, -4], 5.0, 0.1)
    assert verdict.outcome == "proved"


# --- nonnegative weights --------------------------------------------------------------------------


def turned(
    D: Any, C: Any, H: Any, exponents: Any, window: float, margin: float
) -> tuple[Any, bool]:
    """(angle by which two features turn, is it always one way?), on a grid."""
    b = np.array([features(D, C, H, exponents, age) for age in np.linspace(margin, window, 301)])
    angle = np.unwrap(np.arctan2(b[:, 1] / np.abs(b[:, 1]).max(), b[:, 0] / np.abs(b[:, 0]).max()))
    steps = np.diff(angle)
    return abs(angle[-1] - angle[0]), bool((steps > 0).all() or (steps < 0).all())


def turning_plants(count: int) -> Any:
    for seed in range(count):
        rng = np.random.default_rng(seed)
        speed = rng.uniform(0.5, 3)
        D = np.array([[-0.2, speed], [-speed, -0.2]])
        H, C = rng.standard_normal((2, 1)), rng.standard_normal((1, 2))
        window = float(rng.uniform(1, 6))
        yield D, C, H, np.sort(-rng.uniform(0.1, 4, 2))[::-1], window, 0.2 * window


def test_of_nonnegative_weights_less_than_a_whole_turn_is_unique() -> None:
    proved = refuted = 0
    for plant in turning_plants(14):
        angle, one_way = turned(*plant)
        signed, positive = decided(*plant), decided(*plant, nonnegative=True)
        if signed.outcome == "proved":  # fewer weights never have more answers
            assert positive.outcome == "proved"
        if positive.outcome == "proved":
            assert one_way
            assert angle < 2 * np.pi
            proved += signed.outcome == "refuted"
        if positive.outcome == "refuted":
            witness = positive.evidence["witness"]
            first, second = map(middle, witness["ages"])
            g1, g2 = witness["weights"]
            assert g1 > 0
            assert g2 > 0
            b1, b2 = (features(*plant[:4], age) for age in (first, second))
            np.testing.assert_allclose(g1 * b1, g2 * b2, atol=1e-6 * np.abs(b1).max())
            refuted += 1
        if one_way and np.pi * 1.05 < angle < 1.9 * np.pi:
            assert (signed.outcome, positive.outcome) == ("refuted", "proved")
    assert proved
    assert refuted


def test_a_second_weight_may_be_smaller_than_the_first() -> None:
    """Features of modes that grow: the younger of two impulses is the larger one."""
    for seed in (0, 7, 22):
        D, *plant = list(turning_plants(seed + 1))[-1]
        D = D + 0.5 * np.eye(2)
        witness = decided(D, *plant, nonnegative=True).evidence["witness"]
        first, second = map(middle, witness["ages"])
        g1, g2 = witness["weights"]
        assert 0 < g2 < g1
        b1, b2 = (features(D, *plant[:3], age) for age in (first, second))
        np.testing.assert_allclose(g1 * b1, g2 * b2, atol=1e-6 * np.abs(b2).max())


def test_three_features_and_one_feature_of_nonnegative_weights() -> None:
    D, C, H = TWO_MODES
    exponents = [-2.0, -3.0, -4.0]
    weights = decided(D, C, H, exponents, 5.0, 0.1).evidence["witness"]["weights"]
    assert min(weights) < 0  # the sign of h changes: so does that of the second answer
    assert decided(D, C, H, exponents, 5.0, 0.1, nonnegative=True).outcome != "refuted"
    witness = decided(D, C, H, [-2.0], 5.0, 0.1, nonnegative=True).evidence["witness"]
    assert min(witness["weights"]) > 0
    b = [features(D, C, H, [-2.0], age)[0] for age in witness["ages"]]
    assert b[0] * witness["weights"][0] == pytest.approx(b[1] * witness["weights"][1])


# --- how long it may take -------------------------------------------------------------------------


def test_a_stiff_plant_with_many_features_is_undecided_soon() -> None:
    rng = np.random.default_rng(1)
    D = np.diag([-0.2, -0.2, -0.5, -2e4])
    D[:2, :2] = [[-0.2, 3.0], [-3.0, -0.2]]
    T = np.diag([3e3, 1.0, 0.02, 1.0]) @ rng.standard_normal((4, 4))
    D, C, H = T @ D @ np.linalg.inv(T), rng.standard_normal((1, 4)), T @ rng.standard_normal((4, 1))
    start = time.process_time()
    verdict = decided(D, C, H, [-0.7, -1.5, -2.0, -2.7], 5.0, 0.2)
    assert verdict.outcome == "undecided"
    assert "too much to cover" in verdict.evidence["reason"]
    assert time.process_time() - start < 20  # a few seconds; minutes without its budget


@pytest.mark.parametrize("nonnegative", [False, True])
def test_units_of_states_and_outputs_change_no_verdict(nonnegative: bool) -> None:
    D, H = np.array([[-0.3, -0.5, 0.0], [0.6, -0.4, 0.0], [0.0, 0.5, -0.7]]), np.eye(3)[:, :1]
    C = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.3]])
    x, y = np.array([1e5, 1.0, 1e-5]), np.array([1e-7, 1e6])
    verdicts = [
        decided(*plant, [-0.6, -0.9], 5.0, 1.2, nonnegative=nonnegative)
        for plant in (
            (D, C, H), (D * x[:, None] / x, C * y[:, None] / x, H * x[:, None])
        )
    ]  # fmt: skip
    assert [verdict.outcome for verdict in verdicts] == ["proved", "proved"]


def test_an_effort_ends_a_proof_and_nothing_else() -> None:
    F, z = exact(np.array([[0.0, 1.0], [-1.0, 0.0]])), exact(np.array([[1.0], [0.0]]))
    with precision(160):
        for end, sign in ((1.0, True), (1.7, False)):  # cos has its zero between
            enough, little = signs.Effort(100), signs.Effort(1)
            cover = signs.boxes(F, ball(z), 0.0, end, [0], effort=enough)
            assert signs.one_sign(cover, lambda box: box.rows[0], 1, enough)[0] in (
                (True,) if sign else (False, None)
            )
            assert enough.left < 100
            with pytest.raises(ValueError, match="too much to cover"):
                next(iter(signs.boxes(F, ball(z), 0.0, 2 * end, [0], effort=little)))


def test_bernstein_coefficients_are_those_of_the_polynomial() -> None:
    rng = np.random.default_rng(0)
    p = rng.standard_normal(9).tolist()
    b = signs._bernstein(p)
    assert b[0] == p[0]
    assert b[-1] == pytest.approx(sum(p))
    for s in (0.2, 0.7):
        while len(c := b) > 1:
            b = [(1 - s) * x + s * y for x, y in itertools.pairwise(c)]
        assert b[0] == pytest.approx(np.polynomial.polynomial.polyval(s, p))
        b = signs._bernstein(p)
