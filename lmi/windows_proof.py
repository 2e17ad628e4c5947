"""Proof that matrices P, one for every window of dwell times, decrease along all sequences.

    M(theta)' P_w' M(theta) < gamma^2 P_w     for every window w, every w' that can follow it, and
                                              every theta that both of them allow

A window gives some offsets (-1: the dwell time just passed, 0: the next one, ...) an interval; the
windows of a certificate divide all sequences of dwell times, so that V_k = x_k' P_w x_k, w the
window that the sequence is in at the k-th jump, falls at every jump. The search that found the
windows is not consulted: that they divide all sequences, which can follow each other, and the
ranges of theta are worked out here again, with ends compared exactly as the numbers they are.

With a singular H = U V' (exactly, full rank), V' e^{F theta} U has the same products as
e^{F theta} H, and smaller P prove the same: x-> V'x is what counts of the state before a jump.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.balls import (
    PRECISIONS,
    Exact,
    ball,
    certify_positive_definite,
    exact,
    precision,
    rank_factors,
    rational,
    to_float,
)
from lmi.condition import Condition
from lmi.exponential import expm
from lmi.proof import STEP_LIMIT, prove
from lmi.verdict import Verdict, proved, undecided

Matrix = NDArray[np.float64]
Interval = tuple[float, float]
Box = Mapping[int, Interval]  # offset -> interval; the whole range where an offset is missing
Edge = tuple[int, int, float, float]  # window, the next window, range of theta

_LOOKED = 33  # points at which floats look for room
# more windows, or offsets further away, than any search asks for
_MOST, _FARTHEST = 400, 100


@dataclass(frozen=True)
class Certificate:
    """Windows and their P (windows, m, m), m = n or, where `reduced`, the rank of H."""

    boxes: tuple[Box, ...]
    P: Matrix
    edges: frozenset[Edge]
    reduced: bool


class _Unreadable(Exception):
    """What the certificate has to hold and does not."""


def prove_windows(
    F: ArrayLike,
    H: ArrayLike,
    certificate: Mapping[str, Any],
    low: float,
    high: float,
    *,
    jitter: float = math.inf,
    gamma: float = 1.0,
    method: str = "bernstein",
    steps: int = STEP_LIMIT,
) -> Verdict:
    """All sequences of theta in [low, high], high possibly infinite, with steps at most `jitter`.

    F, H: (n, n) floats or exact rationals, M(theta) = e^{F theta} H. certificate: {"windows":
    [{"dwell": {"-1": [0.4, 1.2], ...}, "P": m x m}, ...], "edges": [[w, w', low, high], ...]}, what
    `lmi.window_search` writes. Proved or undecided; then evidence["edge"] and ["theta"] tell where
    an inequality could not be shown.
    """
    if not 0 <= low <= high:
        raise ValueError(f"0 <= low <= high is required; got [{low}, {high}]")
    flow, jump = exact(F), exact(H)
    try:
        found = _read(certificate, len(flow), (low, high))
        _check_partition(found.boxes, (low, high))
        edges = _edges(found.boxes, (low, high), jitter)
        _check_edges(edges, found.edges)
        left, right = _factors(jump, found)
    except _Unreadable as error:
        return undecided(str(error))
    for w, P in enumerate(found.P):
        if not _positive(P):
            return undecided(f"P of window {w + 1} is not certainly positive definite")
    told = {"window_count": len(found.boxes), "edge_count": len(edges)}
    work: dict[str, Any] = {}
    for (target, *ends), sources in _groups(edges, together=method == "bernstein"):
        first, *others = (found.P[s] for s in sources)
        condition = Condition(flow, right, first, found.P[target], ends[0], ends[1], left, gamma,
                              tuple(others))  # fmt: skip
        if method == "march":
            condition = _unreduced(condition)
        verdict = prove(condition, method=method, steps=steps)
        if verdict.outcome != "proved":
            source = sources[verdict.evidence.get("which", 0)]
            edge = [source, target, ends[0], _word(ends[1])]
            return Verdict("undecided", {**verdict.evidence, "edge": edge})
        _account(work, verdict.evidence)
    return proved(**told, **work)


def _account(work: dict[str, Any], evidence: Mapping[str, Any]) -> None:
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
    edges: Sequence[Edge], together: bool
) -> list[tuple[tuple[int, float, float], list[int]]]:
    """Edges with the same target and range, by their sources: one polynomial serves them all."""
    groups = defaultdict(list)
    for source, target, low, high in edges:
        groups[target, low, high].append(source)
    if together:
        return list(groups.items())
    return [(group, [source]) for group, sources in groups.items() for source in sources]


def _unreduced(condition: Condition) -> Condition:
    """The same claim for V P V' + e I in place of a reduced target P, which implies it.

    e takes half of the room that floats see.
    """
    if condition.left is None:
        return condition
    V, n = condition.left.T, len(condition.F)
    end = condition.high if math.isfinite(condition.high) else condition.low
    moved = expm(to_float(condition.F) * np.linspace(condition.low, end, _LOOKED)[:, None, None])
    moved = moved @ to_float(condition.right)
    seen = to_float(condition.left) @ moved
    room = condition.gamma**2 * condition.P_source - seen.swapaxes(1, 2) @ condition.P_target @ seen
    gram = moved.swapaxes(1, 2) @ moved
    shares = np.linalg.eigvals(np.linalg.solve(gram + 1e-300 * np.eye(len(room[0])), room)).real
    e = max(0.5 * float(shares.min()), 1e-12 * float(np.abs(condition.P_target).max()))
    whole = V @ exact(condition.P_target) @ V.T + exact(e * np.eye(n))
    return replace(condition, left=None, P_target=whole)


def _read(certificate: Mapping[str, Any], n: int, ends: Interval) -> Certificate:
    windows = certificate.get("windows")
    if not isinstance(windows, list | tuple) or not windows:
        raise _Unreadable("the certificate holds no windows")
    if len(windows) > _MOST:
        raise _Unreadable(f"more than {_MOST} windows are not looked at")
    try:
        boxes = tuple(_box(window["dwell"], ends) for window in windows)
        P = np.array([window["P"] for window in windows], dtype=np.float64)
        edges = [(_index(s), _index(t), _end(a), _end(b)) for s, t, a, b in certificate["edges"]]
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError):
        raise _Unreadable("windows or edges of the certificate are not as they should be") from None
    if P.ndim != 3 or P.shape[1] != P.shape[2] or not 0 < P.shape[1] <= n:
        raise _Unreadable("the P of all windows must be square and of one size")
    if not np.isfinite(P).all() or not np.array_equal(P, np.swapaxes(P, 1, 2)):
        raise _Unreadable("the P of a window is not finite and symmetric")
    if len(set(edges)) < len(edges):
        raise _Unreadable("an edge is listed twice")
    return Certificate(boxes, P, frozenset(edges), P.shape[1] < n)


def _box(dwell: Mapping[str, Any], ends: Interval) -> Box:
    box = {}
    for name, (a, b) in dwell.items():
        low, high = _end(a), _end(b)
        known = str(int(name)) == name and abs(int(name)) <= _FARTHEST
        if not known or not ends[0] <= low < high <= ends[1]:
            raise ValueError
        box[int(name)] = low, high
    return box


def _end(value: Any) -> float:
    if value == "inf":
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


def _index(value: Any) -> int:
    if type(value) is not int:
        raise ValueError
    return value


def _word(end: float) -> float | str:
    return "inf" if math.isinf(end) else end


def _check_partition(boxes: Sequence[Box], ends: Interval) -> None:
    """The windows divide all sequences: cuts across all windows of a part, until one fills each."""
    parts: list[tuple[list[Box], Box]] = [(list(boxes), {})]
    while parts:
        part, region = parts.pop()
        if len(part) > 1:
            halves = _halves(part, region, ends)
            if halves is None:
                raise _Unreadable("the windows do not divide all sequences of dwell times")
            parts += halves
        elif any(part[0].get(j, ends) != region.get(j, ends) for j in set(part[0]) | set(region)):
            raise _Unreadable("the windows do not divide all sequences of dwell times")


def _halves(boxes: list[Box], region: Box, ends: Interval) -> list[tuple[list[Box], Box]] | None:
    """A cut of the region that no window straddles, with the windows on either side of it."""
    for offset in sorted({offset for box in boxes for offset in box}):
        low, high = region.get(offset, ends)
        borders = {box.get(offset, ends)[1] for box in boxes}
        for border in sorted(b for b in borders if low < b < high):
            below = [box for box in boxes if box.get(offset, ends)[1] <= border]
            above = [box for box in boxes if box.get(offset, ends)[0] >= border]
            if below and above and len(below) + len(above) == len(boxes):
                return [
                    (below, {**region, offset: (low, border)}),
                    (above, {**region, offset: (border, high)}),
                ]
    return None


def _edges(boxes: Sequence[Box], ends: Interval, jitter: float) -> list[Edge]:
    """Every window with every one that can follow it, and the theta that both allow."""
    found = []
    shifted = [{offset + 1: interval for offset, interval in box.items()} for box in boxes]
    for s, here in enumerate(boxes):
        for t, there in enumerate(shifted):
            both = _common(here, there, ends)
            if both is not None and _reachable(both, ends, jitter):
                found.append((s, t, *both.get(0, ends)))
    return found


def _common(one: Box, other: Box, ends: Interval) -> Box | None:
    """What two boxes share, by offsets; None when the inside of some offset is empty.

    Cells are half-open, [., .), the last one closed, so that inside means: more than a point.
    """
    shared = dict(one)
    for offset, (low, high) in other.items():
        a, b = shared.get(offset, ends)
        low, high = max(low, a), min(high, b)
        if not low < high:
            return None
        shared[offset] = low, high
    return shared


def _reachable(box: Box, ends: Interval, jitter: float) -> bool:
    """Does the box hold a sequence whose steps are at most `jitter`? In exact numbers."""
    if math.isinf(jitter) or ends[0] == ends[1]:
        return True
    step, last = rational(jitter), max(box, default=0)
    low, high = _numbers(box.get(min(box, default=0), ends))
    for offset in range(min(box, default=0) + 1, last + 1):
        a, b = _numbers(box.get(offset, ends))
        low = max(low - step, a)
        high = b if high is None else high + step if b is None else min(high + step, b)
        if high is not None and not low < high:
            return False
    return True


def _numbers(interval: Interval) -> tuple[Any, Any]:
    """Exact ends; None for infinity."""
    low, high = interval
    return rational(low), None if math.isinf(high) else rational(high)


def _check_edges(edges: Sequence[Edge], listed: frozenset[Edge]) -> None:
    """The certificate tells its reader the same edges."""
    if missing := set(edges) - listed:
        s, t, *_ = min(missing)
        raise _Unreadable(f"window {t + 1} can follow window {s + 1}, which the edges do not list")
    if more := listed - set(edges):
        s, t, *_ = min(more)
        raise _Unreadable(f"the edges list windows {s + 1} and {t + 1} as they do not follow")


def _factors(jump: Exact, found: Certificate) -> tuple[Exact | None, Exact]:
    """(left, right) of the family left e^{F theta} right: (None, H), or (V', U) of H = U V'."""
    if not found.reduced:
        return None, jump
    U, V = rank_factors(jump)
    if U.shape[1] != found.P.shape[1]:
        raise _Unreadable(f"H has rank {U.shape[1]}; the P have size {found.P.shape[1]}")
    return V.T, U


def _positive(P: Matrix) -> bool:
    for bits in PRECISIONS:
        with precision(bits):
            if certify_positive_definite(ball(exact(P))):
                return True
    return False
