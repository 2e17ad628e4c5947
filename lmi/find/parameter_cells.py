"""Cells of constant parameters for which R(tau) exists: the box, or halves of halves of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from lmi.arithmetic.arrays import NewEntries
from lmi.find.clock_matrix import find_clock_matrix
from lmi.find.worst_parameters import worst_dwell_time
from lmi.parameters import AffineFamily
from lmi.prove.parameter_cells import DEEPEST
from lmi.time_budget import UNLIMITED, TimeBudget, ended_by_count
from lmi.verdict import Verdict, undecided

_CELLS = 256
# a cell that needs more segments is better cut
_SEGMENTS = (8, 12)


@dataclass
class _Cell:
    """Its family, the ends of each parameter, its certificate or the two halves of it."""

    family: AffineFamily
    box: list[list[float]]
    depth: int = 0
    leaf: NewEntries = field(default_factory=dict)
    parameter: int = -1
    halves: list[_Cell] = field(default_factory=list)

    def certificate(self) -> NewEntries:
        """The tree below this cell."""
        if not self.halves:
            return dict(self.leaf)
        halves = [half.certificate() for half in self.halves]
        return {"parameter": self.parameter, "halves": halves}

    def cut(self, parameter: int) -> None:
        """Make the two halves."""
        self.parameter, (low, high) = parameter, self.box[parameter]
        middle, ends = (low + high) / 2, []
        for piece in ([low, middle], [middle, high]):
            ends.append([*self.box[:parameter], piece, *self.box[parameter + 1 :]])
        self.halves = [
            _Cell(half, box, self.depth + 1)
            for half, box in zip(self.family.halves(parameter), ends, strict=True)
        ]


def find_cells(
    family: AffineFamily, low: float, high: float, *, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Proved with a tree of cells (`lmi.prove.parameter_cells`), or undecided.

    Undecided evidence: "cells", those proved, "share" of the box that they cover, and "worst_cell",
    the ends of each parameter in the largest that is not. The search ends where the middle of a
    cell is unstable.
    """
    root = _Cell(family, [[-1.0, 1.0] for _ in range(family.count)])
    waiting, count, proved_cells, share, matrices = deque([root]), 1, 0, 0.0, 0
    most = budget.scaled(_CELLS)
    while waiting:
        cell = waiting.popleft()
        verdict = find_clock_matrix(cell.family, low, high, segments=_SEGMENTS, budget=budget)
        if verdict.outcome == "proved":
            cell.leaf = {key: verdict.evidence[key] for key in ("nodes", "R")}
            proved_cells, share = proved_cells + 1, share + 0.5**cell.depth
            matrices += verdict.evidence["matrices"]
            continue
        widest = _widest(cell.family, min(high, max(low, 1.0)))
        limit = budget.ended() or (ended_by_count("cells", most) if count >= most else {})
        centre = worst_dwell_time(cell.family, (0.0,) * family.count, low, high)
        if limit or widest < 0 or cell.depth >= DEEPEST or centre.radius >= 1:
            return undecided("not every cell of the constant parameters has a certificate",
                             cells=proved_cells, share=share, worst_cell=cell.box,
                             **limit)  # fmt: skip
        cell.cut(widest)
        waiting.extend(cell.halves)
        count += 1
    evidence = {**root.certificate(), "cells": count, "matrices": matrices}
    return Verdict("proved", evidence, ("Clarabel",))


def _widest(family: AffineFamily, unit: float) -> int:
    """The constant parameter with the largest effect in a cell; -1 where none has any."""
    A, G = (np.abs(parts).max(axis=(1, 2), initial=0.0) for parts in family.floats())
    effects = np.where(family.is_constant, A[1:] * unit + G[1:], 0.0)
    return int(np.argmax(effects)) if effects.max(initial=0.0) > 0 else -1
