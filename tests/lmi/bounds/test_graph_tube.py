"""Tubes on graphs: what is proved is not left, whatever passages a run takes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact
from lmi.arithmetic.exponential import expm
from lmi.bounds.graph_proof import prove_graph
from lmi.bounds.graph_tube import Graph, Least, Passage
from lmi.find.graph_tube import input_sizes, proposed_tubes
from lmi.time_budget import TimeBudget

_HELD = (False, True)


def graph(low: float, high: float, gap: float = 0.3) -> Graph:
    """Two entries; node 0 before an event, node 1 before the last sample of entry 1 before it."""
    W, f = exact([[-1.0, 0.0], [1.0, -2.0]]), exact([0.2, 0.2])
    event = Least(((exact([[2.0, 1.0], [1.0, 3.0]]), exact([0.6, 0.6])),))
    sample = Least((
        (exact(np.eye(2)), exact([0.0, 0.0])), (exact([[1.0, 0.0], [0.0, 0.0]]), exact([0.0, 0.06])),
    ))  # fmt: skip
    nodes = (
        ((Passage(0, 0, low, high),), (Passage(1, 1, 0.0, gap),)),
        ((Passage(0, 0, low - gap, high),),),
    )
    return Graph(((W, f),), ((event,), (sample,)), nodes)


def tube_of(one: Graph) -> Matrix | None:
    return next(proposed_tubes(one, 1e-7 * input_sizes(one)), None)


def test_a_proved_tube_is_not_left() -> None:
    one = graph(1.2, 2.0)
    v = tube_of(one)
    assert v is not None
    assert prove_graph(one, v.tolist()).outcome == "proved"
    rng, W = np.random.default_rng(0), np.array([[-1.0, 0.0], [1.0, -2.0]])
    Z = np.block([[W, np.full((2, 1), 0.2)], [np.zeros((1, 3))]])
    w, largest = 50 * v[0], np.zeros(2)
    for k in range(400):
        span, back = rng.choice([1.2, 1.2, 2.0]), rng.choice([0.0, 0.3, 0.3])
        u = np.array([2 * w[0] + w[1] + 0.6, w[0] + 3 * w[1] + 0.6, 1.0])
        u = expm(Z * (span - back)) @ u
        w = (expm(Z * back) @ np.array([u[0], min(u[1], 0.06), 1.0]))[:2]
        largest = np.maximum(largest, w) if k > 100 else largest
    assert (largest <= v[0]).all()
    assert (largest > 0.9 * v[0]).all()


@pytest.mark.parametrize("entry", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_tube_that_is_left_is_not_proved(entry: tuple[int, int]) -> None:
    one = graph(1.2, 2.0)
    v = tube_of(one)
    assert v is not None
    smaller = v.copy()
    smaller[entry] *= 0.9
    assert prove_graph(one, smaller.tolist()).outcome == "undecided"


def test_other_times_need_another_tube() -> None:
    v = tube_of(graph(1.2, 2.0))
    assert v is not None
    for other in (graph(1.15, 2.0), graph(1.2, 2.0, gap=0.35)):
        assert prove_graph(other, v.tolist()).outcome == "undecided"


def test_what_grows_has_no_tube() -> None:
    assert tube_of(graph(0.7, 1.0)) is None


@pytest.mark.parametrize("values", [[], [[1.0, 1.0]], [[1.0, -1.0]] * 2, [[1.0, np.inf]] * 2])
def test_values_that_are_no_tube_are_not_proved(values: list[list[float]]) -> None:
    assert prove_graph(graph(1.2, 2.0), values).outcome == "undecided"


def test_entries_that_are_held_are_bounds_of_nothing() -> None:
    """An integrator fed by a stable entry: held at its bound it is, but bounds nothing itself."""
    W, f = exact([[0.0, 1.0], [0.0, -1.0]]), exact([0.0, 1.0])
    read = Least(((exact([[0.0, 0.0], [0.0, 1.0]]), exact([0.5, 0.0])),))
    sampled = (Passage(0, 0, 0.0, 2.0, held=_HELD, through=(0,)),)
    silent = (Passage(0, 0, 0.0, 2.0, held=_HELD, through=(0,), silent=(True, False)),)
    free = (Passage(0, None, 1.0, 1.0),)
    one = Graph(((W, f),), ((read,),), ((sampled, free),))
    v = tube_of(one)
    assert v is not None
    assert prove_graph(one, v.tolist()).outcome == "proved"
    assert v[0] == pytest.approx([2.5, 1.0], rel=2e-3)
    for strategies in ((sampled,), (silent, free)):
        less = Graph(((W, f),), ((read,),), (strategies,))
        assert prove_graph(less, v.tolist()).outcome == "undecided"


@pytest.mark.parametrize(("longest", "is_bounded"), [(20.0, True), (24.5, False), (5e4, False)])
def test_a_growing_flow_is_followed_to_the_end_of_its_time(
    longest: float, is_bounded: bool
) -> None:
    one = exact(np.array([[1.0]]))
    push = exact(np.array([1.0]))
    grow, fall = ((exact(np.array([[rate]])), push) for rate in (0.05, -0.6))
    stay = Least(((one, exact(np.array([0.0]))),))
    nodes = (
        ((Passage(1, 0, 2.0, 10.0, flow=1),),),
        ((Passage(0, 0, 1.0, longest, flow=0),),),
    )
    stays = Graph((grow, fall), ((stay,),), nodes)
    tube = tube_of(stays)
    assert (tube is not None) == is_bounded
    if tube is not None:
        assert prove_graph(stays, tube.tolist()).outcome == "proved"
        longer = Graph((grow, fall), ((stay,),), (nodes[0], ((Passage(0, 0, 1.0, 23.0),),)))
        assert prove_graph(longer, tube.tolist()).outcome == "undecided"


def test_a_proof_ends_with_the_total() -> None:
    one = graph(1.2, 2.0)
    v = tube_of(one)
    assert v is not None
    verdict = prove_graph(one, v.tolist(), TimeBudget(1.0, -math.inf))
    assert verdict.outcome == "undecided"
    assert verdict.evidence["ended_by"] == "time"
    assert prove_graph(one, v.tolist(), TimeBudget(1.0)).outcome == "proved"
