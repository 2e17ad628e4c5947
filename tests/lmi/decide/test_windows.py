"""Windows of dwell times: published and computed limits, laws, false certificates."""

from __future__ import annotations

import copy
import itertools
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import exact, rank_factors
from lmi.decide.dwell_search import dwell_bracket
from lmi.decide.stability import decide
from lmi.families import Edge
from lmi.find.cutting_plane import propose_edges
from lmi.find.window_search import certificate
from lmi.find.windows import Cutting, Windows, whole
from lmi.prove.rates import Rates, propose_rates, prove_rates
from lmi.prove.windows_proof import prove_windows
from tests.systems.pairs import (
    ALTERNATING,
    ALTERNATING_RANGE,
    MIXED,
    MIXED_RANGE,
    SAMPLED,
    SAMPLED_CONSTANT,
    endless_pair,
    growth,
)


def uniform(low: float, high: float, cells: int, past: int, future: int) -> Windows:
    """Every combination of `cells` equal cells at offsets -past .. future - 1; high finite."""
    borders = np.linspace(low, high, cells + 1)
    choice = np.array(list(itertools.product(range(cells), repeat=past + future)), dtype=int)
    choice = choice.reshape(cells ** (past + future), past + future)
    return Windows(low, high, -past, borders[choice], borders[choice + 1])


def fit(pair: tuple, windows: Windows, jitter: float = math.inf) -> Any:
    """Proposal and links for the given windows, in the coordinates of the state."""
    links = windows.links(jitter)
    ends = zip(links.source, links.target, links.low, links.high, strict=True)
    edges = [Edge(*pair, float(a), float(b), None, int(s), int(t)) for s, t, a, b in ends]
    return propose_edges(edges, len(windows)), links


@pytest.mark.parametrize(
    ("cells", "past", "future", "limit", "tolerance"),
    [
        (1, 0, 0, 1.8276, 1e-3),
        (2, 1, 0, 1.8344, 5e-4),
        (8, 1, 0, 1.8344, 5e-4),
        (4, 2, 0, 1.8673, 1e-3),
        (2, 2, 2, 1.8864, 1e-3),
    ],
)
def test_uniform_grids_reach_their_limits(
    cells: int, past: int, future: int, limit: float, tolerance: float
) -> None:
    for high, fits in ((limit - tolerance, True), (limit + tolerance, False)):
        windows = uniform(0.4, high, cells, past, future)
        proposal, links = fit(SAMPLED, windows)
        assert len(windows) == cells ** (past + future)
        assert len(links.source) == cells ** (past + future + 1) or past + future == 0
        assert (proposal.matrices is not None) == fits
        if fits:
            body = certificate(windows, links, proposal.matrices)
            assert prove_windows(*SAMPLED, body, 0.4, high).outcome == "proved"


@pytest.mark.parametrize(
    ("pair", "gain", "low", "high", "most"),
    [
        (SAMPLED, 1.0, 0.4, 1.8275, 1),
        (SAMPLED, 1.0, 0.4, 1.87, 20),
        (SAMPLED, 1.0, 0.4, 1.8885, 100),
        (SAMPLED_CONSTANT, 1.0, 0.001, 1.7293, 1),
        (ALTERNATING, 0.5367, *ALTERNATING_RANGE, 1),
        (ALTERNATING, 0.578, *ALTERNATING_RANGE, 10),
        (MIXED, 0.6672, *MIXED_RANGE, 1),
        (MIXED, 0.6942, *MIXED_RANGE, 40),
    ],
)
def test_proved_with_few_windows(
    pair: tuple, gain: float, low: float, high: float, most: int
) -> None:
    F, H = pair
    verdict = decide(F, gain * H, low, high)
    assert verdict.outcome == "proved"
    assert len(verdict.evidence.get("windows", [1])) <= most
    # a common P is one window, and not one more than it needs
    assert (decide(F, gain * H, low, high, memory=0).outcome == "proved") == (most == 1)


