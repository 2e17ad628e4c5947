"""The same engine for other families: after jumps, shifted flows, several jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.exponential import expm
from lmi.families import Edge
from lmi.find.cutting_plane import propose, propose_edges
from lmi.prove.common_matrix import prove_common

F = np.array([[-1.0, 0.0], [1.0, -3.0]])
H = np.array([[2.0, 0.0], [1.0, 0.2]])


def random_pair(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A pair that contracts at every constant dwell time in [0.2, 2], more or less."""
    rng = np.random.default_rng(seed)
    flow, jump = rng.standard_normal((2, n, n))
    flow -= (np.linalg.eigvals(flow).real.max() + 0.3) * np.eye(n)
    maps = expm(flow * np.linspace(0.2, 2.0, 60)[:, None, None]) @ jump
    return flow, jump * (rng.uniform(0.5, 1.05) / np.abs(np.linalg.eigvals(maps)).max())


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4))
def test_a_p_after_jumps_is_found_and_proved_in_its_own_form(seed: int, n: int) -> None:
    flow, jump = random_pair(seed, n)
    edge = Edge(flow, np.eye(n), 0.2, 2.0, left=jump)
    proposal = propose_edges([edge], 1)
    if proposal.P is None or proposal.margin < 1e-3:
        return
    assert prove_common(flow, jump, proposal.P, 0.2, 2.0, form="after_jump").outcome == "proved"
    worse = prove_common(flow, 1.5 * jump / edge_growth(edge, proposal.P), proposal.P, 0.2, 2.0,
                         form="after_jump")  # fmt: skip
    assert worse.outcome == "undecided"


def edge_growth(edge: Edge, P: np.ndarray) -> float:
    """Largest growth of a vector in the norm of P, on a grid."""
    L = np.linalg.cholesky(P).T
    maps = L @ edge.maps(np.linspace(edge.low, edge.high, 200)) @ np.linalg.inv(L)
    return float(np.linalg.norm(maps, ord=2, axis=(1, 2)).max())


def test_the_two_forms_ask_for_different_matrices() -> None:
    P = np.diag([1.0, 0.45])
    outcomes = [
        prove_common(F, H, P, 0.75, 3.0, form=form).outcome
        for form in ("before_jump", "after_jump")
    ]
    assert outcomes == ["proved", "undecided"]
    L = np.linalg.cholesky(P).T
    maps = L @ H @ expm(F * np.linspace(0.75, 3.0, 100)[:, None, None]) @ np.linalg.inv(L)
    assert np.linalg.norm(maps, ord=2, axis=(1, 2)).max() > 1


@pytest.mark.parametrize("alpha", [0.02, 0.05])
def test_a_shifted_flow_asks_for_a_rate(alpha: float) -> None:
    shifted = F + alpha * np.eye(2)
    proposal = propose(shifted, H, 0.75, 3.0)
    assert proposal.P is not None
    assert prove_common(shifted, H, proposal.P, 0.75, 3.0).outcome == "proved"
    # the limit is (theta - ln 2) / theta at the shortest dwell time
    fastest = (0.75 - math.log(2)) / 0.75
    assert alpha < fastest
    assert propose(F + 1.01 * fastest * np.eye(2), H, 0.75, 3.0).P is None


def test_two_jump_maps_that_are_stable_alone_and_not_together() -> None:
    jumps = (np.array([[0.0, 2.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]]))
    flow = -0.1 * np.eye(2)
    for jump in jumps:  # nilpotent: each dies out by itself
        alone = propose_edges([Edge(flow, jump, 0.5, 2.0)], 1)
        assert alone.P is not None
        assert prove_common(flow, jump, alone.P, 0.5, 2.0).outcome == "proved"
    together = propose_edges([Edge(flow, jump, 0.5, 2.0) for jump in jumps], 1)
    assert together.P is None
    product = expm(flow * 0.5) @ jumps[0] @ expm(flow * 0.5) @ jumps[1]
    assert np.abs(np.linalg.eigvals(product)).max() > 1


def test_a_factor_per_jump_belongs_to_an_edge() -> None:
    radius = 2 * math.exp(-0.75)
    for gamma, there in ((1.01 * radius, True), (0.99 * radius, False)):
        proposal = propose_edges([Edge(F, H, 0.75, 3.0, gamma=gamma)], 1)
        assert (proposal.P is not None) == there
        if proposal.P is not None:
            assert prove_common(F, H, proposal.P, 0.75, 3.0, gamma=gamma).outcome == "proved"
            smaller = prove_common(F, H, proposal.P, 0.75, 3.0, gamma=0.99 * radius)
            assert smaller.outcome == "undecided"
