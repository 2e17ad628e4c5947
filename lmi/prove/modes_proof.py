"""Proof that matrices P, one for every cell of modes, decrease along all paths of a graph.

    M(theta)' P_t M(theta) < gamma^2 P_s,   M(theta) = G_j e^{F_i theta}

for every cell s of mode i, every cell t of a mode j that can follow, and all theta of cell t. A
cell is a mode, alone or with the mode before it and a range of the stay there: each mode's cells
have all stays in all modes before it between them, so that V = x'P_s x falls at every change of
mode, s being the cell in which x enters its mode. Only the cells are read from a certificate; its
edges and ranges follow from the modes. Decrease is asked at the ends of stays alone: weaker than
the condition of Briat 2013 for minimum dwell times, which has P_i fall along the flow too.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries, Value, floats
from lmi.arithmetic.balls import exact
from lmi.modes import Modes, Stay
from lmi.prove.common_matrix import BOX_LIMIT, prove
from lmi.prove.condition import Condition
from lmi.prove.hurwitz import prove_hurwitz
from lmi.prove.window_partition import end_of_cell
from lmi.verdict import Verdict, proved, undecided

_MOST_CELLS = 400


@dataclass(frozen=True)
class ModeCell:
    """A mode, entered from `before` after a stay in [low, high] there; before None: from any."""

    mode: int
    before: int | None = None
    low: float = 0.0
    high: float = math.inf


def cell_edges(modes: Modes, cells: Sequence[ModeCell]) -> list[tuple[int, int, int, Stay]]:
    """(source, target, mode of the source, range of theta): each cell with each that can follow."""
    edges = []
    for s, source in enumerate(cells):
        i = source.mode
        for t, target in enumerate(cells):
            if target.mode not in modes.following[i]:
                continue
            if target.before is None:
                edges.append((s, t, i, modes.stays[i]))
            elif target.before == i:
                edges.append((s, t, i, (target.low, target.high)))
    return edges


def prove_modes(
    modes: Modes,
    certificate: Entries,
    *,
    gamma: float = 1.0,
    method: str = "bernstein",
    steps: int = BOX_LIMIT,
) -> Verdict:
    """Prove that x -> 0 along every path of the graph, by the P of a certificate.

    certificate: {"cells": [{"mode": i, "before": j, "stay": [low, high], "P": n x n}, ...]}, before
    and stay absent where the mode may be entered from any. Proved or undecided; then
    evidence["edge"], [source, target] cell, and ["theta"] say where an inequality fails.
    """
    try:
        cells, matrices = read_cells(modes, certificate)
    except ValueError as error:
        return undecided(str(error))
    for i, (_, high) in enumerate(modes.stays):
        if math.isinf(high) and (flow := prove_hurwitz(modes.flows[i])).outcome != "proved":
            return undecided(f"mode {modes.names[i]} may last, and is not stable: {flow.reason}")
    work, edges = dict[str, Value](), cell_edges(modes, cells)
    for group in _edge_groups(edges, is_joint=method == "bernstein"):
        condition = _condition(modes, cells, matrices, group, gamma)
        verdict = prove(condition, method=method, steps=steps)
        if verdict.outcome != "proved":
            source = group.sources[verdict.evidence.get("which", 0)]
            return Verdict("undecided", {**verdict.evidence, "edge": [source, group.target]})
        for key in ("boxes", "steps"):
            if key in verdict.evidence:
                work[key] = work.get(key, 0) + verdict.evidence[key]
        work["method"] = verdict.evidence.get("method", method)
    return proved(cell_count=len(cells), edge_count=len(edges), **work)


@dataclass(frozen=True)
class _EdgeGroup:
    """Edges from several cells to one, after the same stays in the same mode."""

    sources: Sequence[int]
    target: int
    mode: int
    stay: Stay


def _edge_groups(
    edges: Sequence[tuple[int, int, int, Stay]], *, is_joint: bool
) -> Iterator[_EdgeGroup]:
    """Yield edges of one target and stay, all where they are proved jointly, else one by one."""
    groups = defaultdict(list)
    for source, target, mode, stay in edges:
        groups[(target, mode, *stay)].append(source)
    for (target, mode, low, high), sources in groups.items():
        for part in [sources] if is_joint else [[source] for source in sources]:
            yield _EdgeGroup(part, target, mode, (low, high))


def _condition(
    modes: Modes, cells: Sequence[ModeCell], matrices: Matrix, group: _EdgeGroup, gamma: float
) -> Condition:
    """(G e^{F theta})' P G e^{F theta} < gamma^2 P for the P of all sources of a group."""
    j, flow = cells[group.target].mode, modes.flows[group.mode]
    left = modes.entry[j] if modes.has_entry_map(j) else None
    first, *others = (matrices[source] for source in group.sources)
    last = matrices[group.target]
    unit = exact(np.eye(len(flow)))
    return Condition(flow, unit, first, last, *group.stay, left, gamma, tuple(others))


