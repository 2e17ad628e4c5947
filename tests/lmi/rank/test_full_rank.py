"""Full rank of stacks over boxes of thetas: proofs, witnesses, laws, brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import exact, precision, rational, scalar
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.norms import nonnegative_inverse
from lmi.bounds.largest_norm import inverse_norm_over, norm_over
from lmi.rank.decide import decide_full_rank, prove_again
from lmi.rank.full_rank import prove_full_rank
from lmi.rank.hidden_mode import check_hiding, propose_hiding
from lmi.rank.stack import Stack, approx_margin, coordinates
from lmi.rank.witness import MARGIN, check_deficient
from lmi.time_budget import TimeBudget

TURN = np.array([[0.0, 2 * np.pi], [-2 * np.pi, 0.0]])


def chain(n: int, diagonal: float = 0.0) -> np.ndarray:
    return np.diag(np.ones(n - 1), 1) + diagonal * np.eye(n)


def stack(F, blocks, C=None, H=None, right=None, flows_first=False) -> Stack:
    n = len(F)
    C = np.eye(n)[:1] if C is None else C
    H = np.eye(n) if H is None else H
    right = np.eye(n) if right is None else right
    return Stack(exact(F), exact(H), exact(C), exact(right), blocks, flows_first)


def sampled_sigma(s: Stack, low: float, high: float, count: int = 4000) -> float:
    """Independent of the module under test: products one by one."""
    rng = np.random.default_rng(5)
    thetas = np.where(
        rng.random((count, s.thetas)) < 0.3,
        rng.choice([low, high], (count, s.thetas)),
        rng.uniform(low, high, (count, s.thetas)),
    )
    return min(float(np.linalg.svd(matrix, compute_uv=False)[-1]) for matrix in s.approx(thetas))


@pytest.mark.parametrize(
    ("s", "low", "high"),
    [
        (stack(chain(2, -0.1), 2), 0.2, 0.8),
        (stack(chain(3), 3), 0.1, 0.8),
        (stack(chain(3, -0.1), 4), 0.3, 0.6),
        (stack(TURN, 2), 0.1, 0.4),
        (stack(TURN, 3), 0.41, 0.49),
        (stack(np.diag([0.0, 0.3]), 1, C=np.eye(2)), 0.0, 1.0),
        (stack(chain(4), 3, H=np.diag([1.0, 1, 1, 0]), right=np.eye(4)[:, :3], flows_first=True), 0.1, 0.8),
        (stack(np.array([[0.0, 1], [4, 0]]), 1, H=np.diag([1.0, 0]), right=np.eye(2)[:, :1], flows_first=True), 0.1, 0.8),
        (stack(chain(2), 2), 0.5, 0.5),
    ],
)  # fmt: skip
def test_bounds_hold_against_brute_force(s: Stack, low: float, high: float) -> None:
    verdict = decide_full_rank(s, low, high)
    assert verdict.outcome == "proved", verdict.evidence
    assert 0 < verdict.evidence["sigma_min"] <= sampled_sigma(s, low, high)
    assert verdict.evidence["margin"] > MARGIN
    R, full = coordinates(s, low, high)
    assert full
    rng = np.random.default_rng(2)
    for window in s.approx(rng.uniform(low, high, (300, s.thetas))):
        # what the bounds of convergence are made of
        assert np.linalg.norm(window @ np.linalg.inv(R), 2) <= verdict.evidence["largest"]
    again = prove_again(s, low, high, verdict.evidence["asked"])
    assert again.outcome == "proved"


def test_the_spline_needs_few_boxes_and_its_bound_is_close() -> None:
    s = stack(chain(3), 3)
    verdict = decide_full_rank(s, 0.1, 0.8)
    assert verdict.evidence["approx_sigma_min"] == pytest.approx(0.0040622001, rel=1e-7)
    assert verdict.evidence["approx_worst"] == [0.1, 0.1]
    assert verdict.evidence["sigma_min"] > 0.5 * verdict.evidence["approx_sigma_min"]
    assert verdict.evidence["boxes"] < 400


def test_the_basis_of_the_state_does_not_matter() -> None:
    plain = decide_full_rank(stack(chain(3), 3), 0.1, 0.8)
    for seed in range(6):
        T = np.random.default_rng(seed).standard_normal((3, 3))
        back = np.linalg.inv(T)
        turned = decide_full_rank(stack(T @ chain(3) @ back, 3, C=np.eye(3)[:1] @ back), 0.1, 0.8)
        assert turned.outcome == "proved"
        assert turned.evidence["boxes"] == plain.evidence["boxes"]
        assert turned.evidence["margin"] == pytest.approx(plain.evidence["margin"], rel=1e-5)


@pytest.mark.parametrize("exponent", [-30, 30])
def test_units_of_time_and_state_do_not_matter(exponent: int) -> None:
    unit = 2.0**exponent
    scaled = stack(chain(3) * unit, 3, C=np.eye(3)[:1] / unit)
    verdict = decide_full_rank(scaled, 0.1 / unit, 0.8 / unit)
    assert verdict.outcome == "proved"
    assert (
        verdict.evidence["boxes"]
        == decide_full_rank(stack(chain(3), 3), 0.1, 0.8).evidence["boxes"]
    )


def test_a_larger_box_never_helps() -> None:
    margins = [
        decide_full_rank(stack(chain(3), 3), low, 0.8).evidence["approx_sigma_min"]
        for low in (0.4, 0.2, 0.1, 0.05)
    ]
    assert margins == sorted(margins, reverse=True)
    assert decide_full_rank(stack(chain(3), 3), 0.0, 0.8).outcome == "refuted"


def test_half_a_turn_hides_a_state() -> None:
    inside = decide_full_rank(stack(TURN, 2), 0.4, 0.6)
    witness = inside.evidence["witness"]
    assert inside.outcome == "refuted"
    assert witness["thetas"] == pytest.approx([0.5], abs=1e-9)
    assert np.abs(witness["null_vector"]) == pytest.approx([0, 1], abs=1e-9)
    assert "sign change" in witness["method"]
    for low, high in ((0.1, 0.4), (0.51, 0.9)):
        assert decide_full_rank(stack(TURN, 2), low, high).outcome == "proved"


def test_more_blocks_need_a_vector_as_witness() -> None:
    verdict = decide_full_rank(stack(TURN, 3), 0.41, 0.6)
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]
    assert witness["thetas"] == pytest.approx([0.5, 0.5], abs=1e-9)
    assert witness["ratio"] < MARGIN
    assert check_deficient(stack(TURN, 3), 0.41, 0.6, witness).outcome == "refuted"
    # the twins: another place, a place outside the box
    assert (
        check_deficient(stack(TURN, 3), 0.41, 0.6, {"thetas": [0.5, 0.45]}).outcome == "undecided"
    )
    assert check_deficient(stack(TURN, 3), 0.41, 0.49, witness).outcome == "undecided"
    assert check_deficient(stack(TURN, 3), 0.41, 0.6, {"thetas": "no"}).outcome == "undecided"


def test_what_is_destroyed_unseen_is_found_exactly() -> None:
    lost = decide_full_rank(stack(chain(4), 4, H=np.diag([1.0, 1, 1, 0])), 0.1, 0.8)
    assert lost.evidence["witness"]["null_vector"] == [0.0, 0.0, 0.0, 1.0]
    assert lost.evidence["witness"]["method"] == "exact"
    few = decide_full_rank(stack(chain(3), 2), 0.1, 0.8)
    assert few.evidence["witness"]["reason"] == "2 measured numbers cannot tell 3 states apart"


def test_a_proof_that_must_not_succeed_does_not() -> None:
    s = stack(TURN, 3)
    R, full = coordinates(s, 0.4, 0.6)
    assert full
    verdict = prove_full_rank(s, 0.4, 0.6, R, limit=300)
    assert verdict.outcome == "undecided"
    assert verdict.evidence["thetas"] == pytest.approx([0.5, 0.5], abs=0.02)
    few = prove_full_rank(
        stack(chain(4), 4), 0.01, 2.0, coordinates(stack(chain(4), 4), 0.01, 2.0)[0], limit=50
    )
    assert few.outcome == "undecided"
    assert "50 boxes did not suffice" in few.evidence["reason"]
    with pytest.raises(ValueError, match="both finite"):
        prove_full_rank(s, 0.4, np.inf, R)


JORDAN = np.array([[1.0, 1], [0, 1]])


def test_outputs_that_grow_by_many_orders_cost_no_boxes() -> None:
    """det O = theta e^theta: never zero on [0.1, 10], by five orders of magnitude."""
    verdict = decide_full_rank(stack(JORDAN, 2), 0.1, 10.0)
    assert verdict.outcome == "proved"
    assert verdict.evidence["boxes"] < 50
    assert verdict.evidence["sigma_min"] <= sampled_sigma(stack(JORDAN, 2), 0.1, 10.0)
    # the twin: with 0 in the range the determinant has a zero
    assert decide_full_rank(stack(JORDAN, 2), 0.0, 10.0).outcome == "refuted"


def test_a_jump_that_mixes_fast_and_slow_modes() -> None:
    A = np.array([[1.0, 0, 0], [-1, -2, 0], [-1, 3, 2]])
    G = np.array([[0.62, 0, -1.19], [-0.84, 0, -0.67], [0.09, 0, 2.34]])
    s = stack(A, 3, C=np.array([[-0.7, -1.5, -0.9]]), H=G)
    verdict = decide_full_rank(s, 0.31, 0.91)
    assert verdict.outcome == "proved"
    assert verdict.evidence["sigma_min"] <= sampled_sigma(s, 0.31, 0.91)


@pytest.mark.parametrize("mu", [-3.0, -1.0, 1.0, 3.0])
@pytest.mark.parametrize(
    ("F", "blocks", "low", "high", "outcome"),
    [
        (chain(3), 3, 0.1, 0.8, "proved"),
        (chain(2), 2, 0.01, 40.0, "proved"),
        (TURN, 2, 0.51, 0.9, "proved"),
        (TURN, 2, 0.4, 0.6, "refuted"),
        (TURN, 3, 0.41, 0.6, "refuted"),
    ],
)
def test_a_common_growth_of_all_modes_changes_no_verdict(
    F: np.ndarray, blocks: int, low: float, high: float, outcome: str, mu: float
) -> None:
    shifted = stack(F + mu * np.eye(len(F)), blocks)
    verdict = decide_full_rank(shifted, low, high)
    assert verdict.outcome == outcome
    if outcome == "proved":
        plain = decide_full_rank(stack(F, blocks), low, high)
        assert verdict.evidence["boxes"] == pytest.approx(plain.evidence["boxes"], rel=0.1)
        # beyond, floats do not resolve the least singular value
        assert verdict.evidence["sigma_min"] <= sampled_sigma(shifted, low, min(high, 2.0), 500)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([-40, -7, 7, 40]))
def test_powers_of_two_as_units_change_nothing(seed: int, exponent: int) -> None:
    rng = np.random.default_rng(seed)
    F, C = rng.standard_normal((2, 2)), rng.standard_normal((1, 2))
    plain = decide_full_rank(stack(F, 2, C=C), 0.2, 0.9, limit=300)
    unit, states = 2.0**exponent, np.exp2(rng.integers(-20, 20, 2))
    scaled = stack(F * unit * states / states[:, None], 2, C=C * states)
    verdict = decide_full_rank(scaled, 0.2 / unit, 0.9 / unit, limit=300)
    assert verdict.outcome == plain.outcome
    if plain.outcome == "proved":
        assert verdict.evidence["boxes"] == plain.evidence["boxes"]


def test_a_zero_of_a_block_row_inside_the_box_is_never_proved() -> None:
    """The cosine of the turn is zero at a quarter, and again half a turn later."""
    first = np.eye(2)[:, :1]
    for blocks, high in ((1, 0.4), (2, 0.6)):
        s = stack(TURN, blocks, right=first, flows_first=True)
        assert decide_full_rank(s, 0.1, high, limit=500).outcome != "proved"
    inside = stack(TURN, 1, right=first, flows_first=True)
    assert decide_full_rank(inside, 0.1, 0.24).outcome == "proved"


E1 = np.eye(2)[:, :1]
TWICE = np.array([[1.0, 0], [2, 0]])
SHIFT = np.array([[0.0, 1], [0, 0]])
# (stack, a range with the zero inside, one beside it): fewer columns than rows, zeros at a quarter
VANISHING = [
    (stack(TURN, 1, C=TWICE, right=E1, flows_first=True), (0.2, 0.3), (0.26, 0.3)),
    (stack(TURN - 4 * np.eye(2), 1, C=TWICE, right=E1, flows_first=True), (0.2, 0.3), (0.1, 0.24)),
    (stack(TURN, 3, H=SHIFT), (0.2, 0.3), (0.2, 0.24)),
    (stack(TURN / 1e6, 4, H=SHIFT), (2e5, 3e5), (2.51e5, 3e5)),
]


@pytest.mark.parametrize(("s", "inside", "beside"), VANISHING)
def test_block_rows_that_pass_through_zero_together_refute(s: Stack, inside, beside) -> None:
    """As tall as they are, nothing is seen where they vanish; that place is no binary number."""
    verdict = decide_full_rank(s, *inside, limit=200)
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]
    assert 0.25 in [
        round(theta * 10 ** -np.floor(np.log10(theta) + 1), 9) for theta in witness["thetas"]
    ]
    assert check_deficient(s, *inside, witness).outcome == "refuted"
    assert (
        check_deficient(s, *inside, {"thetas": [0.999 * inside[1]] * s.thetas}).outcome
        == "undecided"
    )
    assert decide_full_rank(s, *beside, limit=200).outcome == "proved"


@pytest.mark.parametrize("blocks", [2, 3])
def test_block_rows_that_vanish_one_after_the_other_are_proved(blocks: int) -> None:
    s = stack(TURN, blocks, right=E1, flows_first=True)
    verdict = decide_full_rank(s, 0.19, 0.31, limit=100)
    assert verdict.outcome == "proved"
    assert verdict.evidence["sigma_min"] <= sampled_sigma(s, 0.19, 0.31)


def test_a_pair_of_places_is_no_witness_for_a_tall_stack() -> None:
    tall = stack(TURN, 3)
    pair = {"between": [[0.2, 0.2], [0.8, 0.8]]}
    assert check_deficient(tall, 0.1, 0.9, pair).outcome == "undecided"
    assert (
        check_deficient(stack(TURN, 2), 0.1, 0.9, {"between": [[0.2], [0.8]]}).outcome == "refuted"
    )


def test_block_rows_that_only_decay_do_not_vanish() -> None:
    """e^(-20 theta) and 1: by e^-60 over the range, and of full rank everywhere."""
    s = stack(np.diag([-20.0, 0.0]), 1, H=np.diag([1.0, 1]), right=E1, flows_first=True)
    tall = stack(np.diag([-20.0, 0.0]), 1, C=TWICE, right=E1, flows_first=True)
    for each in (s, tall):
        assert decide_full_rank(each, 0.0, 3.0).outcome == "proved"
        assert check_deficient(each, 0.0, 3.0, {"thetas": [3.0]}).outcome == "undecided"


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_random_systems_never_contradict(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    F, H = rng.standard_normal((n, n)), rng.standard_normal((n, n))
    if rng.random() < 0.4:
        H[:, 0] = 0
    low = float(rng.uniform(0.05, 0.5))
    high = low + float(rng.uniform(0, 0.6))
    s = stack(F, int(rng.integers(1, 4)), C=rng.standard_normal((p, n)), H=H)
    verdict = decide_full_rank(s, low, high, limit=400)
    sigma = sampled_sigma(s, low, high, 200)
    if verdict.outcome == "proved":
        assert verdict.evidence["sigma_min"] <= sigma
    if verdict.outcome == "refuted" and "null_vector" in verdict.evidence["witness"]:
        x = np.array(verdict.evidence["witness"]["null_vector"])
        thetas = verdict.evidence["witness"].get("thetas", [low] * s.thetas)
        window = s.approx(np.array([thetas]).reshape(1, s.thetas))[0]
        assert np.linalg.norm(window @ x) <= 1e-6 * np.linalg.norm(window) * np.linalg.norm(x)


def test_hidden_modes_are_found_and_checked() -> None:
    forever = stack(TURN, 3)
    theta = propose_hiding(forever, 0.4, 0.6)
    assert theta == pytest.approx(0.5, abs=1e-9)
    verdict = check_hiding(forever.F, forever.H, forever.C, theta)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["mode"]["real"] == pytest.approx(-1)
    # the twins: damping, and a place where nothing is hidden
    damped = exact(TURN - 0.1 * np.eye(2))
    assert check_hiding(damped, forever.H, forever.C, 0.5).outcome == "undecided"
    assert check_hiding(forever.F, forever.H, forever.C, 0.45).outcome == "undecided"
    assert propose_hiding(forever, 0.1, 0.4) is None


@pytest.mark.parametrize("seed", range(5))
def test_largest_norms_are_bounds_and_close(seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, left, right = (
        2 * rng.standard_normal((3, 3)),
        rng.standard_normal((2, 3)),
        rng.standard_normal((3, 2)),
    )
    flows = expm(F * np.linspace(0.1, 0.9, 400)[:, None, None])
    with precision(128):
        bound = float(norm_over(exact(left), exact(F), exact(right), 0.1, 0.9).abs_upper())
        back = inverse_norm_over(exact(np.eye(3)), exact(F), exact(np.eye(3)), 0.1, 0.9)
    largest = np.linalg.norm(left @ flows @ right, 2, axis=(1, 2)).max()
    assert largest <= bound < 1.5 * largest
    inverse = np.linalg.norm(np.linalg.inv(flows), 2, axis=(1, 2)).max()
    assert inverse <= float(back.abs_upper()) < 2.0 * inverse


def test_margins_are_those_of_the_coordinates() -> None:
    s = stack(chain(3), 3)
    R, _ = coordinates(s, 0.1, 0.8)
    assert approx_margin(s, np.full((1, 2), 0.45), R) == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("size", "exists"), [(0.3, True), (0.499, True), (0.501, False), (2.0, False)]
)
def test_small_gains_are_told_from_large_ones(size: float, exists: bool) -> None:
    # two blocks, spectral radius 2 size; the cascade above the diagonal does not matter
    M = [[size, 5.0], [0.0, size]] if size == 2.0 else [[size, size], [size, size]]
    with precision(128):
        back = nonnegative_inverse([[scalar(rational(x)) for x in row] for row in M])
        if not exists:
            assert back is None
            return
        inverse = np.array([[float(x) for x in row] for row in back])
    np.testing.assert_allclose(inverse, np.linalg.inv(np.eye(2) - np.array(M)), rtol=1e-12)


@pytest.mark.parametrize(("F", "theta"), [
    (np.array([[0.0, 1.0], [-1.0, 0.0]]), np.pi), (TURN, 1.0), (TURN / 3, 3.0),
])  # fmt: skip
@pytest.mark.parametrize("blocks", [2, 3])
def test_a_range_of_one_point_is_decided_by_one_evaluation(
    F: np.ndarray, theta: float, blocks: int
) -> None:
    """Next to a spacing that shows one state alone: binary64 misses it by 1e-16."""
    s = stack(F, blocks)
    verdict = decide_full_rank(s, theta, theta)
    assert verdict.outcome in ("proved", "refuted")
    assert verdict.evidence.get("boxes", 1) == 1
    if verdict.outcome == "proved":
        assert 0 < verdict.evidence["sigma_min"] < 1e-14
    else:
        assert verdict.evidence["witness"]["ratio"] < MARGIN
    # the twins: the spacing itself is inside the range, or the rank is lost at the point
    assert decide_full_rank(s, 0.9 * theta, theta).outcome == "refuted"
    assert decide_full_rank(stack(0 * F, blocks), theta, theta).outcome == "refuted"


def test_a_point_that_no_precision_decides_says_so() -> None:
    """The least singular value is 1, and more is demanded: neither boxes nor time help."""
    s = stack(chain(2), 2)
    R, _ = coordinates(s, 0.5, 0.5)
    verdict = prove_full_rank(s, 0.5, 0.5, R, margin=10.0, budget=TimeBudget.from_seconds(1e-9))
    assert verdict.outcome == "undecided"
    assert "one point" in verdict.evidence["reason"]
    assert set(verdict.evidence) == {"reason", "thetas", "boxes"}
