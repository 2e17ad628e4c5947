"""The windows of a certificate, read and checked: they divide all sequences of dwell times.

Nothing but the file is consulted: that every sequence is in just one window at every jump, which
windows can follow each other, and the theta that both of them allow are worked out here, with ends
compared exactly as the numbers they are. The file has to tell its reader the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Entries, Matrix, floats
from lmi.arithmetic.balls import Rational, rational

Interval = tuple[float, float]
Box = Mapping[int, Interval]  # offset -> interval; the whole range where an offset is missing
Edge = tuple[int, int, float, float]  # window, the next window, range of theta

# more windows, or offsets further away, than any search asks for
_MOST, _FARTHEST = 400, 100


@dataclass(frozen=True)
class Certificate:
    """Windows and their P (windows, m, m), m = n or, where `reduced`, the rank of H.

    edges: every window with every one that can follow it.
    """

    boxes: tuple[Box, ...]
    P: Matrix
    edges: tuple[Edge, ...]
    reduced: bool


class Unreadable(Exception):
    """Requirement that the certificate does not meet."""


def read_certificate(certificate: Entries, n: int, ends: Interval, jitter: float) -> Certificate:
    """Read and check the windows of a certificate for n states.

    Dwell times are between `ends`, their steps up to `jitter`. Raises Unreadable, with the reason,
    where they do not divide all sequences, or where the edges of the certificate are not those of
    its windows.
    """
    boxes, P, listed = _read(certificate, n, ends)
    _check_partition(boxes, ends)
    edges = _edges(boxes, ends, jitter)
    _check_edges(edges, listed)
    return Certificate(boxes, P, tuple(edges), P.shape[1] < n)


def _read(
    certificate: Entries, n: int, ends: Interval
) -> tuple[tuple[Box, ...], Matrix, frozenset[Edge]]:
    windows = certificate.get("windows")
    if not isinstance(windows, list | tuple) or not windows:
        raise Unreadable("the certificate holds no windows")
    if len(windows) > _MOST:
        raise Unreadable(f"more than {_MOST} windows are not looked at")
    try:
        boxes = tuple(_box(window["dwell"], ends) for window in windows)
        P = floats([window["P"] for window in windows])
        edges = [
            (_index(s), _index(t), end_of_cell(a), end_of_cell(b))
            for s, t, a, b in certificate["edges"]
        ]
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError):
        raise Unreadable("windows or edges of the certificate are not as they should be") from None
    if P.ndim != 3 or P.shape[1] != P.shape[2] or not 0 < P.shape[1] <= n:
        raise Unreadable("the P of all windows must be square and of one size")
    if not np.isfinite(P).all() or not np.array_equal(P, np.swapaxes(P, 1, 2)):
        raise Unreadable("the P of a window is not finite and symmetric")
    if len(set(edges)) < len(edges):
        raise Unreadable("an edge is listed twice")
    return boxes, P, frozenset(edges)


def _box(dwell: Entries, ends: Interval) -> Box:
    box = {}
    for name, (a, b) in dwell.items():
        low, high = end_of_cell(a), end_of_cell(b)
        known = str(int(name)) == name and abs(int(name)) <= _FARTHEST
        if not known or not ends[0] <= low < high <= ends[1]:
            raise ValueError
        box[int(name)] = low, high
    return box


def end_of_cell(value: object) -> float:
    """An end of a stored cell: a finite number or "inf"; ValueError for what is none."""
    if value == "inf":
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


def _index(value: object) -> int:
    if type(value) is not int:
        raise ValueError
    return value


def _check_partition(boxes: Sequence[Box], ends: Interval) -> None:
    """The windows divide all sequences: cuts across all windows of a part, until one fills each."""
    parts: list[tuple[list[Box], Box]] = [(list(boxes), {})]
    while parts:
        part, region = parts.pop()
        if len(part) > 1:
            halves = _halves(part, region, ends)
            if halves is None:
                raise Unreadable("the windows do not divide all sequences of dwell times")
            parts += halves
        elif any(part[0].get(j, ends) != region.get(j, ends) for j in set(part[0]) | set(region)):
            raise Unreadable("the windows do not divide all sequences of dwell times")


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
    edges = []
    shifted = [
        {offset + 1: interval for offset, interval in each_box.items()} for each_box in boxes
    ]
    for s, box in enumerate(boxes):
        for t, following in enumerate(shifted):
            both = _common(box, following, ends)
            if both is not None and _reachable(both, ends, jitter):
                edges.append((s, t, *both.get(0, ends)))
    return edges


def _common(first: Box, second: Box, ends: Interval) -> Box | None:
    """Intersection of two boxes, by offsets; None when the inside of some offset is empty.

    Cells are half-open, [., .), the last one closed, so that inside means: more than a point.
    """
    shared = dict(first)
    for offset, (low, high) in second.items():
        a, b = shared.get(offset, ends)
        low, high = max(low, a), min(high, b)
        if not low < high:
            return None
        shared[offset] = low, high
    return shared


def _reachable(box: Box, ends: Interval, jitter: float) -> bool:
    """Decide exactly whether the box holds a sequence with steps of at most `jitter`."""
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


def _numbers(interval: Interval) -> tuple[Rational, Rational | None]:
    """Exact ends; None for infinity."""
    low, high = interval
    return rational(low), None if math.isinf(high) else rational(high)


def _check_edges(edges: Sequence[Edge], listed: frozenset[Edge]) -> None:
    """Unreadable unless these edges are those that the certificate lists."""
    if missing := set(edges) - listed:
        s, t, *_ = min(missing)
        raise Unreadable(f"window {t + 1} can follow window {s + 1}, which the edges do not list")
    if more := listed - set(edges):
        s, t, *_ = min(more)
        raise Unreadable(f"the edges list windows {s + 1} and {t + 1} as they do not follow")
