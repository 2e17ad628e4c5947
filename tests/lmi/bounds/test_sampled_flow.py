"""What an output does between its samples, added to the flow of the width."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.balls import exact, to_float
from lmi.bounds.sampled_flow import sampled_flow


@pytest.mark.parametrize("W", [-2.0, 0.0, 1.5])
def test_one_state_by_hand(W: float) -> None:
    # rho' = a rho + b, sig' = ca rho + c b; the width was at most e^{-W h} times itself
    a, ca, c, b, gain, h = 0.7, 0.9, 1.1, 0.3, 2.0, 0.4
    added = sampled_flow(
        exact([[W]]), exact([[gain]]), CA=exact([[ca]]), A=exact([[a]]), C=exact([[c]]),
        b=exact([b]), h=h,
    )  # fmt: skip
    assert added is not None
    grown = (math.exp(a * h) - 1) / a
    slope = gain * ca * grown * math.exp(-min(W, 0.0) * h)
    push = gain * (ca * b * (grown - h) / a + c * b * h)
    for one, truth in zip(added, (slope, push), strict=True):
        assert truth <= to_float(one).item() <= truth * (1 + 1e-5)


def test_several_states_are_at_least_what_the_output_does() -> None:
    rng = np.random.default_rng(0)
    A, CA, C, L = rng.random((2, 2)), rng.random((1, 2)), rng.random((1, 2)), rng.random((2, 1))
    W, b, h = np.diag([-1.0, -3.0]) + 0.1 * rng.random((2, 2)), rng.random(2), 0.2
    added = sampled_flow(exact(W), exact(L), CA=exact(CA), A=exact(A), C=exact(C), b=exact(b), h=h)
    assert added is not None
    rho, sig, steps = np.eye(2), np.zeros((1, 2)), 20_000
    drive, drift = np.zeros(2), np.zeros(1)
    for _ in range(steps):  # Euler from below: all is positive and grows
        sig, drift = sig + CA @ rho * h / steps, drift + (CA @ drive + C @ b) * h / steps
        rho, drive = rho + A @ rho * h / steps, drive + (A @ drive + b) * h / steps
    slope, push = L @ sig * np.exp(-np.diag(W) * h), L @ drift
    for one, truth in zip(added, (slope, push), strict=True):
        assert np.all(truth <= to_float(one))
        np.testing.assert_allclose(to_float(one), truth, rtol=1e-4)
    # None where numbers overflow
    parts = {"CA": exact(CA), "A": exact(1e4 * A), "C": exact(C), "b": exact(b)}
    assert sampled_flow(exact(W), exact(L), **parts, h=h) is None
    assert sampled_flow(exact(1e4 * W), exact(L), **(parts | {"A": exact(A)}), h=h) is None
