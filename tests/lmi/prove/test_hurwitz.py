from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.balls import exact
from lmi.prove.hurwitz import exactly_schur, prove_hurwitz

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


@settings(max_examples=60, deadline=None)
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
