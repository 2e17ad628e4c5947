"""Find matrices for windows of dwell times: solve over all edges, cut windows, solve again.

Starts from the one window that is a common P. When no P fits, the multipliers tell which windows to
cut (`lmi.find.splitting`); when P fit, `lmi.prove.windows_proof` tries to prove them, and a theta
where it fails goes back into the search.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.balls import Exact, rank_factors, to_float
from lmi.families import Edge, horizon
from lmi.find.cutting_plane import Proposal, propose_edges
from lmi.find.edge_grid import Cut, Grids
from lmi.find.splitting import Limits, cuttings
from lmi.find.windows import Links, Windows, whole
from lmi.prove.windows_proof import prove_windows
from lmi.time_budget import deadline, ended, ended_by_count, scaled
from lmi.verdict import Verdict, undecided

Matrix = NDArray[Any]

# a proof that fails this often at new theta is not worth another round
_TURNS = 6
_BOXES = 6000
# multipliers below this share of the largest are not carried over to the next windows
_FAINT = 1e-6


@dataclass(frozen=True)
class Budget:
    """When a search gives up: this many windows, this many seconds of processor time.

    Both are its own budget, which `lmi.time_budget.stretched` multiplies.
    """

    windows: int = 100
    seconds: float = 10.0


@dataclass(frozen=True)
class Found:
    """The verdict, and the dwell times that mattered last: where to look for a witness.

    windows: those that were proved, and L (windows, m, m), the Cholesky factors of their P.
    """

    verdict: Verdict
    thetas: tuple[float, ...]
    windows: Windows | None = None
    L: Matrix | None = None


def find_windows(
    F: Exact,
    H: Exact,
    low: float,
    high: float,
    *,
    jitter: float = math.inf,
    limits: Limits | None = None,
    budget: Budget | None = None,
    start: tuple[Windows, Matrix] | None = None,
) -> Found:
    """Proved with the windows, their P and the edges in its evidence, or undecided with the reason.

    F, H: (n, n) exact. start: windows to begin with, and coordinates for them. When windows that
    look both ways come to nothing, windows that look back only are tried in the time that is left.
    """
    budget, limits = budget or Budget(), limits or Limits()
    family = _Family.of(F, H, low, high, jitter)
    stop = deadline(budget.seconds)
    found = family.search(start, limits, budget, stop)
    if found.verdict.outcome != "proved" and limits.future > 0 and start is None:
        back = family.search(None, Limits(limits.past, 0), budget, stop)
        found = back if back.verdict.outcome == "proved" else found
    return found


@dataclass(frozen=True)
class _Family:
    exact: tuple[Exact, Exact]
    F: Matrix
    left: Matrix | None
    right: Matrix
    low: float
    high: float
    jitter: float
    grids: Grids

    @staticmethod
    def of(F: Exact, H: Exact, low: float, high: float, jitter: float) -> _Family:
        """In the coordinates of the image of H: smaller matrices, and never worse ones."""
        U, V = rank_factors(H)
        if not 0 < U.shape[1] < len(H):
            return _Family((F, H), to_float(F), None, to_float(H), low, high, jitter, {})
        left = np.ascontiguousarray(to_float(V).T)
        return _Family((F, H), to_float(F), left, to_float(U), low, high, jitter, {})

    @property
    def last(self) -> float:
        """The end of the range, or where an infinite one has nothing left to show."""
        return self.high if math.isfinite(self.high) else self.low + horizon(self.F)

    def edges(self, links: Links) -> list[Edge]:
        """One family on each edge."""
        ends = zip(links.source, links.target, links.low, links.high, strict=True)
        return [
            Edge(self.F, self.right, float(a), float(b), self.left, int(s), int(t))
            for s, t, a, b in ends
        ]

    def search(
        self, start: tuple[Windows, Matrix] | None, limits: Limits, budget: Budget, stop: float
    ) -> Found:
        """Rounds of solving and cutting."""
        windows, L = (whole(self.low, self.high), None) if start is None else start
        links, seeds, most = windows.links(self.jitter), list[Cut](), scaled(budget.windows)
        while True:
            left = stop - time.process_time()
            proposal = propose_edges(
                self.edges(links), len(windows), seeds, L, grids=self.grids, seconds=left
            )
            if proposal.matrices is not None:
                return self._proved(windows, links, proposal)
            why = f"no P fit {len(windows)} windows of dwell times"
            out_of_time = ended(stop, budget.seconds)
            if proposal.masses is None or proposal.coordinates is None:
                text = why if out_of_time else f"{why}: the solver gave no numbers"
                return Found(undecided(text, **out_of_time), proposal.thetas)
            cuts = cuttings(windows, links, np.array(proposal.owners), np.array(proposal.thetas),
                            proposal.masses, self.last, limits)  # fmt: skip
            heavy = proposal.masses > _FAINT * proposal.masses.max()
            thetas = tuple(t for t, heavy_ in zip(proposal.thetas, heavy, strict=True) if heavy_)
            if not cuts:
                return Found(undecided(f"{why}, and none of them can be cut further"), thetas)
            if len(windows) >= most or out_of_time:
                end = out_of_time or ended_by_count("windows", most)
                return Found(undecided(why, **end), thetas)
            finer, parents = windows.cut(cuts[: most - len(windows)])
            following = finer.links(self.jitter)
            seeds = _carried(links, proposal, heavy, following, parents)
            windows, links, L = finer, following, proposal.coordinates[parents]

    def _proved(self, windows: Windows, links: Links, proposal: Proposal) -> Found:
        """The proof, with as many turns as bring new theta."""
        edges, attempt = self.edges(links), undecided("no proof was tried")
        seeds = list(zip(proposal.owners, proposal.thetas, strict=True))
        for _ in range(_TURNS):
            if proposal.matrices is None:
                break
            body = certificate(windows, links, proposal.matrices)
            attempt = prove_windows(*self.exact, body, self.low, self.high, jitter=self.jitter,
                                    steps=_BOXES)  # fmt: skip
            if attempt.outcome == "proved":
                found = {**body, **attempt.evidence}
                if math.isfinite(proposal.margin):
                    found["approx_margin"] = proposal.margin
                L = np.linalg.cholesky(proposal.matrices)
                return Found(Verdict("proved", found), proposal.thetas, windows, L)
            cut = _failed(links, attempt)
            if cut is None or cut in seeds:
                break
            seeds = [*seeds, cut]
            proposal = propose_edges(
                edges, len(windows), seeds, proposal.coordinates, grids=self.grids
            )
        return Found(attempt, proposal.thetas)


def certificate(windows: Windows, links: Links, matrices: Matrix) -> dict[str, Any]:
    """What a file holds: windows with their intervals and P, edges with their ranges."""
    P = (matrices + np.swapaxes(matrices, 1, 2)) / 2
    ends = zip(links.source, links.target, links.low, links.high, strict=True)
    return {
        "windows": [
            {"dwell": windows.document(w), "P": P[w].tolist()} for w in range(len(windows))
        ],
        "edges": [
            [int(s), int(t), float(a), "inf" if math.isinf(b) else float(b)] for s, t, a, b in ends
        ],
    }


def _failed(links: Links, attempt: Verdict) -> Cut | None:
    """The edge and theta at which a proof failed, as a cut for the search."""
    theta, edge = attempt.evidence.get("theta"), attempt.evidence.get("edge")
    if theta is None or edge is None:
        return None
    number = np.flatnonzero((links.source == edge[0]) & (links.target == edge[1]))
    return int(number[0]), float(theta)


def _carried(
    links: Links, proposal: Proposal, heavy: Matrix, finer: Links, parents: Matrix
) -> list[Cut]:
    """Active theta with weight, on every edge that comes from theirs and still holds them."""
    kept = defaultdict(list)
    for k in np.flatnonzero(heavy):
        edge = proposal.owners[k]
        kept[int(links.source[edge]), int(links.target[edge])].append(proposal.thetas[k])
    old = zip(parents[finer.source], parents[finer.target], strict=True)
    return [
        (k, theta)
        for k, pair in enumerate(old)
        for theta in kept.get((int(pair[0]), int(pair[1])), ())
        if finer.low[k] <= theta <= finer.high[k]
    ]
