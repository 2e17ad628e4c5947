"""Find matrices for windows of dwell times: solve over all edges, cut windows, solve again.

Starts from the one window that is a common P. When no P fits, the multipliers tell which windows to
cut (`lmi.find.splitting`); when P fit, `lmi.prove.windows_proof` tries to prove them, and a theta
where it fails goes back into the search.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from lmi.arithmetic.balls import Exact, rank_factors, to_float
from lmi.families import Edge
from lmi.find.cutting_plane import Proposal, propose_edges
from lmi.find.edge_grid import Cut, Grids
from lmi.find.splitting import LEAST_MASS_SHARE, Limits, cuttings
from lmi.find.windows import Links, Windows, whole
from lmi.prove.windows_proof import prove_windows
from lmi.time_budget import UNLIMITED, TimeBudget, ended_by_count
from lmi.verdict import Verdict, undecided

# a proof that fails this often at new theta is not worth another round
_TURNS = 6
_BOXES = 6000


@dataclass(frozen=True)
class Effort:
    """Largest effort of a search, which a stretched budget multiplies.

    windows: their number. work: multiplications of the solver, about; n^3 for each inequality of
    each round. A million takes some ten seconds.
    """

    windows: int = 100
    work: int = 1_000_000


@dataclass(frozen=True)
class WindowResult:
    """The verdict, and the dwell times that mattered last: where to look for a witness.

    windows: those that were proved, and L (windows, m, m), the Cholesky factors of their P.
    """

    verdict: Verdict
    thetas: tuple[float, ...]
    windows: Windows | None = None
    L: Array | None = None


def find_windows(
    F: Exact,
    H: Exact,
    low: float,
    high: float,
    *,
    jitter: float = math.inf,
    limits: Limits | None = None,
    effort: Effort | None = None,
    start: tuple[Windows, Array] | None = None,
    budget: TimeBudget = UNLIMITED,
) -> WindowResult:
    """Search windows of dwell times with a P for each, and prove them.

    Evidence holds the windows, their P and the edges; else the reason. F, H: (n, n) exact. start:
    windows to begin with, and coordinates for them. When windows that look both ways come to
    nothing, windows that look back only are tried.
    """
    effort, limits = effort or Effort(), limits or Limits()
    family = _Family.from_pair(F, H, low, high, jitter)
    result = family.search(start, limits, effort, budget)
    if result.verdict.outcome != "proved" and limits.future > 0 and start is None:
        back = family.search(None, Limits(limits.past, 0), effort, budget)
        result = back if back.verdict.outcome == "proved" else result
    return result


@dataclass(frozen=True)
class _Family:
    exact: tuple[Exact, Exact]
    F: Array
    left: Array | None
    right: Array
    low: float
    high: float
    jitter: float
    grids: Grids

    @staticmethod
    def from_pair(F: Exact, H: Exact, low: float, high: float, jitter: float) -> _Family:
        """In the coordinates of the image of H: smaller matrices, and never worse ones."""
        U, V = rank_factors(H)
        if not 0 < U.shape[1] < len(H):
            return _Family((F, H), to_float(F), None, to_float(H), low, high, jitter, {})
        left = np.ascontiguousarray(to_float(V).T)
        return _Family((F, H), to_float(F), left, to_float(U), low, high, jitter, {})

    @property
    def last(self) -> float:
        """The end of the range, or where an infinite one has nothing left to show."""
        return Edge(self.F, self.right, self.low, self.high).last

    def edges(self, links: Links) -> list[Edge]:
        """One family on each edge."""
        ends = zip(links.source, links.target, links.low, links.high, strict=True)
        return [
            Edge(self.F, self.right, float(a), float(b), self.left, int(s), int(t))
            for s, t, a, b in ends
        ]

    def search(
        self,
        start: tuple[Windows, Array] | None,
        limits: Limits,
        effort: Effort,
        budget: TimeBudget,
    ) -> WindowResult:
        """Rounds of solving and cutting."""
        windows, L = (whole(self.low, self.high), None) if start is None else start
        links, seeds, most = windows.links(self.jitter), list[Cut](), budget.scaled(effort.windows)
        work, most_work = 0, budget.scaled(effort.work)
        while True:
            proposal = propose_edges(
                self.edges(links), len(windows), seeds, start=L, grids=self.grids, budget=budget
            )
            if proposal.matrices is not None:
                return self._proved(windows, links, proposal, budget)
            why = f"no P fit {len(windows)} windows of dwell times"
            out_of_time = budget.ended()
            work += len(proposal.thetas) * self.right.shape[1] ** 3
            if proposal.masses is None or proposal.coordinates is None:
                text = why if out_of_time else f"{why}: the solver gave no numbers"
                return WindowResult(undecided(text, **out_of_time), proposal.thetas)
            cuts = cuttings(windows, links, np.array(proposal.owners), np.array(proposal.thetas),
                            proposal.masses, last=self.last, limits=limits)  # fmt: skip
            heavy = proposal.masses > LEAST_MASS_SHARE * proposal.masses.max()
            thetas = tuple(t for t, heavy_ in zip(proposal.thetas, heavy, strict=True) if heavy_)
            if not cuts:
                return WindowResult(
                    undecided(f"{why}, and none of them can be cut further"), thetas
                )
            if len(windows) >= most or out_of_time or work >= most_work:
                count = ended_by_count("windows", most if len(windows) >= most else len(windows))
                return WindowResult(undecided(why, **(out_of_time or count)), thetas)
            finer, parents = windows.cut(cuts[: most - len(windows)])
            following = finer.links(self.jitter)
            seeds = _carried(links, proposal, heavy, following, parents)
            windows, links, L = finer, following, proposal.coordinates[parents]

    def _proved(
        self, windows: Windows, links: Links, proposal: Proposal, budget: TimeBudget
    ) -> WindowResult:
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
                evidence = {**body, **attempt.evidence}
                if math.isfinite(proposal.margin):
                    evidence |= {"approx_margin": proposal.margin}
                L = np.linalg.cholesky(proposal.matrices)
                verdict = Verdict("proved", evidence, proposal.solvers)
                return WindowResult(verdict, proposal.thetas, windows, L)
            cut = _failed(links, attempt)
            if cut is None or cut in seeds:
                break
            seeds = [*seeds, cut]
            proposal = propose_edges(
                edges, len(windows), seeds, start=proposal.coordinates, grids=self.grids,
                budget=budget,
            )  # fmt: skip
        return WindowResult(attempt, proposal.thetas)


def certificate(windows: Windows, links: Links, matrices: Array) -> NewEntries:
    """Certificate for a file: windows with their intervals and P, edges with their ranges."""
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
    links: Links, proposal: Proposal, heavy: Array, finer: Links, parents: Array
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
