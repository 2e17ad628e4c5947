"""Proved decay rates hold along every sequence.

Better ones than a constant dwell time allows are never proved.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmi.arithmetic.exponential import expm
from lmi.decide.stability import decide
from lmi.find.largest_rates import largest_rates
from lmi.prove.rates import Rates, propose_rates, prove_rates

ROUNDING = 1e-9  # floats against a proof in exact arithmetic


def _stable(seed: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(F, H, dwell times) of a random pair that is stable at each constant dwell time."""
    rng = np.random.default_rng(seed)
    F, H = rng.standard_normal((2, n, n))
    F -= (np.linalg.eigvals(F).real.max() + 0.3) * np.eye(n)
    thetas = np.linspace(0.2, 3.0, 150)
    H *= 0.6 / np.abs(np.linalg.eigvals(expm(F * thetas[:, None, None]) @ H)).max()
    return F, H, thetas


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), endless=st.booleans())
def test_proved_rates_hold_and_better_ones_are_not_proved(seed: int, n: int, endless: bool) -> None:
    F, H, thetas = _stable(seed, n)
    high = math.inf if endless else 3.0
    verdict = decide(F, H, 0.2, high)
    if "P" not in verdict.evidence:
        return
    P = np.array(verdict.evidence["P"])
    certificate = verdict.evidence
    rates = propose_rates(F, H, certificate, 0.2, high)
    assert rates is not None
    L = np.linalg.cholesky(P)
    maps = expm(F * thetas[:, None, None]) @ H
    norms = np.linalg.norm(L.T @ maps @ np.linalg.inv(L.T), ord=2, axis=(1, 2))
    assert np.all(norms <= rates.per_jump * (1 + ROUNDING))
    assert np.all(norms <= np.exp(-rates.in_time * thetas) * (1 + ROUNDING))
    radii = np.abs(np.linalg.eigvals(maps)).max(axis=1)
    faster = Rates(max(float(radii.max()) * 0.999, 1e-9), rates.in_time)
    assert prove_rates(F, H, certificate, 0.2, high, rates=faster).outcome == "undecided"
    sooner = Rates(rates.per_jump, float(np.min(-np.log(radii) / thetas)) * 1.001 + 1e-9)
    assert prove_rates(F, H, certificate, 0.2, high, rates=sooner).outcome == "undecided"


@pytest.mark.parametrize(
    "rates", [Rates(1.0, 0.0), Rates(0.0, 0.0), Rates(0.5, -1.0), Rates(0.5, math.inf)]
)
def test_rates_that_are_none(rates: Rates) -> None:
    assert (
        prove_rates([[-1.0]], [[0.1]], {"P": [[1.0]]}, 1.0, 2.0, rates=rates).outcome == "undecided"
    )
    assert (
        prove_rates([[-1.0]], [[0.1]], {"P": [[1.0]]}, 1.0, 2.0, rates=Rates(0.5, 0.1)).outcome
        == "proved"
    )


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 4), endless=st.booleans())
def test_the_largest_rates_are_proved_and_lie_between(seed: int, n: int, endless: bool) -> None:
    F, H, thetas = _stable(seed, n)
    high = math.inf if endless else 3.0
    verdict = decide(F, H, 0.2, high)
    if "P" not in verdict.evidence:
        return
    first = propose_rates(F, H, verdict.evidence, 0.2, high)
    best = largest_rates(F, H, verdict.evidence["P"], 0.2, high)
    assert first is not None
    assert best is not None
    # a search that stops short of its end by a tenth of the way may lose as much, and no more
    assert best["per_jump"] <= first.per_jump + 0.1 * (1 - first.per_jump)
    assert best["in_time"] >= 0.9 * first.in_time
    radii = np.abs(np.linalg.eigvals(expm(F * thetas[:, None, None]) @ H)).max(axis=1)
    assert best["per_jump"] >= radii.max() * (1 - ROUNDING)
    assert best["in_time"] <= np.min(-np.log(radii) / thetas) * (1 + ROUNDING)
    own = {name: best[f"P_{name}"] for name in ("per_jump", "in_time") if f"P_{name}" in best}
    rates = Rates(best["per_jump"], best["in_time"])
    assert prove_rates(F, H, verdict.evidence, 0.2, high, rates=rates, own=own).outcome == "proved"
    swapped = {name: (-np.array(P)).tolist() for name, P in own.items()}
    if own:
        false = prove_rates(F, H, verdict.evidence, 0.2, high, rates=rates, own=swapped)
        assert false.outcome == "undecided"


def test_the_largest_rates_of_one_state_are_those_of_the_worst_dwell_time() -> None:
    best = largest_rates([[-1.0]], [[2.0]], [[1.0]], 0.8, 2.0)
    assert best is not None
    assert best["per_jump"] == pytest.approx(2 * math.exp(-0.8), abs=2e-3)
    assert best["in_time"] == pytest.approx(1 - math.log(2) / 0.8, rel=0.03)
