"""Claim `ratio`: what (15) neglects, proved, or refuted at the age that the witness names."""

from __future__ import annotations

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from obsdesign.document import Claim
from obsdesign.equations.impulsive_input.features import FeatureWindow
from obsdesign.verification.impulsive_input.window import ratio


def window_of(seed: int) -> FeatureWindow:
    """A random window of floats with one output and two exponents."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    D = np.diag(-rng.uniform(0.05, 1.5, n)) + np.tril(rng.uniform(0, 1.5, (n, n)), -1)
    if n > 1 and seed % 3 == 0:
        D[0, 1] = -rng.uniform(0.2, 2)  # modes turn: features may have zeros
    tau = float(rng.uniform(2, 8))
    margin = float(tau * rng.uniform(0.2, 0.5))
    return FeatureWindow(
        D, rng.uniform(0, 1, (1, n)), np.eye(n)[:, :1],
        exponents=-np.sort(rng.uniform(1, 6, 2)) / margin, tau=tau, margin=margin,
    )  # fmt: skip


def feature(window: FeatureWindow, lam: float, age: float) -> tuple[float, float]:
    """(b, E) of an impulse of an age, by the exponential of a block, but for a common factor."""
    n = len(window.D)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[n, :n] = window.D - lam * np.eye(n), window.C[0]
    start = np.vstack([window.H, [[0.0]]])
    ends = (expm(block * s) @ start for s in (age, age - window.tau))  # int_0^s e^{(D - lam) v} dv
    b, E = (float(end[n, 0]) for end in ends)
    return b, E


def neglected(window: FeatureWindow, lam: float, age: float) -> float:
    """|E| / |b| of an impulse of an age."""
    b, E = feature(window, lam, age)
    return abs(E / b)


def on_grid(window: FeatureWindow) -> tuple[float, bool]:
    """(the largest ratio on a grid of ages, whether a feature has a zero)."""
    ages = np.linspace(window.margin, window.tau, 60)
    pairs = np.array([[feature(window, lam, age) for age in ages] for lam in window.exponents])
    signs = np.sign(pairs[:, :, 0])
    return float(np.abs(pairs[:, :, 1] / pairs[:, :, 0]).max()), bool((signs != signs[:, :1]).any())


def claim(window: FeatureWindow, bound: float) -> Claim:
    """The claim, of the same numbers exactly."""
    D, C, H = exact(window.D), exact(window.C), exact(window.H)
    return ratio(
        FeatureWindow(D, C, H, exponents=window.exponents, tau=window.tau, margin=window.margin),
        bound,
    )


@pytest.mark.parametrize("seed", range(12))
def test_the_ratio_is_exceeded_at_the_age_of_the_witness(seed: int) -> None:
    window = window_of(seed)
    worst, has_zero = on_grid(window)
    for share in (0.3, 0.9, 0.999, *((1.5, 30.0) if has_zero else ())):
        refusal = claim(window, share * worst)
        assert refusal.verdict == "refuted"
        witness = refusal.evidence["witness"]
        assert {type(witness["age"]), type(witness["exponent"])} == {float}
        assert window.margin <= witness["age"] <= window.tau
        size = neglected(window, witness["exponent"], witness["age"])
        assert size > share * worst * (1 - 1e-6)
        assert repr(witness["age"]) in witness["reason"]
    # the twin: a bound that holds is proved
    assert has_zero or claim(window, 1.5 * worst).verdict == "proved"
