"""The rows of a kernel as series in the length of its step: `kernel_rows` for a cell.

A row is a constant times the states that a map leads to, and what is known: for the steps of a cell
it is a series of which only the weights s^k differ, and absolute values of a few others (`Kinks`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, raised
from obsdesign.runtime.enclosed_series import TERMS, Series
from obsdesign.runtime.interval.kernel_rows import Contained, Rows, is_between, strip_factor
from obsdesign.runtime.interval.map_series import Kinks, MapSeries
from obsdesign.runtime.interval.model import Model, exactly, size

# where in a cell rows are compared with each other
_PLACES = (-1.0, 0.0, 1.0)


class Part(NamedTuple):
    """Rows factor x + plus of the states x that a map leads to, known up to `added` (rows,).

    weight: at least |factor|, as products of absolute values.
    """

    factor: Enclosure
    weight: Matrix
    plus: Enclosure
    added: Matrix


class Frame(NamedTuple):
    """Coordinates of bounds: S from the observer's to them, None where they are its own; C."""

    S: Enclosure | None
    C: Enclosure

    def of_states(self, columns: int, factor: Enclosure | None = None) -> Part:
        """The states, or a factor times them, as a part of a row without anything known."""
        n = self.C.mid.shape[1]
        identity = exactly(np.eye(n))
        whole, weight = (identity, np.eye(n)) if self.S is None else (self.S, size(self.S))
        if factor is not None:
            whole = factor if self.S is None else factor @ self.S
            weight = size(factor) if self.S is None else raised(size(factor) @ weight, 2 * n)
        rows = len(whole.mid)
        return Part(whole, weight, exactly(np.zeros((rows, columns))), np.zeros(rows))


@dataclass(frozen=True)
class Maps:
    """Maps of the steps of a cell as in `kernel_rows.Cuts`: the first box is the step."""

    boxes: Sequence[MapSeries]
    strips: Sequence[MapSeries]

    @cached_property
    def all(self) -> list[MapSeries]:
        """Each of them once."""
        return list({id(each): each for each in [*self.boxes, *self.strips]}.values())

    @cached_property
    def kinks(self) -> Kinks:
        """Those of all maps, behind each other."""
        total = Kinks.none(len(self.boxes[0].R.rad))
        for each in self.all:
            total = total.joined(each.kinks)
        return total

    def groups(self, of_map: MapSeries) -> slice:
        """Places of the groups of a map among those of all."""
        before = [id(each) for each in self.all].index(id(of_map))
        first = sum(len(each.kinks.R) for each in self.all[:before])
        return slice(first, first + len(of_map.kinks.R))


class RowSeries(NamedTuple):
    """Forms of [lower; -upper; y0; y1; u; 1] by the weights s^k and sums of absolute values.

    mid: (TERMS + groups, rows, middle); rad: (rows, middle).
    """

    mid: Matrix
    rad: Matrix

    def chosen(self, rows: Indices) -> RowSeries:
        """Some of the rows."""
        return RowSeries(self.mid[:, rows], self.rad[rows])

    def negated(self) -> RowSeries:
        """All with the other sign."""
        return RowSeries(-self.mid, self.rad)


def stacked(parts: Sequence[RowSeries]) -> RowSeries:
    """The rows of all parts."""
    mids, rads = zip(*parts, strict=True)
    return RowSeries(np.concatenate(mids, axis=1), np.concatenate(rads))


