"""Affine families: the box of half ranges, corners, and what counts as one parameter."""

from __future__ import annotations

import numpy as np
import pytest

from lmi.arithmetic.balls import exact, rational
from lmi.parameters import MOST_PARAMETERS, AffineFamily
from tests.lmi.parameter_examples import from_ranges, oscillator

NONE = np.zeros((2, 2))


def unit(i: int, j: int, n: int = 2) -> np.ndarray:
    effect = np.zeros((n, n))
    effect[i, j] = 1
    return effect


def test_a_range_is_its_middle_and_half_of_it() -> None:
    family = from_ranges(NONE, np.eye(2), [(unit(0, 1), unit(1, 1))], [(0.8, 1.3)])
    low, high = rational(0.8), rational(1.3)
    assert family.flow([-1])[0, 1] == low
    assert family.flow([1])[0, 1] == high
    assert family.jump([1])[1, 1] == 1 + high
    assert family.flow([0])[0, 1] == (low + high) / 2
    # the twin: what is not affected is as it was
    assert family.flow([1])[1, 0] == 0
    with pytest.raises(ValueError, match="low <= high"):
        from_ranges(NONE, NONE, [(NONE, NONE)], [(1.0, 0.5)])


def test_shapes_that_do_not_agree_are_refused() -> None:
    with pytest.raises(ValueError, match="entries each"):
        AffineFamily(exact(np.zeros((2, 2, 2))), exact(np.zeros((1, 2, 2))), (False,))
    with pytest.raises(ValueError, match="is_constant"):
        AffineFamily(exact(np.zeros((2, 2, 2))), exact(np.zeros((2, 2, 2))))


def test_vertices_are_the_corners() -> None:
    effects = [(unit(0, 1), NONE), (unit(1, 0), unit(1, 1))]
    family = from_ranges(NONE, np.eye(2), effects, [(-1, 1), (2, 4)])
    corners = [family.flow(p).tolist() for p in family.corners()]
    vertices = [A.tolist() for A in family.flow_vertices()]
    assert len(vertices) == 4
    assert all(A in corners for A in vertices)
    # only one of them acts on jumps
    assert sorted(float(G[1, 1]) for G in family.jump_vertices()) == [3.0, 5.0]


@pytest.mark.parametrize("factor", [1.0, -0.5])
def test_parallel_effects_are_one(factor: float) -> None:
    effects = [(unit(0, 1), NONE), (factor * unit(0, 1), NONE), (NONE, NONE)]
    family = from_ranges(NONE, NONE, effects, [(-1, 1)] * 3)
    ends = sorted(float(A[0, 1]) for A in family.flow_vertices())
    assert ends == [-1 - abs(factor), 1 + abs(factor)]


def test_too_many_parameters_are_refused() -> None:
    n = 4
    places = [(i, j) for i in range(n) for j in range(n)]

    def family(count: int) -> AffineFamily:
        effects = [(unit(i, j, n), np.zeros((n, n))) for i, j in places[:count]]
        return from_ranges(np.eye(n), np.eye(n), effects, [(-1, 1)] * count)

    assert len(family(MOST_PARAMETERS).flow_vertices()) == 256
    with pytest.raises(ValueError, match="at most 8 parameters"):
        family(MOST_PARAMETERS + 1).flow_vertices()


def test_halves_cover_the_box() -> None:
    family = oscillator(0.4)
    below, above = family.halves(0)
    for p in (-1.0, -0.25, 0.0):
        assert (below.flow([2 * p + 1]) == family.flow([p])).all()
    for p in (0.0, 0.5, 1.0):
        assert (above.flow([2 * p - 1]) == family.flow([p])).all()


def test_a_factor_keeps_the_middle() -> None:
    family = oscillator(0.4)
    wider = family.scaled(1.5)
    assert (wider.flow([0]) == family.flow([0])).all()
    assert wider.flow([1])[1, 0] == -1 - rational(0.4) * rational(1.5)
