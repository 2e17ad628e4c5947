from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import ball, exact, precision
from lmi.prove.hurwitz import (
    exactly_schur,
    lyapunov_matrix,
    modal_matrix,
    prove_hurwitz,
    real_spectrum,
    schur,
)

# eigenvalues of random matrices closer than this to the boundary are left to the exact tests
CLEAR = 1e-6


@pytest.mark.parametrize(
    ("F", "eigenvalue"),
    [
        ([[-3, 1], [0, 0]], (0, 0)),  # the bouncing ball
        ([[0]], (0, 0)),
        (np.zeros((3, 3)), (0, 0)),  # a multiple eigenvalue
        ([[0, 1], [-1, 0]], (0, 1)),  # on the axis, exactly
        ([[0, 1, 0], [-4, 0, 0], [0, 0, -1]], (0, 2)),
        ([[1, 3], [-1, 2]], (1.5, 1.6583123951777)),
        ([[-1, 1e9], [1e-9, -1]], (0, 0)),
    ],
)
def test_refuted_with_the_mode(F: list, eigenvalue: tuple[float, float]) -> None:
    verdict = prove_hurwitz(np.array(F, dtype=float))
    assert verdict.outcome == "refuted"
    mode = verdict.evidence["witness"]["eigenvalue"]
    assert (mode["real"], mode["imag"]) == pytest.approx(eigenvalue, abs=1e-8)
    assert "the flow has a mode that does not decay" in verdict.evidence["witness"]["reason"]


@pytest.mark.parametrize(
    "F",
    [
        [[-1e-300]],
        [[-1, 1e9], [0, -1]],
        [[-1, 0, 0], [1, -1, 0], [0, 1, -1]],  # a Jordan block
        [[-1e-12, 1], [-1, -1e-12]],  # the twin of the rotation above
        np.diag([-1e-300, -1e300]),
    ],
)
def test_proved(F: list) -> None:
    assert prove_hurwitz(np.array(F, dtype=float)).outcome == "proved"


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 6), st.integers(0, 100_000))
def test_decided_as_the_eigenvalues_say(n: int, seed: int) -> None:
    X = np.random.default_rng(seed).standard_normal((n, n))
    eigenvalues = np.linalg.eigvals(X)
    abscissa, radius = eigenvalues.real.max(), np.abs(eigenvalues).max()
    if abs(abscissa) > CLEAR:
        outcome = prove_hurwitz(X).outcome
        assert outcome == ("proved" if abscissa < 0 else "refuted")
    if abs(radius - 1) > CLEAR:
        assert exactly_schur(exact(X)) == (radius < 1)
    for factor in (0.99 / radius, 1.01 / radius):
        assert exactly_schur(exact(X * factor)) == (factor * radius < 1)


@pytest.mark.parametrize(
    "H", [np.eye(2), -np.eye(3), [[0, 1], [-1, 0]], [[1, 1], [0, 1]], [[0, 1], [1, 0]]]
)
def test_on_the_circle_is_not_schur(H: list) -> None:
    H = np.array(H, dtype=float)
    assert not exactly_schur(exact(H))
    assert exactly_schur(exact(H * np.nextafter(1.0, 0.0)))


@pytest.mark.parametrize("method", ["Lyapunov matrix", "Routh's test, exact"])
def test_which_proof_was_given(method: str) -> None:
    # floats do not solve the Lyapunov equation of modes 600 decades apart
    F = np.diag([-1.0, -2.0]) if method == "Lyapunov matrix" else np.diag([-1e-300, -1e300])
    verdict = prove_hurwitz(F)
    assert verdict.evidence["method"] == method
    assert verdict.evidence["approx_abscissa"] == (-1.0 if method.startswith("L") else 0.0)


@pytest.mark.parametrize(
    ("F", "real"),
    [
        ([[2.0]], True),
        ([[0, 1], [-1, 0]], False),
        ([[0, 1], [1, 0]], True),
        ([[1, 1], [0, 1]], True),  # a double eigenvalue
        (np.zeros((3, 3)), True),
        ([[1, 1e-9], [-1e-9, 1]], False),
        ([[1, 1e-9], [1e-9, 1]], True),
        (np.diag([1.0, -2.0, 3.0, 3.0]), True),
        ([[0, 1, 0, 0], [-1, 0, 1, 0], [0, 0, 0, 1], [0, 0, -1, 0]], False),  # a double pair
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 5]], False),
    ],
)
def test_a_real_spectrum_is_decided_exactly(F: list, real: bool) -> None:
    F = np.array(F, dtype=float)
    change = np.triu(np.ones(F.shape))
    assert real_spectrum(exact(F)) is real
    assert real_spectrum(exact(change @ F @ np.round(np.linalg.inv(change)))) is real


