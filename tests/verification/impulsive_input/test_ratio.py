"""Claim `ratio`: what (15) neglects, proved, or refuted at the age that the witness names."""

from __future__ import annotations

from dataclasses import replace

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


def across(outputs: int) -> FeatureWindow:
    """Two columns of jump.H that are nearly parallel."""
    return FeatureWindow(
        np.array([[-0.4, -0.1], [-0.1, -0.7]]), np.array([[1.0, 1], [0.3, -1]])[:outputs],
        np.array([[1, 1], [0, 0.2]]), exponents=np.array([-3, -3.5, -4, -4.5]), tau=4.0, margin=2.0,
    )  # fmt: skip


def features(window: FeatureWindow, age: float) -> tuple[np.ndarray, np.ndarray]:
    """b and E of an impulse of an age, one row for each exponent and output, (m p, 2)."""
    rows = []
    for c in window.C:
        for lam in window.exponents:
            parts = [replace(window, C=c[None], H=h[:, None]) for h in window.H.T]
            rows.append([np.exp(lam * age) * np.array(feature(part, lam, age)) for part in parts])
    pairs = np.array(rows)
    return pairs[:, :, 0], pairs[:, :, 1]


@pytest.mark.parametrize("outputs", [1, 2])
def test_weights_across_columns_keep_the_ratio(outputs: int) -> None:
    window = across(outputs)
    pairs = [features(window, age) for age in np.linspace(2, 4, 9)]
    worst = max(float(np.linalg.norm(E @ np.linalg.pinv(b), 2)) for b, E in pairs)
    alone = [np.linalg.norm(E, axis=0) / np.linalg.norm(b, axis=0) for b, E in pairs]
    columns = float(np.max(alone))
    refusal = claim(window, 0.99 * worst)  # the twin: a bound that holds for each column alone
    assert columns < 0.99 * worst
    assert refusal.verdict == "refuted"
    witness = refusal.evidence["witness"]
    b, E = (X @ witness["weights"] for X in features(window, witness["age"]))
    assert np.linalg.norm(E) > 0.99 * worst * (1 - 1e-6) * np.linalg.norm(b)
    assert claim(window, 1.05 * worst).verdict == "proved"


def test_a_weight_without_features_has_no_ratio() -> None:
    window = across(1)
    parallel = FeatureWindow(
        window.D, window.C, np.array([[1.0, 2], [0, 0]]), exponents=window.exponents, tau=4.0,
        margin=2.0,
    )  # fmt: skip
    assert claim(parallel, 1e6).verdict == "undecided"
