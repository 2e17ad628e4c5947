"""Find matrices for modes that take turns: one each, or for each cell of the stay before.

Where no P fit, or those that fit are not proved, the cell whose theta matter most is cut there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array
from lmi.arithmetic.balls import to_float
from lmi.families import Edge
from lmi.find.cutting_plane import Proposal, propose_edges
from lmi.find.edge_grid import Cut, Grids
from lmi.modes import Modes
from lmi.prove.modes_proof import ModeCell, cell_edges, certificate_of, prove_modes
from lmi.time_budget import UNLIMITED, TimeBudget, ended_by_count
from lmi.verdict import Verdict, undecided

# grid points of an edge: with fewer the P are too close to the limit for a proof
_POINTS = 400
_CELLS = 8
_TURNS = 4
_BOXES = 3000  # a proof that needs more is not worth the wait, nor are cells that need more of them
# cells are no thinner than this part of all stays in a mode
_THIN = 0.02


@dataclass(frozen=True)
class ModeSearch:
    """The verdict; (mode, theta) that mattered last; cells and the last coordinates of their P."""

    verdict: Verdict
    stays: tuple[tuple[int, float], ...]
    cells: tuple[ModeCell, ...]
    coordinates: Array | None = None

    @property
    def is_exhausted(self) -> bool:
        """Did a proof end by its number of boxes?"""
        return bool(self.verdict.evidence.get("boxes", 0) >= _BOXES)


def find_modes(
    modes: Modes, *, most_cells: int = _CELLS, start: ModeSearch | None = None,
    budget: TimeBudget = UNLIMITED,
) -> ModeSearch:  # fmt: skip
    """Search P for all cells, and prove them; evidence is the certificate, else the reason.

    most_cells: no further cuts beyond so many; one P for each mode needs as many as there are
    modes. start: a search of neighbouring stays, whose coordinates are the first.
    """
    flows = [to_float(F) for F in modes.flows]
    lefts = [to_float(G) if modes.has_entry_map(j) else None for j, G in enumerate(modes.entry)]
    cells, L = tuple(ModeCell(mode) for mode in range(len(modes))), None
    if start is not None and start.cells == cells:
        L = start.coordinates
    unit, grids, most = np.eye(len(flows[0])), Grids(), budget.scaled(most_cells)
    while True:
        edges = [
            Edge(flows[i], unit, *stay, lefts[cells[t].mode], s, t)
            for s, t, i, stay in cell_edges(modes, cells)
        ]
        if not edges:
            return ModeSearch(_without_edges(modes, cells), (), cells)
        proposal, attempt = _solved(modes, cells, edges, L, grids=grids, budget=budget)
        active = zip(proposal.owners, proposal.thetas, strict=True)
        stays = tuple((cells[edges[e].source].mode, theta) for e, theta in active)
        result = ModeSearch(attempt, stays, cells, proposal.coordinates)
        if attempt.outcome == "proved" or len(cells) >= most or budget.remaining() < 0:
            limit = budget.ended() or ended_by_count("cells", most)
            return result if attempt.outcome == "proved" else _ended(result, limit)
        finer = None if result.is_exhausted else _cut(modes, cells, edges, proposal)
        if finer is None:
            return result
        cells, parents = finer
        L = None if proposal.coordinates is None else proposal.coordinates[parents]


def _ended(result: ModeSearch, limit: dict[str, object]) -> ModeSearch:
    evidence = {**result.verdict.evidence, **limit}
    return replace(result, verdict=replace(result.verdict, evidence=evidence))


def _without_edges(modes: Modes, cells: Sequence[ModeCell]) -> Verdict:
    """No mode follows another: each alone."""
    unit = np.tile(np.eye(len(modes.flows[0])), (len(cells), 1, 1))
    body = certificate_of(cells, unit)
    verdict = prove_modes(modes, body)
    return replace(verdict, evidence={**body, **verdict.evidence})


def _solved(
    modes: Modes, cells: Sequence[ModeCell], edges: Sequence[Edge], L: Array | None, *,
    grids: Grids, budget: TimeBudget,
) -> tuple[Proposal, Verdict]:  # fmt: skip
    """P for these cells and their proof, with as many turns as bring new theta."""
    seeds: list[Cut] = []
    attempt = undecided(f"no P fit {len(cells)} cells of the modes")
    for _ in range(_TURNS):
        proposal = propose_edges(
            edges, len(cells), seeds, start=L, points=_POINTS, grids=grids, budget=budget
        )
        if proposal.matrices is None:
            break
        body = certificate_of(cells, proposal.matrices)
        verdict = prove_modes(modes, body, steps=_BOXES)
        if verdict.outcome == "proved":
            evidence = {**body, **verdict.evidence, "approx_margin": proposal.margin}
            return proposal, Verdict("proved", evidence, proposal.solvers)
        attempt, theta = verdict, verdict.evidence.get("theta")
        pair = verdict.evidence.get("edge", [-1, -1])
        if theta is None or verdict.evidence.get("boxes", 0) >= _BOXES:
            break
        failing = [k for k, e in enumerate(edges) if [e.source, e.target] == pair]
        new = [(k, float(theta)) for k in failing]
        if not new or new[0] in seeds:
            break
        seeds = [*zip(proposal.owners, proposal.thetas, strict=True), *new]
        L = proposal.coordinates
    return proposal, attempt


def _cut(
    modes: Modes,
    cells: Sequence[ModeCell],
    edges: Sequence[Edge],
    proposal: Proposal,
) -> tuple[tuple[ModeCell, ...], list[int]] | None:
    """Cells after cutting one, and the old cell of each; None where none is to be cut.

    The one whose theta have the widest spread, by the solver's multipliers, at their mean.
    """
    # no multipliers where P were proposed, and their proof fails
    masses = np.ones(len(proposal.thetas)) if proposal.masses is None else proposal.masses
    weights = defaultdict(list)
    for e, theta, mass in zip(proposal.owners, proposal.thetas, masses, strict=True):
        weights[cells[edges[e].source].mode, edges[e].target].append((theta, mass))
    ranked = []
    for (i, t), listed in weights.items():
        thetas, shares = np.array(listed, dtype=np.float64).T
        shares = np.maximum(shares, 1e-12)
        where = float(np.average(thetas, weights=shares))
        spread = float(np.average(np.abs(thetas - where), weights=shares))
        ranked.append((spread * float(shares.sum()), i, t, where))
    tries = (_halved(modes, cells, i, t, at) for _, i, t, at in sorted(ranked, reverse=True))
    return next((finer for finer in tries if finer is not None), None)


def _halved(
    modes: Modes, cells: Sequence[ModeCell], i: int, t: int, where: float
) -> tuple[tuple[ModeCell, ...], list[int]] | None:
    """Cell t, where it is entered from mode i, in two; None where one would be too thin."""
    low, high = modes.stays[i] if cells[t].before is None else (cells[t].low, cells[t].high)
    last = min(high, modes.horizons[i])
    room = _THIN * (modes.horizons[i] - modes.stays[i][0])
    if not low + 2 * room < last:
        return None
    where = min(max(where, low + room), last - room)
    new: list[tuple[ModeCell, int]] = []
    for k, cell in enumerate(cells):
        pieces = [cell]
        if k == t and cell.before is None:
            pieces = [ModeCell(cell.mode, b, *modes.stays[b]) for b in modes.before(cell.mode)]
        for piece in pieces:
            halves = [piece]
            if k == t and piece.before == i:
                halves = [replace(piece, high=where), replace(piece, low=where)]
            new += [(half, k) for half in halves]
    return tuple(cell for cell, _ in new), [k for _, k in new]
