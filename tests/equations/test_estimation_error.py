"""The estimation error at a jump: simulated against its matrices; gains that cannot act."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from obsdesign.equations import estimation_error as equations


@pytest.mark.parametrize("when", ["before", "after", "none"])
def test_a_jump_moves_the_error_by_its_matrices(when: str) -> None:
    rng = np.random.default_rng(0)
    G, M, C = rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
    x, estimate, c = rng.standard_normal((3, 3))
    jumped = G @ x + c
    y = C @ (jumped if when == "after" else x)
    predicted = G @ estimate
    expected = C @ (predicted if when == "after" else estimate)
    corrected = predicted + (0 if when == "none" else M @ (y - expected))
    H = equations.jump_error_matrix(G, M, C, when)
    through = equations.jump_disturbance_matrix(M, C, 3, when)
    np.testing.assert_allclose(jumped - corrected, H @ (x - estimate) + through @ c, atol=1e-12)
    output = equations.seen_before_jump(G, C, when)
    np.testing.assert_allclose(y - (C @ c if when == "after" else 0), output @ x, atol=1e-12)


def test_between_jumps() -> None:
    A, L, C = np.eye(2), np.array([[2.0], [3.0]]), np.array([[5.0, 7.0]])
    assert equations.flow_error_matrix(A, L, C).tolist() == [[-9.0, -14.0], [-15.0, -20.0]]


@pytest.mark.parametrize(
    ("measured", "when", "jump", "idle"),
    [
        ("continuous", "before", True, []),
        ("continuous", "none", True, ["M"]),
        ("continuous", "none", False, ["M"]),
        ("at_jumps", "before", True, ["L"]),
        ("at_jumps", "none", False, ["L", "M"]),
    ],
)
def test_gains_that_cannot_act(measured: str, when: str, jump: bool, idle: list[str]) -> None:
    output = SimpleNamespace(measured=measured, jump_measurement=when)
    reasons = equations.idle_gains(SimpleNamespace(output=output, jump=object() if jump else None))
    assert sorted(reasons) == idle
    if idle == ["M"]:
        assert ("no [jump]" in reasons["M"]) is not jump


def test_kinds_without_periodic_samples() -> None:
    assert equations.reason_against_sampling("continuous", "luenberger") is None
    reason = equations.reason_against_sampling("periodic", "luenberger")
    assert reason is not None
    assert "'luenberger'" in reason