@pytest.mark.parametrize(
    ("pair", "gain", "low", "high", "length"),
    [
        (SAMPLED, 1.0, 0.4, 1.889, 2),
        (SAMPLED, 1.0, 0.4, 1.88893, 2),
        (SAMPLED, 1.0, 0.4, 2.0, 0),
        (SAMPLED_CONSTANT, 1.0, 0.001, 1.7295, 1),
        (ALTERNATING, 0.5797, *ALTERNATING_RANGE, 5),
        (MIXED, 0.6960, *MIXED_RANGE, 0),
    ],
)
def test_refuted_with_a_sequence(
    pair: tuple, gain: float, low: float, high: float, length: int
) -> None:
    F, H = pair
    verdict = decide(F, gain * H, low, high)
    assert verdict.outcome == "refuted"
    witness = verdict.evidence["witness"]
    thetas = witness.get("thetas", [witness.get("theta")])
    assert length in (0, len(thetas))
    assert all(low <= theta <= high for theta in thetas)
    assert growth(F, gain * H, np.tile(thetas, 4000 // len(thetas))) > 1e-3  # does not die out


def test_the_sampled_data_witness() -> None:
    witness = decide(*SAMPLED, 0.4, 1.889).evidence["witness"]
    assert sorted(witness["thetas"]) == pytest.approx([0.4001, 1.889], abs=1e-3)
    assert witness["spectral_radius"] == pytest.approx(1.0000497, abs=1e-6)


def test_limited_jitter_allows_longer_dwell_times() -> None:
    verdict = decide(*SAMPLED, 0.4, 2.0, jitter=0.2)
    assert verdict.outcome == "proved"
    assert decide(*SAMPLED, 0.4, 2.0).outcome == "refuted"
    # what is true for small changes is not claimed for larger ones
    for jitter in (0.5, math.inf):
        again = prove_windows(*SAMPLED, verdict.evidence, 0.4, 2.0, jitter=jitter)
        assert again.outcome == "undecided"
    assert prove_windows(*SAMPLED, verdict.evidence, 0.4, 2.0, jitter=0.2).outcome == "proved"


def test_a_witness_respects_the_jitter() -> None:
    # 1.95 is beyond 1.8889, where dwell times that alternate between the ends destabilise
    wide = decide(*SAMPLED, 0.4, 1.95, jitter=1.6)
    assert wide.outcome == "refuted"
    thetas = np.array(wide.evidence["witness"]["thetas"])
    assert np.abs(thetas - np.roll(thetas, 1)).max() <= 1.6
    assert decide(*SAMPLED, 0.4, 1.95, jitter=0.0).outcome == "proved"


def test_memory_is_how_far_windows_look() -> None:
    back = decide(*SAMPLED, 0.4, 1.87, memory=1)
    assert back.outcome == "proved"
    assert {key for w in back.evidence["windows"] for key in w["dwell"]} <= {"-1", "0"}
    without_memory = decide(*SAMPLED, 0.4, 1.87, memory=0)
    assert without_memory.outcome == "undecided"
    assert without_memory.evidence["reason"].endswith("which is not instability")


@pytest.mark.parametrize("method", ["bernstein", "chords"])
def test_endless_dwell_times(method: str) -> None:
    F, H = endless_pair()
    verdict = decide(F, H, 0.2, math.inf)
    assert verdict.outcome == "proved"
    evidence = json.loads(json.dumps(verdict.evidence, allow_nan=False))
    assert any(end == "inf" for w in evidence["windows"] for _, end in w["dwell"].values())
    again = prove_windows(F, H, evidence, 0.2, math.inf, method=method)
    assert again.outcome == "proved"
    assert "tail_from" in again.evidence
    assert prove_windows(F, 1.2 * H, evidence, 0.2, math.inf, method=method).outcome != "proved"
    # the same windows for a flow that does not decay
    grows = F + 2 * np.eye(2)
    assert prove_windows(grows, 1e-6 * H, evidence, 0.2, math.inf).outcome != "proved"


CASE = decide(*SAMPLED, 0.4, 1.87).evidence


def tampered(change: Callable[[dict[str, Any]], None]) -> Any:
    body = json.loads(json.dumps(CASE))
    change(body)
    return prove_windows(*SAMPLED, body, 0.4, 1.87)


def swap(body: dict[str, Any]) -> None:
    first, second = body["windows"][:2]
    first["P"], second["P"] = second["P"], first["P"]


def forget_window(body: dict[str, Any]) -> None:
    last = len(body["windows"]) - 1
    body["windows"].pop()
    body["edges"] = [edge for edge in body["edges"] if last not in edge[:2]]


def shift_border(body: dict[str, Any]) -> None:
    window = next(w for w in body["windows"] if w["dwell"]["-1"][1] < 1.87)
    window["dwell"]["-1"][1] = math.nextafter(window["dwell"]["-1"][1], 2)


def widen_all_alike(body: dict[str, Any]) -> None:
    """A border moved wherever it stands in windows, but not in the edges."""
    border = next(w["dwell"]["-1"][1] for w in body["windows"] if w["dwell"]["-1"][1] < 1.87)
    wider = math.nextafter(border, 2)
    for window in body["windows"]:
        for ends in window["dwell"].values():
            ends[:] = [wider if end == border else end for end in ends]


def overlap(body: dict[str, Any]) -> None:
    """Two windows grow into each other, with no edges for what they now share."""
    for window in body["windows"]:
        window["dwell"].pop("0", None)


def double(body: dict[str, Any]) -> None:
    body["windows"].append(copy.deepcopy(body["windows"][0]))


def leave_the_range(body: dict[str, Any]) -> None:
    for window in body["windows"]:
        for ends in window["dwell"].values():
            ends[:] = [2.5 if end == 1.87 else end for end in ends]


def spoil_entry(body: dict[str, Any]) -> None:
    body["windows"][0]["P"][0][0] *= 1.5


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (swap, "the inequality fails"),
        (spoil_entry, "the inequality fails"),
        (forget_window, "do not divide"),
        (lambda body: body["edges"].pop(), "which the edges do not list"),
        (lambda body: body["edges"].append([0, 0, 0.4, 0.5]), "as they do not follow"),
        (lambda body: body["edges"].append(body["edges"][0]), "listed twice"),
        (shift_border, "do not divide"),
        (widen_all_alike, "edges"),
        (overlap, "do not divide"),
        (double, "do not divide"),
        (leave_the_range, "not as they should be"),
        (lambda body: body["windows"][0].pop("P"), "not as they should be"),
        (lambda body: body["windows"][0].update(P=[[1.0]]), "not as they should be"),
        (lambda body: body["windows"][0].update(P=[[-1.0, 0], [0, 1]]), "positive definite"),
        (lambda body: body["windows"][0].update(P=[[1.0, 0.1], [0, 1]]), "symmetric"),
        (lambda body: body["windows"][0].update(dwell={"0.5": [0.4, 1.0]}), "should be"),
        (lambda body: body["windows"][0].update(dwell={"0": [0.4, math.nan]}), "should be"),
        (lambda body: body["windows"][0].update(dwell={"1000000000": [0.4, 1.0]}), "should be"),
        (lambda body: body["windows"][0].update(dwell={"00": [0.4, 1.0]}), "should be"),
        (lambda body: body["windows"][0].update(dwell=[0.4, 1.0]), "should be"),
        (lambda body: body["edges"].append([0.5, 0, 0.4, 1.0]), "should be"),
        (lambda body: body["edges"].append([0, 0]), "should be"),
        (lambda body: body.update(windows=body["windows"] * 1000), "more than"),
        (lambda body: body.update(windows=[]), "no windows"),
        (lambda body: body.pop("edges"), "should be"),
    ],
)
def test_a_tampered_certificate_proves_nothing(
    change: Callable[[dict[str, Any]], None], reason: str
) -> None:
    assert tampered(lambda body: None).outcome == "proved"
    verdict = tampered(change)
    assert verdict.outcome == "undecided"
    assert reason in verdict.evidence["reason"]