@pytest.mark.parametrize("seed", range(20))
def test_a_random_spectrum_is_real_where_floats_say_so(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((2 + seed % 4,) * 2)
    X = X + X.T if seed % 5 == 0 else X
    assert real_spectrum(exact(X)) == (np.abs(np.linalg.eigvals(X).imag).max() == 0)


@pytest.mark.parametrize("n", range(1, 6))
def test_schur_of_balls_says_what_it_says_of_numbers(n: int) -> None:
    X = np.random.default_rng(n).standard_normal((n, n))
    X /= np.abs(np.linalg.eigvals(X)).max()
    with precision(128):
        assert schur(ball(exact(0.99 * X))) is True
        assert schur(ball(exact(1.01 * X))) is False
        assert schur(ball(exact(-np.eye(n)))) is False
        # balls around a matrix with an eigenvalue on the circle decide nothing
        third = ball(exact(np.eye(n) * 3)).inv()
        assert schur(third * ball(exact(3.0 * np.eye(n)))) is None


@pytest.mark.parametrize("n", range(1, 5))
def test_a_lyapunov_matrix_solves_its_equation(n: int) -> None:
    rng = np.random.default_rng(n)
    F = rng.standard_normal((n, n))
    F -= (np.linalg.eigvals(F).real.max() + 0.7) * np.eye(n)
    P = rng.standard_normal((n, n))
    P = P @ P.T + np.eye(n)
    Q = lyapunov_matrix(F, P)
    assert Q is not None
    shifted = F + 0.35 * np.eye(n)  # half the decay rate
    np.testing.assert_allclose(shifted.T @ Q + Q @ shifted, -P, atol=1e-9)
    assert (Q == Q.T).all()
    assert lyapunov_matrix(-F, P) is None
    assert lyapunov_matrix(np.zeros((n, n)), P) is None


@pytest.mark.parametrize("n", range(1, 5))
def test_a_modal_matrix_is_above_one_and_falls_along_every_mode(n: int) -> None:
    rng = np.random.default_rng(10 + n)
    F = rng.standard_normal((n, n))
    F -= (np.linalg.eigvals(F).real.max() + 0.1) * np.eye(n)
    Q = modal_matrix(F)
    assert Q is not None
    assert (Q == Q.T).all()
    assert np.linalg.eigvalsh(Q).min() >= 1 - 1e-9
    rates, V = np.linalg.eig(F)
    # Q is diagonal in the eigenvectors: V* Q V; x'Qx falls along each by itself
    modal = V.conj().T @ Q @ V
    if np.abs(rates.imag).max() == 0:
        np.testing.assert_allclose(modal, np.diag(np.diag(modal)), atol=1e-9 * np.abs(modal).max())
    assert np.linalg.eigvalsh(F.T @ Q + Q @ F).max() < 1e-9
    assert modal_matrix(-F) is None


def test_weights_of_fast_modes_are_smaller_down_to_a_limit() -> None:
    # orthogonal modes need no room: every weight is one
    np.testing.assert_allclose(modal_matrix(np.diag([-1.0, -4.0])), np.eye(2), rtol=1e-12)
    # modes with the cosine 3/5: weight i is 1 + 3/5 share_j / share_i, shares 1 and rate^-1/2
    V = np.array([[1.0, 0.6], [0.0, 0.8]])
    for rate, share in ((4.0, 0.5), (1e6, 1 / 30)):
        Q = modal_matrix(V @ np.diag([-1.0, -rate]) @ np.linalg.inv(V))
        weights = np.diag(V.T @ Q @ V)
        np.testing.assert_allclose(weights, [1 + 0.6 * share, 1 + 0.6 / share], rtol=1e-6)


def test_spectra_of_many_rows_are_left_open() -> None:
    assert real_spectrum(exact(np.diag(np.arange(40.0)))) is True
    assert real_spectrum(exact(np.diag(np.arange(41.0)))) is None


@pytest.mark.parametrize("rest", [[0.5], [0.5, -0.25], []])
def test_minus_one_is_on_the_circle_exactly(rest: list[float]) -> None:
    assert schur(ball(exact(np.diag([-1.0, *rest])))) is False
    assert schur(ball(exact(np.diag([-0.75, *rest])))) is True