def ends(maps: Maps, of_map: MapSeries, part: Part) -> tuple[RowSeries, RowSeries]:
    """(lower, -upper) ends of a part; their rounding outward is left to the kernel."""
    n, weight, groups = len(of_map.R.rad), exactly(part.weight), len(maps.kinks.R)
    X = of_map.X.left_product(part.factor) + Series.constant(part.plus)
    R = of_map.R.left_product(weight)
    g = of_map.g.left_product(weight) + Series.constant(exactly(part.added[:, None]))
    M, known, spread, added = (
        np.concatenate([each, np.zeros((groups, *each.shape[1:]))])
        for each in (X.mid[..., :n], X.mid[..., n:], R.mid, g.mid)
    )
    own = slice(TERMS + maps.groups(of_map).start, TERMS + maps.groups(of_map).stop)
    spread[own] = part.weight @ of_map.kinks.R
    added[own] = part.weight @ of_map.kinks.g[..., None]
    plus, minus = 0.5 * (spread + M), 0.5 * (spread - M)
    lower = np.concatenate([plus, minus, known], axis=-1)
    upper = np.concatenate([minus, plus, -known], axis=-1)
    for each in (lower, upper):
        each[..., -1:] -= added
    of_m = R.rad + X.rad[:, :n] + 2 * UNIT * (R.size + X.size[:, :n])
    of_known = X.rad[:, n:]
    of_known = np.hstack([of_known[:, :-1], of_known[:, -1:] + g.rad
                          + 2 * UNIT * (g.size + X.size[:, -1:])])  # fmt: skip
    rad = raised(np.hstack([0.5 * of_m, 0.5 * of_m, of_known]), 8)
    return RowSeries(lower, rad), RowSeries(upper, rad)


def candidates(
    model: Model, frame: Frame, maps: Maps, y_end: Enclosure
) -> list[tuple[RowSeries, RowSeries]]:
    """Candidates for the bounds of states, those of `kernel_rows.candidates`: pairs of blocks."""
    n, columns = frame.C.mid.shape[1], y_end.mid.shape[1]
    listed, of_state = list[tuple[RowSeries, RowSeries]](), list[list[int]]([] for _ in range(n))
    rows = 0
    for box in maps.boxes:
        kept = _needed(model, frame, maps, box)
        listed.append(ends(maps, box, frame.of_states(columns)))
        for j in np.flatnonzero(kept).tolist():
            of_state[j].append(rows + j)
        rows += n
    for j, part in _strip_parts(model, frame, y_end):
        for strip in maps.strips if part.weight.any() else maps.strips[:1]:
            listed.append(ends(maps, strip, part))
            of_state[j].append(rows)
            rows += 1
    lower, upper = (stacked(each) for each in zip(*listed, strict=True))
    blocks = []
    for k in range(max(map(len, of_state))):
        chosen = np.array([places[min(k, len(places) - 1)] for places in of_state])
        blocks.append((lower.chosen(chosen), upper.chosen(chosen)))
    return blocks


def _needed(model: Model, frame: Frame, maps: Maps, box: MapSeries) -> NDArray[np.bool_]:
    """Which states of a box are not between others (`kernel_rows.is_between`).

    Those without y1, and the strip of y1. Decided at a few lengths: any choice is sound.
    """
    n = len(box.R.rad)
    needed = np.ones(n, bool)
    if not maps.strips or not box.X.mid[:, :, n + len(model.V) : n + 2 * len(model.V)].any():
        return needed
    compared = []
    for s in _PLACES:
        rows = [Rows.of_map(each.box_map(s)) for each in (box, maps.strips[-1])]
        own, free = rows if frame.S is None else [each.times(frame.S) for each in rows]
        compared.append((own, Contained(free)))
    for j in range(n):
        needed[j] = not all(is_between(*pair, frame.C, model.V, j) for pair in compared)
    return needed


def _strip_parts(model: Model, frame: Frame, y_end: Enclosure) -> Iterator[tuple[int, Part]]:
    """Bounds of single states from single outputs: (state, part of the states before y1)."""
    for i, j in zip(*np.nonzero(frame.C.mid), strict=True):
        about = strip_factor(frame.C, (int(i), int(j)))
        if about is None:
            continue
        scale, off, others = about
        largest = raised(np.array([abs(scale) + off]), 2)
        states = frame.of_states(y_end.mid.shape[1], others)
        plus = Enclosure(y_end.mid[i : i + 1], y_end.rad[i : i + 1])
        yield int(j), Part(
            states.factor.scaled(scale, off), raised(states.weight * largest, 2),
            plus.scaled(scale, off), raised(model.V[i : i + 1] * largest, 2),
        )  # fmt: skip


def residual(model: Model, frame: Frame, y_end: Enclosure) -> Part:
    """y1 - y_mid - C z before y1 is used."""
    part = frame.of_states(y_end.mid.shape[1], -frame.C)
    return part._replace(plus=y_end, added=model.V)