def test_a_proof_for_one_range_is_none_for_another() -> None:
    assert prove_windows(*SAMPLED, CASE, 0.4, 1.88).outcome == "undecided"
    assert prove_windows(*SAMPLED, CASE, 0.4, 1.86).outcome == "undecided"
    F, H = SAMPLED
    assert prove_windows(F, 1.01 * H, CASE, 0.4, 1.87).outcome == "undecided"
    assert prove_windows(F, H, CASE, 0.4, 1.87, gamma=0.99).outcome == "undecided"


def test_chords_confirm() -> None:
    verdict = prove_windows(*SAMPLED, CASE, 0.4, 1.87, method="chords")
    assert verdict.outcome == "proved"
    assert verdict.evidence["method"] == "chords"
    spoilt = json.loads(json.dumps(CASE))
    swap(spoilt)
    assert prove_windows(*SAMPLED, spoilt, 0.4, 1.87, method="chords").outcome == "undecided"


def random_windows(rng: np.random.Generator, low: float, high: float, cuts: int) -> Windows:
    windows = whole(low, high)
    for _ in range(cuts):
        w, offset = int(rng.integers(len(windows))), int(rng.integers(-2, 3))
        a, b = windows.interval(w, offset)
        where = float(rng.uniform(a, b if math.isfinite(b) else a + 1))
        windows, _ = windows.cut([Cutting(w, offset, where)])
    return windows


