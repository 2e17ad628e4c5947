"""Where an impulse between two samples is told from every other one: by H and the modes of A."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from obsdesign.verification.impulsive_input.samples import (
    _eigenvalue,
    _only_interval,
    _uniqueness,
    _window_verdict,
)

CHAIN = np.array([[-1.0, 1.0], [0.0, -3.0]])


@pytest.mark.parametrize("size", [1.0, -0.5, 4.0])
@pytest.mark.parametrize(("direction", "mode"), [([1.0, 0.0], -1), ([1.0, -2.0], -3)])
def test_an_eigenvector_shows_the_interval_alone(
    size: float, direction: list[float], mode: int
) -> None:
    H = size * np.array(direction)[:, None]
    assert _eigenvalue(exact(CHAIN), exact(H)) == mode
    shown = _only_interval(exact([[1.0, 0.25]]), exact(H), exact(mode).item())
    assert shown.outcome == "proved"
    # the twins: where no output jumps samples do not show the impulse at all; and beside it
    across = exact([[-direction[1], direction[0]]])
    assert _only_interval(across, exact(H), exact(mode).item()).outcome == "refuted"
    beside = H + np.array([[0.0], [1e-9]])
    assert _eigenvalue(exact(CHAIN), exact(beside)) is None
    assert _uniqueness(exact(CHAIN), exact(beside), 0.2).outcome == "proved"


def test_no_impulse_at_all() -> None:
    verdict = _uniqueness(exact(CHAIN), exact(np.zeros((2, 1))), 0.2)
    assert verdict.outcome == "refuted"
    assert verdict.evidence["witness"]["vector"] == [0.0, 0.0]


@pytest.mark.parametrize(("h", "outcome"), [(0.7, "proved"), (math.pi / 4, "undecided")])
def test_modes_that_turn_by_half_a_circle_between_samples(h: float, outcome: str) -> None:
    turn = np.array([[0.0, 4.0], [-4.0, 0.0]])
    assert _uniqueness(exact(turn), exact([[1.0], [0.0]]), h).outcome == outcome


@pytest.mark.parametrize("units", [1e-6, 0.1, 1.0, 100.0, 2.0**40])
@pytest.mark.parametrize(
    ("A", "h", "outcome"),
    [([[0.0, 1.0], [-4.0, -0.4]], 0.2, "proved"), ([[0.0, 1.0], [-4.0, -0.4]], 1.57, "proved"),
     ([[0.0, 1.0], [-4.0, -0.4]], 1.59, "undecided"),
     ([[-3.0, 2.0, 0.5], [-2.0, -3.0, 8.0], [0.0, 0.0, -1.0]], 1.5, "proved"),
     ([[-3.0, 2.0, 0.5], [-2.0, -3.0, 8.0], [0.0, 0.0, -1.0]], 1.6, "undecided")],
)  # fmt: skip
def test_units_of_the_states_do_not_decide(
    units: float, A: list[list[float]], h: float, outcome: str
) -> None:
    """An oscillator that turns by |Im mu| h, whatever its speed is measured in."""
    scale = np.array([1.0, units, units**0.5])[: len(A)]
    scaled = np.array(A) * scale[:, None] / scale
    H = exact(np.array([[0.0], [1.0], [1.0]])[: len(A)] * scale[:, None])
    assert _uniqueness(exact(scaled), H, h).outcome == outcome


def test_as_many_samples_as_are_asked_for_are_enough() -> None:
    D = exact([[-0.1]])
    gains: Any = SimpleNamespace(
        n=1, directions=1, p=1, window=1.0, exponents=-1.0 - np.arange(2), A=[[-0.1]], C=[[1.0]]
    )
    few = _window_verdict(gains, D, 0.5, 9.0)
    assert few.outcome == "undecided"
    reason = "3 samples in a window are too few to be certain: 3 numbers are unknown, and 4 samples"
    assert reason in few.evidence["reason"]
    gains.window = 1.5
    assert "too few" not in _window_verdict(gains, D, 0.5, 9.0).evidence.get("reason", "")
