"""Words with long repeats: flows that swing, pumped by switching between two dwell times; twins."""

from __future__ import annotations

import numpy as np
import pytest

from lmi.decide.stability import decide
from lmi.families import Edge
from lmi.find.worst_sequence import Word, polished, worst_word
from tests.systems.pairs import growth

LOW, HIGH = 0.5, 2.0


def swing(stiffness: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """x'' = -2 damping x' ..., kicked back at jumps: a turn takes about 2 pi / sqrt(stiffness
    theta) jumps, in ellipses that depend on theta.
    """
    F = np.array([[-damping, 1.0], [0, -damping]])
    return F, np.array([[1.0, 0], [-stiffness, 1]])


@pytest.mark.parametrize(("stiffness", "damping"), [(0.04, 0.01), (0.01, 0.01), (0.0025, 0.004)])
def test_quarter_turns_at_either_end_destabilise(stiffness: float, damping: float) -> None:
    F, H = swing(stiffness, damping)
    verdict = decide(F, H, LOW, HIGH)
    assert verdict.outcome == "refuted"
    thetas = np.array(verdict.evidence["witness"]["thetas"])
    assert len(thetas) > 10
    assert ((thetas >= LOW) & (thetas <= HIGH)).all()
    # independent of balls and words: norms along the sequence, repeated
    assert growth(F, H, np.tile(thetas, 40)) > 10 * growth(F, H, np.tile(thetas, 5))
    # twins: more damping, or no large steps allowed
    assert decide(*swing(stiffness, 0.05), LOW, HIGH).outcome == "proved"
    steps = decide(F, H, LOW, HIGH, jitter=1.0, memory=0)
    if steps.outcome == "refuted":
        thetas = np.array(steps.evidence["witness"]["thetas"])
        assert np.abs(thetas - np.roll(thetas, 1)).max() <= 1.0


def test_a_long_word_keeps_its_shape_and_the_step_limit_where_it_is_polished() -> None:
    edge = Edge(*swing(0.01, 0.01), LOW, HIGH)
    word = Word((0.6,) * 20 + (1.4,) * 13, 0.0)
    free, bound = polished(edge, word), polished(edge, word, jitter=1.0)
    assert free.growth >= bound.growth > 0
    for found, jitter in ((free, np.inf), (bound, 1.0)):
        thetas = np.array(found.thetas)
        assert len(set(found.thetas)) == 2
        assert np.abs(thetas - np.roll(thetas, 1)).max() <= jitter


def test_the_growth_of_a_word_is_that_of_its_product() -> None:
    edge = Edge(*swing(0.01, 0.01), LOW, HIGH)
    word = worst_word(edge, np.eye(2), (), np.random.default_rng(0))
    product = np.eye(2)
    for M in edge.maps(word.thetas):
        product = M @ product
    rate = np.abs(np.linalg.eigvals(product)).max() ** (1 / len(word.thetas))
    assert word.growth == pytest.approx(rate, rel=1e-9)
