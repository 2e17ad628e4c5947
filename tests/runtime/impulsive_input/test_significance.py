"""Thresholds from which an impulse counts: how often noise alone passes them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from scipy.stats import chi2

from obsdesign.runtime.impulsive_input.significance import (
    LEAST_DEVIATIONS,
    exact_floor,
    is_significant,
    least_ratio,
)


@dataclass
class Explained:
    gain: float


def test_an_impulse_counts_from_six_deviations_on() -> None:
    assert is_significant(Explained(LEAST_DEVIATIONS**2 + 1e-6))
    assert not is_significant(Explained(LEAST_DEVIATIONS**2))
    assert not is_significant(None)
    assert not is_significant(Explained(math.nan))


def test_noise_alone_seldom_passes() -> None:
    assert chi2.sf(LEAST_DEVIATIONS**2, 1) == pytest.approx(2e-9, rel=0.02)
    assert chi2.sf(least_ratio(4), 1) == pytest.approx(5e-4, rel=0.1)


def test_more_onsets_ask_for_more() -> None:
    assert least_ratio(2) == least_ratio(4) == 12.0
    assert least_ratio(16) - least_ratio(8) == pytest.approx(2 * math.log(2))


def test_rounding_of_output_and_of_impulses_before_is_no_impulse() -> None:
    assert exact_floor(1.0, 0.0) == 1e-7
    assert exact_floor(1.0, 1.0) == 3e-6