@settings(max_examples=16, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 12), st.booleans(), st.booleans())
def test_finder_and_verifier_agree_on_partitions_and_edges(
    seed: int, cuts: int, endless: bool, limited: bool
) -> None:
    rng = np.random.default_rng(seed)
    high = math.inf if endless else 2.0
    windows = random_windows(rng, 0.5, high, cuts)
    jitter = float(rng.uniform(0, 0.5)) if limited else math.inf
    # maps so small that P = I does for every edge: only the windows can be wrong
    F, H = -np.eye(2), np.array([[1e-3, 0], [1e-4, 1e-3]])
    order = rng.permutation(len(windows))
    links = windows.links(jitter)
    body = certificate(windows, links, np.tile(np.eye(2), (len(windows), 1, 1)))
    place = np.argsort(order)
    body["windows"] = [body["windows"][k] for k in order]
    body["edges"] = [[int(place[s]), int(place[t]), a, b] for s, t, a, b in body["edges"]]
    assert prove_windows(F, H, body, 0.5, high, jitter=jitter).outcome == "proved"
    body["edges"].pop(int(rng.integers(len(body["edges"]))))
    assert prove_windows(F, H, body, 0.5, high, jitter=jitter).outcome == "undecided"


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 10), st.floats(0.05, 1.5))
def test_every_sequence_walks_along_edges(seed: int, cuts: int, jitter: float) -> None:
    rng = np.random.default_rng(seed)
    windows = random_windows(rng, 0.5, 2.0, cuts)
    links = windows.links(jitter)
    listed = {(int(s), int(t)): (a, b) for s, t, a, b in
              zip(links.source, links.target, links.low, links.high, strict=True)}  # fmt: skip
    thetas = [float(rng.uniform(0.5, 2.0))]
    for _ in range(40):
        step = rng.uniform(-jitter, jitter)
        thetas.append(min(max(thetas[-1] + step, 0.5), 2.0))

    def inside(w: int, k: int) -> bool:
        for offset in range(windows.first, windows.past_last):
            a, b = windows.interval(w, offset)
            if not (a <= thetas[k + offset] and (thetas[k + offset] < b or b == 2.0)):
                return False
        return True

    windows_at = [[w for w in range(len(windows)) if inside(w, k)] for k in range(3, 36)]
    assert all(len(candidates) == 1 for candidates in windows_at)
    for k, ((s,), (t,)) in enumerate(itertools.pairwise(windows_at), start=3):
        low, high = listed[s, t]
        assert low <= thetas[k] <= high


