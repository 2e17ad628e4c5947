"""Proof that matrices P, one for every window of dwell times, decrease along all sequences.

    M(theta)' P_w' M(theta) < gamma^2 P_w     for every window w, every w' that can follow it, and
                                              every theta that both of them allow

A window gives some offsets (-1: the dwell time just passed, 0: the next one, ...) an interval; the
windows of a certificate divide all sequences of dwell times, so that V_k = x_k' P_w x_k, w the
window that the sequence is in at the k-th jump, falls at every jump. The search that found the
windows is not consulted: `lmi.prove.window_partition` works out again that they divide all
sequences, which can follow each other, and the ranges of theta.

With a singular H = U V' (exactly, full rank), V' e^{F theta} U has the same products as
e^{F theta} H, and smaller P prove the same: x-> V'x is what counts of the state before a jump.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix, NewEntries
from lmi.arithmetic.balls import (
    PRECISIONS,
    Exact,
    ball,
    certify_positive_definite,
    exact,
    precision,
    rank_factors,
)
from lmi.prove.common_matrix import BOX_LIMIT, prove
from lmi.prove.condition import Condition
from lmi.prove.window_partition import Certificate, Edge, Unreadable, read_certificate
from lmi.verdict import Verdict, proved, undecided


def prove_windows(
    F: ArrayLike,
    H: ArrayLike,
    certificate: Entries,
    low: float,
    high: float,
    *,
    jitter: float = math.inf,
    gamma: float = 1.0,
    method: str = "bernstein",
    steps: int = BOX_LIMIT,
) -> Verdict:
    """Prove decrease along all sequences of theta in [low, high] with steps up to `jitter`.

    high may be infinite. F, H: (n, n) floats or exact rationals, M(theta) = e^{F theta} H.
    certificate: {"windows": [{"dwell": {"-1": [0.4, 1.2], ...}, "P": m x m}, ...], "edges": [[w,
    w', low, high], ...]}, what `lmi.find.window_search` writes. Proved or undecided; then
    evidence["edge"] and ["theta"] tell where an inequality could not be shown.
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    flow, jump = exact(F), exact(H)
    try:
        partition = read_certificate(certificate, len(flow), (low, high), jitter)
        left, right = _factors(jump, partition)
    except Unreadable as error:
        return undecided(str(error))
    for w, P in enumerate(partition.P):
        if not _positive(P):
            return undecided(f"P of window {w + 1} is not certainly positive definite")
    counts = {"window_count": len(partition.boxes), "edge_count": len(partition.edges)}
    family = Condition(flow, right, partition.P[0], partition.P[0], low, high, left, gamma)
    verdict = _prove_edges(family, partition, method, steps)
    return verdict if verdict.outcome != "proved" else proved(**counts, **verdict.evidence)


def _prove_edges(family: Condition, partition: Certificate, method: str, steps: int) -> Verdict:
    """The inequalities of all edges; the family gives all but their windows and ranges."""
    work: NewEntries = {}
    for (target, *ends), sources in _groups(partition.edges, merge_sources=method == "bernstein"):
        first, *others = (partition.P[s] for s in sources)
        condition = replace(family, P_source=first, P_target=partition.P[target], low=ends[0],
                            high=ends[1], others=tuple(others))  # fmt: skip
        verdict = prove(condition, method=method, steps=steps)
        if verdict.outcome != "proved":
            source = sources[verdict.evidence.get("which", 0)]
            edge = [source, target, ends[0], _word(ends[1])]
            return Verdict("undecided", {**verdict.evidence, "edge": edge})
        _account(work, verdict.evidence)
    return proved(**work)


def _account(work: NewEntries, evidence: Entries) -> None:
    """Sums of boxes and steps, the smallest box, the last tail: over all edges."""
    for key, value in evidence.items():
        if key in ("boxes", "steps"):
            work[key] = work.get(key, 0) + value
        elif key in ("smallest_box", "least_margin"):
            work[key] = min(work.get(key, math.inf), value)
        elif key in ("tail_from", "bits"):
            work[key] = max(work.get(key, 0), value)
        else:
            work[key] = value


def _groups(
    edges: Sequence[Edge], merge_sources: bool
) -> list[tuple[tuple[int, float, float], list[int]]]:
    """Edges with the same target and range, by their sources: one polynomial serves them all."""
    groups = defaultdict(list)
    for source, target, low, high in edges:
        groups[target, low, high].append(source)
    if merge_sources:
        return list(groups.items())
    return [(group, [source]) for group, sources in groups.items() for source in sources]


def _word(end: float) -> float | str:
    return "inf" if math.isinf(end) else end


def _factors(jump: Exact, partition: Certificate) -> tuple[Exact | None, Exact]:
    """(left, right) of the family left e^{F theta} right: (None, H), or (V', U) of H = U V'."""
    if not partition.reduced:
        return None, jump
    U, V = rank_factors(jump)
    if U.shape[1] != partition.P.shape[1]:
        raise Unreadable(f"H has rank {U.shape[1]}; the P have size {partition.P.shape[1]}")
    return V.T, U


def _positive(P: Matrix) -> bool:
    for bits in PRECISIONS:
        with precision(bits):
            if certify_positive_definite(ball(exact(P))):
                return True
    return False
