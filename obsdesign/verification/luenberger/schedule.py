"""Stability with gains at jumps that depend on the dwell time that has just ended.

With P_i after a jump whose dwell time lay in cell i, and H_j = (G - M_j C) the error there,

    e^{F' theta} H_j' P_j H_j e^{F theta} < P_i   for all theta in cell j, all i that may precede j

makes e' P_i e fall from jump to jump, whatever the dwell times. Which pairs may follow each other
is computed here again.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix
from lmi.arithmetic.balls import Exact, exact
from lmi.prove.common_matrix import prove
from lmi.prove.condition import Condition
from lmi.refute.spectral import refute_spectral
from lmi.verdict import Verdict, proved, undecided
from obsdesign.equations.estimation_error import jump_error_matrix
from obsdesign.equations.luenberger import error_system as equations
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.options import LuenbergerOptions
from obsdesign.problem.problem import Problem
from obsdesign.verification.proposal import numbers_of
from obsdesign.verification.tails import proved_tails


def scheduled_stability(
    problem: Problem,
    gains: LuenbergerGains,
    F: Exact,
    certificate: Entries,
    paranoid: bool,
) -> Verdict:
    """Decide stability of the error for every admissible sequence of dwell times.

    F (n, n) exact, the flow of the error (plus a rate); certificate: {"P_cells": [n x n, ...]} or
    nothing, checked here.
    """
    jump = problem.plant.jump
    assert jump is not None
    assert gains.dwell_borders is not None
    assert gains.M_cells is not None
    borders = gains.dwell_borders.tolist()
    cells = equations.schedule_cells(*problem.require_dwell_time(), borders)
    errors = [_error(gains, M) for M in gains.M_cells]
    matrices = _matrices(certificate.get("P_cells"), len(cells), len(F))
    attempt = undecided("no certificate P_cells was given or found")
    if matrices is not None:
        pairs = equations.schedule_pairs(cells, jump.dwell_jitter)
        methods = ("bernstein", "chords") if paranoid else ("bernstein",)
        attempt = _proof(F, errors, matrices, cells, pairs, methods=methods)
        if attempt.outcome == "proved":
            tails = proved_tails(F, certificate.get("tails"))
            stated = {"P_cells": certificate["P_cells"], **attempt.evidence, **tails}
            return Verdict("proved", stated)
    low, high = problem.require_dwell_time()
    inner = itertools.pairwise([low, *borders, high])
    for H, (start, end) in zip(errors, inner, strict=True):
        # a cell ends just before the next one begins, and only the last one holds its end
        last = end if end == high else math.nextafter(end, -math.inf)
        counter = refute_spectral(F, H, start, last)
        if counter.outcome == "refuted":
            return counter
    return attempt


def reason_against_borders(problem: Problem, stored: Entries) -> str | None:
    """Return why the borders of the cells cannot be those of a schedule, or None."""
    if problem.options_as(LuenbergerOptions).schedule is None:
        return None
    low, high = problem.require_dwell_time()
    inner = stored.get("dwell_borders")
    if not isinstance(inner, np.ndarray) or inner.ndim != 1:
        return "gains.dwell_borders must be a list of numbers."
    borders = [low, *inner.tolist(), high]
    if all(a < b for a, b in itertools.pairwise(borders)):
        return None
    return "gains.dwell_borders must increase inside problem.jump.dwell_time."


def _error(gains: LuenbergerGains, M: Matrix) -> Exact:
    return jump_error_matrix(
        exact(gains.jump_matrix), exact(M), exact(gains.C), gains.jump_measurement
    )


def _proof(
    F: Exact,
    errors: list[Exact],
    matrices: Matrix,
    cells: tuple[tuple[float, float], ...],
    pairs: tuple[tuple[int, int], ...],
    *,
    methods: tuple[str, ...],
) -> Verdict:
    unit = exact(np.eye(len(F)))
    boxes = 0
    for method in methods:
        for earlier, later in pairs:
            ends = cells[later]
            condition = Condition(
                F, unit, matrices[earlier], matrices[later], *ends, left=errors[later]
            )
            verdict = prove(condition, method=method)
            if verdict.outcome != "proved":
                where = f"from cell {earlier + 1} to cell {later + 1} of the dwell times"
                return undecided(f"{where}: {verdict.reason}")
            boxes += verdict.evidence.get("boxes", 0)
    return proved(cells=[list(ends) for ends in cells], pairs=len(pairs), boxes=boxes)


def _matrices(values: object, count: int, n: int) -> Matrix | None:
    matrices = numbers_of(values)
    if matrices is None or matrices.shape != (count, n, n) or not np.isfinite(matrices).all():
        return None
    return matrices if np.array_equal(matrices, np.swapaxes(matrices, 1, 2)) else None
