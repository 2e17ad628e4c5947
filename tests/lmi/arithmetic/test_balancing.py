"""Balanced and graded coordinates: units of states and time change no verdict; twins."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balancing import Scaling
from lmi.arithmetic.balls import exact
from lmi.arithmetic.units import balance
from lmi.decide.dwell_search import dwell_bracket
from lmi.decide.stability import decide
from lmi.find.copositive import decide_copositive
from lmi.find.largest_rates import largest_rates
from lmi.prove.common_matrix import METHODS, prove_common
from lmi.prove.positive import prove_copositive
from lmi.prove.rates import Rates, prove_rates
from tests.systems.pairs import PAPER_41, SAMPLED, radius, random_pair

Pair = tuple[np.ndarray, np.ndarray]


def scaled(pair: Pair, sizes: np.ndarray) -> Pair:
    """The pair in the coordinates diag(sizes) x."""
    F, H = (sizes[:, None] * X / sizes for X in pair)
    return F, H


def units(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.asarray(10.0 ** rng.uniform(-8, 8, n))


# --- laws -------------------------------------------------------------------------------------


# 27, 35, 38: undecided in these units without balancing
@pytest.mark.parametrize("seed", [*range(8), 27, 35, 38])
@pytest.mark.parametrize("high", [1.5, math.inf])
def test_units_of_states_and_time_change_no_verdict(seed: int, high: float) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    F, H = random_pair(rng, n, float(rng.choice([0.5, 0.7, 1.5, 3.0])))
    outcome = decide(F, H, 0.1, high).outcome
    assert outcome in ("proved", "refuted")
    pair, pace = scaled((F, H), units(rng, n)), 10.0 ** rng.uniform(-8, 8)
    fast, jump = pair[0] * pace, pair[1]
    ends = 0.1 / pace, high / pace
    verdict = decide(fast, jump, *ends)
    assert verdict.outcome == outcome
    if outcome == "proved":  # from the file, in the units of the file, by every method
        P = json.loads(json.dumps(verdict.evidence))["P"]
        assert {prove_common(fast, jump, P, *ends, method=m).outcome for m in METHODS} == {"proved"}
        assert prove_common(fast, 1e3 * jump, P, *ends).outcome != "proved"
    else:
        witness = verdict.evidence["witness"]
        thetas = np.array(witness.get("thetas", [witness.get("theta")])) * pace
        product = np.eye(n)
        for theta in thetas:  # in the well scaled units
            values, V = np.linalg.eig(F)
            product = (V * np.exp(values * theta) @ np.linalg.inv(V)).real @ H @ product
        assert np.abs(np.linalg.eigvals(product)).max() > 1 - 1e-9


@settings(max_examples=16, deadline=None)
@given(st.integers(1, 7), st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_scaling_is_exact_and_undone_exactly(n: int, seed: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    F, H = (rng.standard_normal((n, n)) * (rng.random((n, n)) <= density) for _ in range(2))
    numbers = [exact(X) for X in scaled((F, H), units(rng, n))]
    scaling = Scaling.from_pair(numbers[0], numbers[1], 1.0)
    assert (np.exp2(np.round(np.log2(scaling.sizes))) == scaling.sizes).all()
    for X in numbers:
        assert (scaling.undone.map(scaling.map(X)) == X).all()
    P = np.array(F @ F.T + np.eye(n))
    assert (scaling.undone.form(scaling.form(P)) == P).all()
    # the value of a form, and the identity M'PM - P, belong to the state and not to its units
    x = exact(rng.standard_normal((n, 1)))
    z = scaling.rows(x)
    assert (z.T @ scaling.form(exact(P)) @ z == x.T @ exact(P) @ x).all()
    assert (scaling.rows(numbers[1] @ x) == scaling.map(numbers[1]) @ z).all()


def test_ordinary_units_are_left_alone() -> None:
    for F, H in (PAPER_41, SAMPLED):
        assert Scaling.from_pair(exact(F), exact(H), 2.0).is_identity


def test_a_ring_and_a_chain() -> None:
    ring = np.array([[0.0, 1e6, 0], [0, 0, 1e-3], [1e-3, 0, 0]])
    d = balance(ring)
    entries = (d[:, None] * ring / d)[ring > 0]
    assert entries.max() / entries.min() < 8
    # states that nothing depends on get a large unit: couplings of a chain become at most one
    chain = np.triu(np.full((5, 5), 1e3), 1)
    order = np.array([3, 0, 4, 1, 2])
    for maps in (chain, chain.T, chain[np.ix_(order, order)]):
        d = balance(maps)
        assert (d[:, None] * maps / d).max() <= 2


# --- the cases that were undecided --------------------------------------------------------------


def test_one_entry_far_from_the_other() -> None:
    F = np.array([[-1.073, -3.64e-14], [-4.88e13, -1.146]])
    assert decide(F, 0.5 * np.eye(2), 0.1, 1.0).outcome == "proved"
    # the twin: its flow has the mode -1.1095 + 1.3333, and e^{0.2238 theta} / 2 > 1 from 3.1 on
    assert decide(F, 0.5 * np.eye(2), 0.1, 4.0).outcome == "refuted"


@pytest.mark.parametrize("seed", [7, 15, 20, 22])  # undecided without grading; and a few more
@pytest.mark.parametrize("diagonal", [0.0, 0.9])
def test_triangular_maps_have_the_verdict_of_their_diagonal(seed: int, diagonal: float) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    F, H = (np.triu(rng.standard_normal((n, n)) * 10.0 ** rng.uniform(0, 3, (n, n)), 1)
            for _ in range(2))  # fmt: skip
    F[np.diag_indices(n)] = rng.uniform(-2, -0.1, n)
    H[np.diag_indices(n)] = diagonal * rng.choice([-1, 1], n)
    order, sizes = rng.permutation(n), units(rng, n)
    place = np.ix_(order, order)
    pair = scaled((F[place], H[place]), sizes)
    verdict = decide(*pair, 0.1, 1.5)
    assert verdict.outcome == "proved"
    assert prove_common(*pair, verdict.evidence["P"], 0.1, 1.5).outcome == "proved"
    # the twin: one diagonal entry that grows
    H[0, 0] = 1.01 * math.exp(-0.1 * F[0, 0])
    assert decide(*scaled((F[place], H[place]), sizes), 0.1, 1.5).outcome == "refuted"


def test_blocks_on_the_diagonal_decide() -> None:
    rng = np.random.default_rng(3)
    F, H = np.zeros((5, 5)), np.zeros((5, 5))
    (F[:2, :2], H[:2, :2]), (F[2:, 2:], H[2:, 2:]) = (random_pair(rng, k, 0.6) for k in (2, 3))
    F[:2, 2:], H[:2, 2:] = 1e5 * rng.standard_normal((2, 2, 3))
    sizes = units(rng, 5)
    assert decide(*scaled((F, H), sizes), 0.1, 1.5).outcome == "proved"
    H[3, 3] += 5
    assert radius(F, H, 0.1) > 1
    assert decide(*scaled((F, H), sizes), 0.1, 1.5).outcome == "refuted"


# --- every certificate, in the units of the file --------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_positive_systems_in_any_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    F, H = rng.uniform(0, 1, (2, n, n))
    F -= np.diag(F.sum(axis=1) + 1)
    H *= 0.8 / H.sum(axis=1).max()
    flow, jump = scaled((F, H), units(rng, n))
    verdict = decide_copositive(flow, jump, 0.1, math.inf)
    assert verdict.outcome == "proved"
    how = {name: verdict.evidence[name] for name in ("side", "form")}
    v = verdict.evidence["vector"]
    assert prove_copositive(flow, jump, v, 0.1, math.inf, **how).outcome == "proved"
    assert prove_copositive(flow, 10 * jump, v, 0.1, math.inf, **how).outcome == "undecided"
    assert decide_copositive(flow, 10 * jump, 0.1, math.inf).outcome == "undecided"


def test_brackets_and_rates_in_any_units() -> None:
    pair = scaled(PAPER_41, np.array([3e7, 2e-8]))
    bracket = dwell_bracket(*pair, "shortest", math.inf)
    assert bracket.proved == pytest.approx(math.log(2), rel=1e-6)
    assert bracket.verdict == "refuted"
    P = bracket.certificate["P"]
    assert prove_common(*pair, P, bracket.proved, math.inf).outcome == "proved"
    P = decide(*pair, 1.0, math.inf).evidence["P"]
    best = largest_rates(*pair, P, 1.0, math.inf)
    plain = largest_rates(*PAPER_41, decide(*PAPER_41, 1.0, math.inf).evidence["P"], 1.0, math.inf)
    assert best is not None
    assert plain is not None
    for name in ("per_jump", "in_time"):
        assert best[name] == pytest.approx(plain[name], rel=0.02)
    own = {name: best[f"P_{name}"] for name in ("per_jump", "in_time")}
    rates = Rates(best["per_jump"], best["in_time"])
    assert prove_rates(*pair, {"P": P}, 1.0, math.inf, rates=rates, own=own).outcome == "proved"
    quicker = Rates(0.9 * best["per_jump"], best["in_time"])
    assert (
        prove_rates(*pair, {"P": P}, 1.0, math.inf, rates=quicker, own=own).outcome == "undecided"
    )


@pytest.mark.parametrize("place", ["flow", "jump"])
def test_couplings_of_flow_and_jump_count_alike(place: str) -> None:
    F, H, large = -np.eye(2), 0.5 * np.eye(2), 2.0**16
    (F if place == "flow" else H)[0, 1] = large
    sizes = Scaling.from_pair(exact(F), exact(H), 3.0).sizes  # the flow counts over a time of one
    assert sizes[0] / sizes[1] == large
    assert Scaling.from_pair(exact(F.T), exact(H.T), 3.0).sizes.tolist() == sizes[::-1].tolist()
