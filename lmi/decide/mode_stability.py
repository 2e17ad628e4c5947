"""Decide stability of a graph of modes: find, prove, refute in turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lmi.find.mode_search import find_modes
from lmi.find.worst_stays import worst_stays
from lmi.modes import Modes
from lmi.refute.stays import refute_endless_stay, refute_stays
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict


def decide_modes(modes: Modes, *, budget: TimeBudget = UNLIMITED) -> Verdict:
    """Decide whether x -> 0 along every path of the graph, whatever the stays in their ranges.

    Proved by a P for each mode, or for each cell of the stay before it (`lmi.prove.modes_proof`),
    refuted by a mode that may last, or by a cycle of stays, or undecided: then with the largest
    growth of a cycle that floats know. Paths that change modes without end in no time (stays of 0)
    count: they are refuted.
    """
    endless = refute_endless_stay(modes)
    if endless.outcome == "refuted":
        return endless
    few = find_modes(modes, most_cells=len(modes), budget=budget)
    if few.verdict.outcome == "proved":
        return few.verdict
    word = refuted_by_word(modes, few.stays, budget=budget)
    if word.outcome == "refuted":
        return word
    cells = few if few.is_exhausted else find_modes(modes, start=few, budget=budget)
    if cells.verdict.outcome == "proved":
        return cells.verdict
    growth = {k: word.evidence[k] for k in ("stays", "spectral_radius") if k in word.evidence}
    return replace(cells.verdict, evidence={**cells.verdict.evidence, **growth})


def refuted_by_word(
    modes: Modes, seeds: Sequence[tuple[int, float]], *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Refuted by the worst cycle of stays that floats know; else undecided, with that cycle."""
    try:
        with np.errstate(all="ignore"):
            worst = worst_stays(modes, seeds, budget=budget)
    except (np.linalg.LinAlgError, ValueError):  # overflow: nothing to be learned from floats
        worst = None
    if worst is None:
        return Verdict("undecided", {"reason": "the modes have no cycle"})
    return refute_stays(modes, worst.word)
