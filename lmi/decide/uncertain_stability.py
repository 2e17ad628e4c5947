"""Decide stability of x' = A(p) x, x+ = G(p) x with p in a box and dwell times in a range.

The parts are separate programs; this file only lets them take turns.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.balls import to_float
from lmi.families import Edge
from lmi.find.bang_bang import worst_switching
from lmi.find.clock_matrix import SEGMENTS, find_clock_matrix
from lmi.find.parameter_cells import find_cells
from lmi.find.worst_parameters import worst_points
from lmi.find.worst_sequence import worst_word
from lmi.parameters import AffineFamily, Point
from lmi.refute.parameter_words import refute_constant_parameters, refute_parameters
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, undecided

# floats may put a spectral radius above 1 so far below it
_ROUNDING = 1e-6
_SEED = 20165  # the search for destabilising sequences repeats itself exactly


def decide_uncertain(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Decide whether x -> 0 for every p in the box and all dwell times in [low, high].

    Proved by a matrix of the time since a jump, or one for each cell of the constant parameters
    (`lmi.prove.parameter_cells` checks both); refuted by constant parameters ("p"), or by some that
    switch ("stays"), with their dwell times; or undecided, then with the largest growth of such a
    word, "growth_per_jump". 0 <= low <= high <= infinity; ValueError for other ranges, and for too
    many parameters (`lmi.parameters`).
    """
    if not 0 <= low <= high or math.isinf(low):
        raise ValueError(f"0 <= low <= high, low finite, is required; got [{low}, {high}]")
    first = find_clock_matrix(family, low, high, segments=SEGMENTS[:1], budget=budget)
    if first.outcome == "proved":
        return first
    counter = refuted_uncertain(family, low, high, budget=budget)
    if counter.outcome == "refuted":
        return counter
    attempt = find_uncertain(family, low, high, budget=budget)
    if attempt.outcome != "undecided":
        return attempt
    growth = {k: counter.evidence[k] for k in ("stays", "growth_per_jump") if k in counter.evidence}
    reason = "no matrix of the time since a jump fits the corners, which is not instability"
    if "growth_per_jump" in growth:
        reason += (
            f"; parameters that switch grow by {growth['growth_per_jump']:.6g} per jump at most"
        )
        reason += ", as far as they were searched"
    return replace(attempt, evidence={**attempt.evidence, "reason": reason, **growth})


def find_uncertain(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Proved with a certificate, of cells where parameters are constant, else undecided.

    Refuted where the middle of a cell is.
    """
    if any(family.is_constant):
        attempt = find_cells(family, low, high, budget=budget)
        ends = attempt.evidence.get("worst_cell", [])
        middle = tuple((below + above) / 2 for below, above in ends)
        counter = refute_constant_parameters(family, middle, low, high) if ends else attempt
        return counter if counter.outcome == "refuted" else attempt
    return find_clock_matrix(family, low, high, segments=SEGMENTS[1:], budget=budget)


def refuted_uncertain(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Refuted by constant parameters or by some that switch; else undecided, with the growth."""
    try:
        with np.errstate(all="ignore"):
            counter = refuted_by_constants(family, low, high, budget=budget)
            worst = None
            if counter.outcome != "refuted":
                worst = worst_switching(family, low, high, budget=budget)
    except (np.linalg.LinAlgError, ValueError):  # overflow: nothing to be learned from floats
        return undecided("floats overflow in the search for a destabilising word")
    return counter if worst is None else refute_parameters(family, low, high, worst.word)


def refuted_by_constants(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Refuted by constant parameters: those of large radii, and the middle of the box."""
    candidates = worst_points(family, low, high)
    centre = (0.0,) * family.count
    for entry in candidates:
        if entry.radius >= 1 - _ROUNDING:
            thetas = () if entry.theta is None else (entry.theta,)
            counter = refute_constant_parameters(family, entry.p, low, high, thetas)
            if counter.outcome == "refuted":
                return counter
    counter = refute_constant_parameters(family, centre, low, high)
    for p in dict.fromkeys([candidates[0].p, centre]):
        if counter.outcome == "refuted":
            break
        counter = _by_dwell_times(family, p, (low, high), budget)
    return counter


def _by_dwell_times(
    family: AffineFamily, p: Point, ends: tuple[float, float], budget: TimeBudget
) -> Verdict:
    """Refuted by a sequence of dwell times at this p."""
    edge = Edge(to_float(family.flow(p)), to_float(family.jump(p)), *ends)
    rng = np.random.default_rng(_SEED)
    word = worst_word(edge, np.eye(family.order), (), rng, budget=budget)
    return refute_constant_parameters(family, p, *ends, word.thetas)