@settings(max_examples=6, deadline=None)
@given(
    st.integers(0, 100_000),
    st.sampled_from([(SAMPLED, 1.0, 0.4, 1.87), (MIXED, 0.68, *MIXED_RANGE)]),
)
def test_coordinates_and_units_do_not_matter(seed: int, case: tuple) -> None:
    (F, H), gain, low, high = case
    rng = np.random.default_rng(seed)
    S = np.linalg.qr(rng.standard_normal((3, 3)))[0] * rng.uniform(0.5, 2, 3)
    scale = float(rng.uniform(0.01, 100))
    turned = np.linalg.solve(S, F @ S) / scale, gain * np.linalg.solve(S, H @ S)
    assert decide(*turned, low * scale, high * scale).outcome == "proved"


def test_rank_factors_are_exact() -> None:
    H = exact(np.array([[0.1, 0.2, 0.3], [0.2, 0.4, 0.6], [1.0, 0.7, 0.3]]))
    H[1] = H[0] * 3
    U, V = rank_factors(H)
    assert U.shape == V.shape == (3, 2)
    assert (U @ V.T == H).all()


def test_rates_by_windows() -> None:
    rates = propose_rates(*SAMPLED, CASE, 0.4, 1.87)
    assert rates is not None
    assert rates.per_jump < 1
    assert rates.in_time > 0
    for better in (Rates(rates.per_jump - 5e-3, 0.0), Rates(rates.per_jump, rates.in_time + 0.01)):
        assert prove_rates(*SAMPLED, CASE, 0.4, 1.87, rates=better).outcome == "undecided"


def test_several_jump_maps_share_one_P() -> None:
    """Two (F, H) pairs, one node: the sequence may use either at every jump."""
    F = np.array([[-1.0, 2], [-2, -1]])
    first, second = np.array([[1.2, 0], [0, 0.3]]), np.array([[0.3, 0], [0, 1.2]])
    edges = [Edge(F, H, 0.3, 1.0) for H in (first, second)]
    proposal = propose_edges(edges, 1)
    assert proposal.P is not None
    from lmi.prove.common_matrix import prove_common

    assert all(
        prove_common(F, H, proposal.P, 0.3, 1.0).outcome == "proved" for H in (first, second)
    )
    too_much = [Edge(F, 1.5 * H, 0.3, 1.0) for H in (first, second)]
    none = propose_edges(too_much, 1)
    assert none.P is None
    assert none.multipliers is not None
    assert {0, 1} == set(none.owners)


def test_searches_go_beyond_a_common_P() -> None:
    F, H = SAMPLED
    bracket = dwell_bracket(F, H, "longest", 0.4, accuracy=1e-3)
    assert bracket.common == pytest.approx(1.8276, abs=3e-3)
    assert bracket.verdict == "refuted"
    assert bracket.proved is not None
    assert bracket.not_proved is not None
    assert bracket.proved < bracket.not_proved <= bracket.proved * (1 + 1e-3)
    again = prove_windows(F, H, bracket.certificate, 0.4, bracket.proved)
    assert again.outcome == "proved"
    slow = dwell_bracket(F, H, "longest", 0.4, accuracy=1e-3, jitter=0.2)
    assert slow.proved is not None
    assert slow.proved > 2.0
    plain = dwell_bracket(F, H, "longest", 0.4, accuracy=1e-3, memory=0)
    assert plain.proved == pytest.approx(1.8276, abs=3e-3)
    assert plain.verdict == "undecided"


def test_searches_reach_endless_ranges_by_windows() -> None:
    F, H = endless_pair()
    bracket = dwell_bracket(F, H, "longest", 0.2)
    assert bracket.proved == math.inf
    assert bracket.common is not None
    assert math.isfinite(bracket.common)
    assert prove_windows(F, H, bracket.certificate, 0.2, math.inf).outcome == "proved"
