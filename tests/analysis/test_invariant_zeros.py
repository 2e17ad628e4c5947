"""Existence: rank of C D and invariant zeros, against the pencil itself; laws and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from lmi.arithmetic.balls import exact, surely_observable, to_float
from obsdesign.analysis.hidden_modes import hidden_part
from obsdesign.analysis.invariant_zeros import shows_every_input, zero_part, zeros_decay
from tests.long.random_unknown_inputs import draw, expected
from tests.systems.unknown_input import (
    pencil_margin,
    pencil_zeros,
    plant_with_zeros,
    random_plant,
    unknown_input_problem,
)


def zeros_of(A: Any, C: Any, D: Any) -> np.ndarray:
    restricted = zero_part(A, C, D)
    return np.zeros(0) if restricted is None else np.linalg.eigvals(to_float(restricted.maps[0]))


@pytest.mark.parametrize("seed", range(60))
def test_every_refusal_agrees_with_the_pencil(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    q = int(rng.integers(1, min(n, 3) + 1))
    p = int(rng.integers(q, q + 3))
    A, C, D = random_plant(rng, n, p, q)
    if seed % 3 == 0:
        A -= 1.5 * np.eye(n)
    if seed % 5 == 0:
        C[0] = C[0] - (C[0] @ D) @ np.linalg.pinv(D)  # the first output shows no input
    outcome = obsdesign.investigate(unknown_input_problem(A, C, D))
    rank = int(np.linalg.matrix_rank(C @ D, tol=1e-9 * np.linalg.norm(C) * np.linalg.norm(D)))
    growing = [s for s in pencil_zeros(A, C, D) if s.real >= 0] if rank == q else []
    verdicts = {claim.id: claim.verdict for claim in outcome.claims}
    if rank < q:
        assert verdicts == {"rank": "refuted"}
    elif growing:
        assert verdicts == {"rank": "proved", "zeros": "refuted"}
        zero = outcome.claims[1].evidence["witness"]["zero"]
        s = complex(zero["real"], zero["imag"])
        assert pencil_margin(A, C, D, s) < 1e-7  # the witness itself drops the rank
    else:
        assert outcome.verdict == "proved", verdicts


@pytest.mark.parametrize("shift", [-0.7, 0.0, 0.4])
@pytest.mark.parametrize("shape", [(4, 2, 2), (5, 3, 2), (6, 3, 1), (7, 2, 1)])
def test_zeros_are_those_built_in(shape: tuple[int, int, int], shift: float) -> None:
    n, p, q = shape
    rng = np.random.default_rng(n + p)
    built = np.array([[shift, 1.0], [-1.0, shift]])
    A, C, D = plant_with_zeros(rng, n, p, q, built)
    # a random change of coordinates rounds, so the exact numbers have a zero only nearly; the
    # coordinates of the construction keep it exactly
    margin = pencil_margin(A, C, D, complex(shift, 1))
    assert margin < 1e-10
    zeros = pencil_zeros(A, C, D)
    assert np.abs(zeros - complex(shift, 1)).min() < 1e-6


def test_exact_zeros_where_nothing_rounds() -> None:
    rng = np.random.default_rng(3)
    for shift in (-1.0, 0.0, 2.0):
        A = rng.integers(-3, 4, (6, 6)).astype(float)
        A[:2, :2] = [[shift, 1], [-1, shift]]
        A[2:4, :2] = 0
        C = rng.integers(-3, 4, (3, 6)).astype(float)
        C[:, :2] = 0
        D = np.vstack([np.zeros((4, 2)), np.eye(2)])
        assert np.linalg.matrix_rank(C @ D) == 2
        values = zeros_of(A, C, D)
        assert np.abs(values - complex(shift, 1)).min() < 1e-9
        assert zeros_decay(A, C, D).outcome == ("proved" if values.real.max() < 0 else "refuted")


small = st.integers(-4, 4)


@given(st.data())
@settings(max_examples=16, deadline=None)
def test_coordinates_feedback_and_injection_keep_the_zeros(data: Any) -> None:
    n, p, q = data.draw(st.tuples(st.integers(2, 4), st.integers(1, 3), st.integers(1, 2)))
    q = min(p, q)

    def matrix(rows: int, columns: int) -> np.ndarray:
        return np.array(data.draw(st.lists(small, min_size=rows * columns, max_size=rows * columns)),
                        dtype=float).reshape(rows, columns)  # fmt: skip

    A, C, D = matrix(n, n), matrix(p, n), matrix(n, q)
    if shows_every_input(C, D).outcome != "proved":
        return
    expected = np.sort_complex(zeros_of(A, C, D))
    # unimodular coordinates are exact; d + K x and an injection L y never change what is hidden
    S = np.tril(matrix(n, n), -1) + np.eye(n)
    back = np.round(np.linalg.inv(S))
    changed = S @ (A + D @ matrix(q, n) + matrix(n, p) @ C) @ back
    zeros = np.sort_complex(zeros_of(changed, C @ back, S @ D))
    assert len(zeros) == len(expected)
    np.testing.assert_allclose(np.poly(zeros), np.poly(expected), rtol=1e-6, atol=1e-6)
    verdicts = {zeros_decay(A, C, D).outcome, zeros_decay(changed, C @ back, S @ D).outcome}
    assert len(verdicts) == 1


def test_units_of_outputs_and_inputs_do_not_matter() -> None:
    rng = np.random.default_rng(5)
    _, C, D = random_plant(rng, 5, 3, 2)
    margins = []
    for units in (1.0, 1e-12, 1e9):
        scaled = C * np.array([[units], [1], [1 / units]]), D * np.array([1, units])
        verdict = shows_every_input(*scaled)
        assert verdict.outcome == "proved"
        margins.append(verdict.evidence["approx_margin"])
    assert max(margins) / min(margins) < 8  # lengths are rounded to powers of two


def test_the_margin_decides_near_the_border() -> None:
    """By how much C D cancels, which is in no unit."""
    A, D = np.zeros((2, 2)) - np.eye(2), np.array([[1.0], [1.0]])
    for angle, verdict in ((1e-8, "proved"), (1e-10, "refuted"), (0.0, "refuted")):
        C = np.array([[1 + angle, -1.0]])
        assert shows_every_input(C, D).outcome == verdict
        claims = obsdesign.investigate(unknown_input_problem(A, C, D)).claims
        assert next(c for c in claims if c.id == "rank").verdict == verdict


REFUSED = [
    # A, C, D, what the reason says
    ([[0, 1], [0, 0]], [[1, 0]], [[0], [1]], "rank(C D) = 0, 1 is needed: d = [1] does not show in y'; C D = 0, so that d reaches y only through further integrations"),
    ([[-1, 0], [0, -1]], [[1, 1]], [[1, 0], [0, 1]], "rank(C D) = 1, 2 is needed: d = [-1, 1] does not show in y'; there are fewer outputs (1) than unknown inputs (2)"),
    ([[-1, 0], [0, -1]], [[1, 0], [0, 1]], [[1, 2], [0, 0]], "rank(C D) = 1, 2 is needed: d = [1, -0.5] does not show in y'; the columns of flow.D are dependent (rank 1); drop inputs that others replace"),
    ([[-1, 0], [0, -1]], [[1, 0], [2, 0]], [[1, 0], [0, 1]], "rank(C D) = 1, 2 is needed: d = [0, 1] does not show in y'; this combination of unknown inputs reaches y only through further integrations"),
    ([[-1, 0], [0, -1]], [[1, 0]], [[0], [0]], "rank(C D) = 0, 1 is needed: d = [1] does not show in y'; the columns of flow.D are dependent (rank 0); drop inputs that others replace"),
    ([[1, 0], [1, 0]], [[0, 1]], [[0], [1]], "invariant zero at s = 1: an unknown input and a state that move like e^(st) and never show in y; no gain changes that"),
    ([[0, 1, 0], [-1, 0, 0], [1, 0, 0]], [[0, 0, 1]], [[0], [0], [1]], "invariant zero at s = 0 +- 1i: an unknown input and a state that move like e^(st) and never show in y; no gain changes that"),
]  # fmt: skip


@pytest.mark.parametrize(("A", "C", "D", "reason"), REFUSED)
def test_refusals_name_the_rank_or_the_zero(A: Any, C: Any, D: Any, reason: str) -> None:
    outcome = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert outcome.verdict == "refuted"
    witness = outcome.claims[-1].evidence["witness"]
    assert witness["reason"].replace("d = [1, -1]", "d = [-1, 1]").replace(
        "d = [-1, 0.5]", "d = [1, -0.5]").replace("[-1]", "[1]").replace("-0,", "0,") == reason  # fmt: skip
    if "input" in witness:
        direction = np.array(C, float) @ np.array(D, float) @ witness["input"]
        np.testing.assert_allclose(direction, 0, atol=1e-9)


def test_a_zero_that_rounding_hides_is_told() -> None:
    # 0.1 + 0.2 - 0.3 is 0 on paper; the stored numbers are off by 5e-17, and so C sees the mode
    A = [[0.5, 0, 0], [1, -1, 0], [0.1 + 0.2 - 0.3, 0, -1]]
    outcome = obsdesign.investigate(
        unknown_input_problem(A, [[0, 1, 0], [0, 0, 1]], [[0], [1], [0]])
    )
    zeros = next(c for c in outcome.claims if c.id == "zeros")
    assert zeros.verdict == "proved"  # exactly, there is none
    assert zeros.evidence["nearly"]["real"] == pytest.approx(0.5)
    assert any("Rounding the plant may destroy" in text for text in outcome.design.warnings)


@pytest.mark.parametrize("seed", range(20))
def test_the_rank_modulo_a_prime_never_says_too_much(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(2, 6)), int(rng.integers(1, 3))
    A, C = rng.integers(-2, 3, (n, n)) / 2.0, rng.integers(-1, 2, (p, n)) / 4.0
    if seed % 2:  # a mode that C cannot see
        A[1:, 0], C[:, 0] = 0, 0
    rows = [C]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    assert surely_observable(exact(A), exact(C)) == (np.linalg.matrix_rank(np.vstack(rows)) == n)
    assert (hidden_part([A], C) is None) == (np.linalg.matrix_rank(np.vstack(rows)) == n)


@pytest.mark.parametrize("seed", range(4, 40, 6))
def test_wild_units_are_proved_like_tame_ones(seed: int) -> None:
    family, matrices = draw(seed)
    assert family == "wild units"
    assert obsdesign.investigate(unknown_input_problem(*matrices)).verdict == expected(*matrices)


def test_a_zero_that_coordinates_round_away_leaves_the_design_undecided() -> None:
    rng = np.random.default_rng(0)
    A, C, D = plant_with_zeros(rng, 6, 3, 2, np.array([[0.5]]))
    outcome = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert outcome.verdict == "undecided"
    hurwitz = next(c for c in outcome.claims if c.id == "hurwitz")
    assert "s = 0.5 is within" in hurwitz.evidence["reason"]
    stable = plant_with_zeros(np.random.default_rng(0), 6, 3, 2, np.array([[-0.5]]))
    # the twin: a mode that decays stays
    design = obsdesign.design(unknown_input_problem(*stable))
    assert np.abs(np.linalg.eigvals(design.gains["F"]) + 0.5).min() < 1e-9
    assert np.abs(design.gains["L"]).max() < 1e3


EYE = -np.eye(3)
ODD = [
    (np.zeros((3, 3)), [[1, 0, 0], [0, 1, 0]], [[1], [0], [0]], "refuted"),  # x3 never shows
    (1e140 * EYE, [[1, 0, 0], [0, 1, 0]], [[1], [0], [0]], "proved"),
    (1e-140 * EYE, [[1, 0, 0], [0, 1, 0]], [[1], [0], [0]], "proved"),
    (EYE, [[1e150, 0, 0], [0, 1, 0]], [[1], [0], [0]], "proved"),
    (EYE, [[1, 0, 0], [0, 1, 0]], [[1e150], [1e150], [0]], "proved"),
    (EYE, [[1, 0, 0], [0, 1, 0]], [[1e-150], [0], [0]], "proved"),
    (np.diag([-1e-8, -1, -1e8]), [[1, 1, 1], [0, 1, 0]], [[1], [0], [0]], "proved"),
    (np.diag([1.0] * 5, 1), [[1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1]], [[0]] * 5 + [[1]], "proved"),
    (EYE, [[1, 0, 0]] * 3, [[1], [0], [0]], "proved"),
    (EYE, [[0, 0, 0]], [[1], [0], [0]], "refuted"),
]


@pytest.mark.parametrize(("A", "C", "D", "verdict"), ODD)
def test_odd_numbers_are_answered(A: Any, C: Any, D: Any, verdict: str) -> None:
    outcome = obsdesign.investigate(unknown_input_problem(A, C, D))
    assert outcome.verdict == verdict
    if verdict == "undecided":
        assert "beyond binary64" in outcome.claims[0].evidence["reason"]
    elif verdict == "proved":
        assert obsdesign.verify(outcome.design).verdict == "proved"
