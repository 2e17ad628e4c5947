"""Tubes in discrete time: least fixed points of what the arcs of a graph make of a bound.

v = (1 + margin) image(v) + added: from below, by images, and after some of them by the exact
solution for the arcs and maps that are the active ones.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.bounds.step_tube import StepGraph
from lmi.time_budget import UNLIMITED, TimeBudget

# relative room above the image of the tube, least first: a proof in rationals needs next to none
_MARGINS = (1e-11, 1e-9, 1e-6, 1e-3)
_ROUNDS, _IMAGES = 80, 40
_LARGEST_SYSTEM = 1500  # unknowns of an exact solution
_LEAST_CHANGE = 1e-12  # relative change of images below which they are a fixed point
_LARGEST_GROWTH = 1e25  # beyond so many times what is added, it diverges


def proposed_step_tubes(
    graph: StepGraph, added: Matrix, budget: TimeBudget = UNLIMITED
) -> Iterator[Matrix]:
    """Tubes v (nodes, n) that floats confirm, the narrowest first; none where none was found.

    added (n,) > 0: what every entry has at least, beside what inputs make of it.
    """
    for margin in _MARGINS:
        if (v := _fixed_point(graph, margin, added, budget)) is None:
            return  # more room makes it harder
        yield v


def step_input_sizes(graph: StepGraph) -> Matrix:
    """What inputs add to each entry in a few steps, (n,) > 0; 1 where there are none."""
    v = np.zeros((graph.nodes, graph.n))
    for _ in range(2 * graph.n):
        v = np.maximum(v, graph.image(v))
    size: Matrix = v.max(axis=0)
    largest = float(size.max())
    return np.where(size > 0, size, largest if largest > 0 else 1.0)


def _fixed_point(
    graph: StepGraph, margin: float, added: Matrix, budget: TimeBudget
) -> Matrix | None:
    """The least fixed point; None where it diverges or is not reached."""
    v = np.tile(added, (graph.nodes, 1))
    for turn in range(1, _ROUNDS + 1):
        for _ in range(_IMAGES):
            before, v = v, (1 + margin) * graph.image(v) + added
        if not np.isfinite(v).all() or (v > _LARGEST_GROWTH * added.max()).any():
            return None
        # later solutions are for the same active maps: fewer and fewer of them
        is_due = turn & (turn - 1) == 0
        solved = _solved(graph, v, margin, added) if is_due else None
        for tube in (solved, v):
            if tube is not None and _is_fixed(graph, tube, margin, added):
                return tube
        if float((v / before - 1).max()) < _LEAST_CHANGE or budget.remaining() < 0:
            break
    return None


def _is_fixed(graph: StepGraph, v: Matrix, margin: float, added: Matrix) -> bool:
    """Is v the fixed point, and its image below it?"""
    image = graph.image(v)
    off = np.abs((1 + margin) * image + added - v)
    is_near = bool((off <= 1e-9 * v).all())
    return is_near and bool(((1 + margin / 4) * image + added / 4 <= v).all())


def _solved(graph: StepGraph, v: Matrix, margin: float, added: Matrix) -> Matrix | None:
    """The fixed point of the affine maps that are active at v; None unless it is positive."""
    size = graph.nodes * graph.n
    if size > _LARGEST_SYSTEM:
        return None
    values = graph.values(v)
    best = np.full((graph.nodes, graph.n), -1)
    order = np.arange(len(graph.arcs))
    for i in range(graph.n):
        by_value = order[np.argsort(values[:, i], kind="stable")]
        best[graph.arcs[by_value, 2], i] = by_value  # the last, largest one stays
    A, b = np.zeros((size, size)), np.tile(added, graph.nodes)
    for node, entry in np.ndindex(best.shape):
        arc = best[node, entry]
        if arc < 0:
            continue
        source, word, _ = graph.arcs[arc]
        row, constant = _active(graph, word, v[source], entry)
        A[node * graph.n + entry, source * graph.n : (source + 1) * graph.n] = row
        b[node * graph.n + entry] += (1 + margin) * constant
    try:
        solution = np.asarray(np.linalg.solve(np.eye(size) - (1 + margin) * A, b), np.float64)
    except np.linalg.LinAlgError:
        return None
    is_usable = np.isfinite(solution).all() and (solution > 0).all()
    return solution.reshape(graph.nodes, graph.n) if is_usable else None


def _active(graph: StepGraph, word: int, u: Matrix, entry: int) -> tuple[Matrix, float]:
    """Row and constant of an entry of what a word makes of u, as an affine map of u."""
    factor, constant = np.eye(len(u)), np.zeros(len(u))
    for stage in graph.floats[word]:
        values = np.array([N @ u + k for N, k in stage])
        chosen = np.argmin(values, axis=0)
        N = np.array([stage[j][0][i] for i, j in enumerate(chosen)])
        k = np.array([stage[j][1][i] for i, j in enumerate(chosen)])
        factor, constant, u = N @ factor, N @ constant + k, N @ u + k
    return factor[entry], float(constant[entry])
