"""The rows of a kernel from enclosed maps, with their margins for rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, raised
from obsdesign.runtime.base import MODERATE
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model, exactly, size

# relative rounding of radii that agree in exact arithmetic
_NO_WIDER = 1e-12


@dataclass(frozen=True)
class Cuts:
    """What else contains the state after a step, beside the box of the observer.

    boxes: further maps of the same step; strips: maps without y1 whose outputs are within V of y1,
    if there is one. Every map leads to a box that contains the state: so does their intersection.
    """

    boxes: Sequence[BoxMap] = ()
    strips: Sequence[BoxMap] = ()


def kernel(
    model: Model, step: BoxMap, C: Matrix, cuts: Cuts, *, noise: Matrix | None = None
) -> Kernel:
    """The kernel of a step. C: in the coordinates of the plant.

    noise: (p,) radius of the noise of y1 whose parts are the last inputs before 1, beside V.
    """
    p = len(C)
    y_end = measurement(model, step.X.mid.shape[1])
    if noise is not None:
        y_end.rad[:, -p - 1 : -1] = np.diag(noise)
    listed = [step, *(each for each in cuts.boxes if each is not step)]
    boxes, strips = ([Contained(Rows.of_map(each)) for each in maps]
                     for maps in (listed, cuts.strips))  # fmt: skip
    return kernel_of_rows(model, exactly(C), boxes, strips, y_end)


def measurement(model: Model, columns: int) -> Enclosure:
    """y1 - y_mid as forms of v, (p, columns)."""
    p, n = model.C.mid.shape
    y_end = exactly(np.zeros((p, columns)))
    y_end.mid[:, n + p : n + 2 * p] = np.eye(p)
    y_end.mid[:, -1] = -model.y_mid
    return y_end


def kernel_of_rows(
    model: Model, C: Enclosure, boxes: Sequence[Contained], strips: Sequence[Contained],
    y_end: Enclosure, bounded: Bounded | None = None,
) -> Kernel:  # fmt: skip
    """The kernel of a step to the first of `boxes`, cut with all of them and with strips.

    C: in the coordinates of the plant; strips: as in `Cuts`; y_end: (p, columns), y1 - y_mid;
    bounded: further cuts, which count on known bounds of x.
    """
    step, (p, columns) = boxes[0].states, y_end.mid.shape
    n = len(step.g)
    states, noise = [*strips, boxes[0]][0]
    residual = widened(states.times(-model.C, y_end), noise, model.V)
    checks = -np.vstack([residual.lower(-1.0), residual.lower()])
    outer, inner = _all_candidates(model, C, boxes, strips, y_end)
    own = None if bounded is None else (len(outer), len(inner))
    if bounded is not None:
        more = _all_candidates(model, C, bounded.boxes, bounded.strips, y_end)
        outer, inner = [*outer, *more[0], _ends(bounded.known)], [*inner, *more[1]]
    both = [_ends(step if model.S is None else step.times(model.S)), _ends(step)]
    whole = np.vstack(both[: 1 if model.S is None else 2])
    total = _total(np.vstack([checks, whole, *outer, *inner]))
    rows = np.vstack([checks, total, *outer, *inner])
    middle = n + columns
    blank = np.zeros(2 * middle)
    blank[middle - 1] = 1.0
    return Kernel(rows, n, p, len(outer), len(inner), whole, blank, middle, own=own)


def _all_candidates(
    model: Model, C: Enclosure, boxes: Sequence[Contained], strips: Sequence[Contained],
    y_end: Enclosure,
) -> tuple[list[Matrix], list[Matrix]]:  # fmt: skip
    """Candidates for the bounds of x, and for those of z where x = S z."""
    maps, S = [each.states for each in boxes], model.S
    if S is None:
        return _candidates(maps, strips, C, V=model.V, y_end=y_end), []
    inner = _candidates(maps, strips, model.C, V=model.V, y_end=y_end)
    maps = [box.times(S) for box in maps]
    strips = [each._replace(states=each.states.times(S)) for each in strips]
    return _candidates(maps, strips, C, V=model.V, y_end=y_end), inner


class Bounded(NamedTuple):
    """Cuts of a plant with parameters where bounds of x are known; known: these bounds."""

    boxes: Sequence[Contained]
    strips: Sequence[Contained]
    known: Rows


class Contained(NamedTuple):
    """States that a step leads to, and y1 - y_mid - C z there, None where that is within V."""

    states: Rows
    noise: Rows | None = None


@dataclass(frozen=True)
class Rows:
    """Quantities within R r + g of X [m; y0; y1; u; 1], r and m the radius and centre of a box."""

    X: Enclosure
    R: Matrix
    g: Matrix

    @classmethod
    def of_map(cls, step: BoxMap) -> Rows:
        """The states that a map leads to."""
        return cls(step.X, step.R, step.g)

    def times(self, left: Enclosure, plus: Enclosure | None = None) -> Rows:
        """left times these, plus a known part."""
        weight, terms = size(left), 2 * len(self.g)
        X = left @ self.X
        return Rows(
            X if plus is None else X + plus,
            raised(weight @ self.R, terms),
            raised(weight @ self.g, terms),
        )

    def lower(self, sign: float = 1.0) -> Matrix:
        """Rows that give at most sign X v - R r - g when they are multiplied in floats.

        X m - R r = (R + X) / 2 lower + (R - X) / 2 (-upper).
        """
        n = self.R.shape[1]
        M, known = sign * self.X.mid[:, :n], sign * self.X.mid[:, n:]
        signed = np.hstack([0.5 * (self.R + M), 0.5 * (self.R - M), known])
        of_m, of_known = self.X.rad[:, :n], self.X.rad[:, n:]
        rad = np.hstack([0.5 * of_m, 0.5 * of_m, of_known])
        terms = 4 * signed.shape[1] + 8
        error = raised(rad + terms * UNIT * np.abs(signed), terms)
        error[(signed == 0.0) & (rad == 0.0)] = 0.0  # nothing to round
        error[:, -1] = raised(error[:, -1] + self.g, terms) + TINY
        return np.hstack([signed, -error])


def widened(rows: Rows, noise: Rows | None, V: Matrix, outputs: slice = slice(None)) -> Rows:
    """Rows of some outputs with the noise of their measurement; V where that is None."""
    if noise is None:
        return Rows(rows.X, rows.R, rows.g + V[outputs])
    rad = raised(rows.X.rad + noise.X.rad[outputs], 1)
    R = raised(rows.R + noise.R[outputs], 1)
    return Rows(Enclosure(rows.X.mid, rad), R, rows.g + noise.g[outputs])


def _ends(rows: Rows) -> Matrix:
    """[lower; -upper] of all points within R r + g of X v, rounded outward."""
    return np.vstack([rows.lower(), rows.lower(-1.0)])


def _total(rows: Matrix) -> Matrix:
    """A row that gives twice the sum of |row| |v|: v ends with its absolute values."""
    weights: Matrix = 2.0 * np.abs(rows).sum(axis=0)
    middle = len(weights) // 2
    weights[middle:] += weights[:middle]
    weights[:middle] = 0.0
    return weights


def _candidates(
    maps: list[Rows], strips: Sequence[Contained], C: Enclosure, *, V: Matrix, y_end: Enclosure
) -> list[Matrix]:
    """Bounds of states on which C acts: in as few blocks as the state with most bounds needs.

    Those that are not finite only of the first map; none twice, none that two others imply.
    """
    n = len(maps[0].g)
    of_state: list[list[Matrix]] = [[] for _ in range(n)]
    for box in maps:
        ends = _ends(box)
        for j, pairs in enumerate(of_state):
            if not (strips and is_between(box, strips[-1], C, V, j)):
                pairs.append(ends[[j, n + j]])
    for strip in strips:
        for i, j in zip(*np.nonzero(C.mid), strict=True):
            pair = _strip_pair(strip, C, V, y_end, (int(i), int(j)))
            of_state[int(j)] += [] if pair is None else [pair]
    of_state = [_distinct(pairs) for pairs in of_state]
    blocks = np.empty((max(map(len, of_state)), 2 * n, y_end.mid.shape[1] * 2 + 2 * n))
    for j, pairs in enumerate(of_state):
        for k, block in enumerate(blocks):
            block[[j, n + j]] = pairs[min(k, len(pairs) - 1)]
    return list(blocks)


def _distinct(pairs: list[Matrix]) -> list[Matrix]:
    """The first pair of rows, and all others that are finite, each once."""
    kept = pairs[:1]
    for pair in pairs[1:]:
        if np.isfinite(pair).all() and not any(np.array_equal(pair, other) for other in kept):
            kept.append(pair)
    return kept


def is_between(box: Rows, strip: Contained, C: Enclosure, V: Matrix, j: int) -> bool:
    """Does state j of a box lie between those of `strip` without y1 and of one about it alone?

    Its bounds are then (1 - s) times those without plus s times those of the strip, or wider.
    """
    free, noise = strip
    if noise is not None:
        return False
    n, p = len(box.g), len(V)
    (used,) = np.nonzero(box.X.mid[j, n + p : n + 2 * p])
    if len(used) != 1:
        return False
    i = int(used[0])
    c = float(C.mid[i, j])
    share = c * float(box.X.mid[j, n + p + i])
    if not 0 < share <= 1 or np.count_nonzero(C.mid[i]) > 1 or C.rad[i].any():
        return False
    free_share = (1 - share) * (1 - _NO_WIDER)
    R, g = free_share * free.R[j], free_share * free.g[j] + share * (1 - _NO_WIDER) * V[i] / abs(c)
    return bool((box.R[j] >= R).all() and box.g[j] >= g)


def is_known_from_strip(start: BoxMap, free: BoxMap, C: Matrix, V: Matrix) -> bool:
    """Is `free` no wider than `start`, which uses y0, for all boxes in the strip of y0?

    A box that was cut with y0 is one where each output is about one state of its own. Then
    |y0 - c m| <= V - |c| r, and bounds of `start` are inside those of `free` by at most
    |K| (V - |c| r) - dR r - dg, K = dm+ / dy0: linear in r, largest at r = 0 or r = V / |c|.
    """
    p, n = C.shape
    outputs, states = np.nonzero(C)
    if len(outputs) != p or len(set(outputs.tolist())) < p or len(set(states.tolist())) < p:
        return False
    c = np.abs(C[outputs, states])
    if not ((c > 1 / MODERATE) & (c < MODERATE)).all():
        return False
    K = np.abs(start.X.mid[:, n : n + p])[:, outputs]
    dR, dg = start.R - free.R, start.g - free.g
    lost = np.maximum(K * V[outputs], -dR[:, states] * (V[outputs] / c)).sum(axis=1)
    others = np.delete(dR + _NO_WIDER * free.R, states, axis=1)
    return bool((others >= 0).all() and (dg + _NO_WIDER * start.g >= lost).all())


def _strip_pair(
    strip: Contained, C: Enclosure, V: Matrix, y_end: Enclosure, entry: tuple[int, int]
) -> Matrix | None:
    """Rows for the lower and the upper bound of one state from one output; None if not finite."""
    i, j = entry
    about = strip_factor(C, entry)
    if about is None:
        return None
    scale, off, others = about
    largest = float(raised(np.array(abs(scale) + off), 2)) if C.rad[i, j] else abs(scale)
    term = strip.states.times(others, Enclosure(y_end.mid[i : i + 1], y_end.rad[i : i + 1]))
    term = widened(term, strip.noise, V, slice(i, i + 1))
    R = raised(term.R * largest, 2)
    g = raised(term.g * largest, 4)
    pair = _ends(Rows(term.X.scaled(scale, off), R, g))
    return pair if np.isfinite(pair).all() else None


def strip_factor(C: Enclosure, entry: tuple[int, int]) -> tuple[float, float, Enclosure] | None:
    """(1 / c, its error, what else the output has, negated (1, n)) of an entry c of C.

    None where 1 / c is not certain.
    """
    i, j = entry
    c, error = float(C.mid[i, j]), float(C.rad[i, j])
    if not abs(c) > 2 * error:
        return None
    with np.errstate(over="ignore"):
        scale = 1.0 / c
        # |1/c' - 1/c| <= |c' - c| / (|c| |c'|)
        off = UNIT * abs(scale) + (4 * error * scale * scale if error else 0.0)
    if not np.isfinite(abs(scale) + off):
        return None
    others = Enclosure(-C.mid[i : i + 1], C.rad[i : i + 1].copy())
    others.mid[0, j] = others.rad[0, j] = 0.0
    return scale, off, others