def read_cells(modes: Modes, certificate: Entries) -> tuple[list[ModeCell], Matrix]:
    """The cells of a certificate, and their P; ValueError unless they leave nothing out."""
    listed = certificate.get("cells")
    if not isinstance(listed, list | tuple) or not 0 < len(listed) <= _MOST_CELLS:
        raise ValueError(f"the certificate must hold from 1 to {_MOST_CELLS} cells")
    try:
        cells = [_cell(entry, modes) for entry in listed]
        matrices = floats([entry["P"] for entry in listed])
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        raise ValueError("cells of the certificate are not as they should be") from None
    n = len(modes.flows[0])
    if matrices.shape != (len(cells), n, n) or not np.isfinite(matrices).all():
        raise ValueError("the P of all cells must be finite, and as large as the flows")
    if not np.array_equal(matrices, np.swapaxes(matrices, 1, 2)):
        raise ValueError("the P of a cell is not symmetric")
    for mode in range(len(modes)):
        _check_cover(modes, mode, [cell for cell in cells if cell.mode == mode])
    return cells, matrices


def _cell(entry: Entries, modes: Modes) -> ModeCell:
    mode = _index(entry["mode"], modes)
    if "before" not in entry:
        return ModeCell(mode)
    low, high = (end_of_cell(value) for value in entry["stay"])
    before = _index(entry["before"], modes)
    if not low <= high:
        raise ValueError
    return ModeCell(mode, before, low, high)


def _index(value: Value, modes: Modes) -> int:
    if type(value) is not int or not 0 <= value < len(modes):
        raise ValueError
    return value


def _check_cover(modes: Modes, mode: int, cells: Sequence[ModeCell]) -> None:
    """ValueError unless a mode has a cell however long the stay in whichever mode before it."""
    if not cells:
        raise ValueError(f"no cell is of mode {modes.names[mode]}")
    if any(cell.before is None for cell in cells):
        return
    for before in modes.before(mode):
        low, high = modes.stays[before]
        reached = low
        own = sorted((c.low, c.high) for c in cells if c.before == before)
        for a, b in own:
            if a > reached:
                break
            reached = max(reached, b)
        if not own or own[0][0] > low or reached < high:
            name, last = modes.names[mode], modes.names[before]
            raise ValueError(f"cells of mode {name} leave out stays in mode {last}")


def certificate_of(cells: Sequence[ModeCell], matrices: Matrix) -> NewEntries:
    """What a file holds of cells and their P."""
    P = (matrices + np.swapaxes(matrices, 1, 2)) / 2
    listed = []
    for cell, own in zip(cells, P, strict=True):
        history: NewEntries = {}
        if cell.before is not None:
            history = {"before": cell.before, "stay": [cell.low, _word(cell.high)]}
        listed.append({"mode": cell.mode, **history, "P": own.tolist()})
    return {"cells": listed}


def _word(end: float) -> float | str:
    return "inf" if math.isinf(end) else end
