"""Tubes of positive systems in discrete time on graphs."""

from __future__ import annotations

import numpy as np
import pytest

from lmi.arithmetic.balls import exact
from lmi.bounds.graph_tube import Least
from lmi.bounds.step_tube import StepGraph, prove_steps
from lmi.find.step_tube import proposed_step_tubes, step_input_sizes


def affine(N: list[list[float]], k: list[float]) -> Least:
    return Least(((exact(N), exact(k)),))


def one_node(*words: Least) -> StepGraph:
    arcs = np.array([(0, word, 0) for word in range(len(words))])
    return StepGraph(tuple((word,) for word in words), arcs, 1, len(words[0].maps[0][1]))


def test_the_least_fixed_point_of_one_map() -> None:
    """(I - N)^-1 k, from above by next to nothing; a tube below it is not proved."""
    N, k = [[0.5, 0.25], [0, 0.75]], [1.0, 2.0]
    graph = one_node(affine(N, k))
    limit = np.linalg.solve(np.eye(2) - N, k)
    tube = next(proposed_step_tubes(graph, 1e-12 * step_input_sizes(graph)))
    np.testing.assert_allclose(tube[0], limit, rtol=1e-9)
    assert prove_steps(graph, tube.tolist()).outcome == "proved"
    for low in (limit * (1 - 1e-9), limit * [1.0, 0.999]):
        assert prove_steps(graph, [low.tolist()]).outcome == "undecided"


@pytest.mark.parametrize("rate", [1.0, 1.001])
def test_a_map_that_does_not_contract_has_no_tube(rate: float) -> None:
    graph = one_node(affine([[rate]], [0.0]))
    assert not list(proposed_step_tubes(graph, np.ones(1)))
    assert prove_steps(graph, [[1.0]]).outcome == "undecided"


def test_two_words_are_bounded_by_the_worse_of_each_step() -> None:
    """Two maps of which each contracts, and a word of both does not."""
    a, b = affine([[0, 2], [0.25, 0]], [0, 0]), affine([[0, 0.25], [2, 0]], [0, 0])
    assert list(proposed_step_tubes(one_node(a), np.ones(2)))
    assert list(proposed_step_tubes(one_node(b), np.ones(2)))
    assert not list(proposed_step_tubes(one_node(a, b), np.ones(2)))
    # in turns only: nodes that follow each other, where the word of both is the wrong way round
    turns = StepGraph(((a,), (a,)), np.array([(0, 0, 1), (1, 1, 0)]), 2, 2)
    tube = next(proposed_step_tubes(turns, np.ones(2)))
    assert prove_steps(turns, tube.tolist()).outcome == "proved"


def test_the_least_of_two_maps_at_a_sample() -> None:
    """Growth by 2, cut to 3 by a sample every step: the bound is 3 after it."""
    grow = affine([[2.0]], [1.0])
    cut = Least(((exact([[1.0]]), exact([0.0])), (exact([[0.0]]), exact([3.0]))))
    graph = StepGraph(((grow, cut),), np.array([(0, 0, 0)]), 1, 1)
    tube = next(proposed_step_tubes(graph, np.array([1e-9])))
    assert tube[0, 0] == pytest.approx(3.0, rel=1e-8)
    assert prove_steps(graph, tube.tolist()).outcome == "proved"
    assert prove_steps(graph, [[2.9]]).outcome == "undecided"


def test_what_is_no_tube_is_refused() -> None:
    graph = one_node(affine([[0.5]], [1.0]))
    for values in ([[0.0]], [[float("nan")]], [[1.0, 1.0]], [[4.0], [4.0]]):
        assert prove_steps(graph, values).outcome == "undecided"
