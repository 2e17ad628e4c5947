"""The rows of a kernel from enclosed maps, with their margins for rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, raised
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.maps import BoxMap
from obsdesign.runtime.interval.model import Model, exactly, size

# what r and m of a box lack: each is rounded once
_BOX_ROUNDINGS = 4


def path_kernel(step: BoxMap, p: int) -> Kernel:
    """The box alone, p outputs, no disturbance, no noise: the effect of rounding on a centre."""
    n, columns = len(step.g), step.X.mid.shape[1]
    rows = np.vstack([_radius_rows(replace(step, g=np.zeros(n))), _centre_rows(step)])
    return Kernel(rows, n, p, 0, 0, *_layout(n, columns))


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
    n, p = len(step.g), len(C)
    columns = step.X.mid.shape[1]
    y_end = exactly(np.zeros((p, columns)))
    y_end.mid[:, n + p : n + 2 * p] = np.eye(p)
    y_end.mid[:, -1] = -model.y_mid
    if noise is not None:
        y_end.rad[:, -p - 1 : -1] = np.diag(noise)
    blocks = [_radius_rows(step), _centre_rows(step)]
    before = _Rows.of_map([*cuts.strips, step][0])
    residual = before.times(-model.C, y_end)
    residual = _Rows(residual.X, residual.R, residual.g + model.V)
    blocks += [residual.upper(), residual.upper(-1.0)]
    maps = [_Rows.of_map(each) for each in (step, *(m for m in cuts.boxes if m is not step))]
    strips = [_Rows.of_map(each) for each in cuts.strips]
    ends = _candidates(maps, strips, model.S, exactly(C), model.V, y_end)
    inner = [] if model.S is None else _candidates(maps, strips, None, model.C, model.V, y_end)
    total = _total(np.vstack([*blocks, *ends, *inner]), slice(n, n + columns))
    rows = np.vstack([*blocks, total, *ends, *inner])
    return Kernel(rows, n, p, len(ends), len(inner), *_layout(n, columns))


def _candidates(
    maps: list[_Rows], strips: list[_Rows], S: Enclosure | None, C: Enclosure, V: Matrix,
    y_end: Enclosure,
) -> list[Matrix]:  # fmt: skip
    """Bounds of S z from all maps, C acting on S z; those that are not finite only of the first."""
    maps, strips = ([box if S is None else box.times(S) for box in each] for each in (maps, strips))
    first, *ends = [_ends(box) for box in maps]
    for box in strips:
        ends += _strip_ends(box, C, V, y_end)
    return [first, *(each for each in ends if np.isfinite(each).all())]


def _layout(n: int, columns: int) -> tuple[Matrix, int, Matrix]:
    """(blank, middle, halves) of a kernel."""
    blank, half = np.zeros(n + 2 * columns), 0.5 * np.eye(n)
    blank[n + columns - 1] = 1.0
    return blank, n + columns, np.block([[-half, -half], [half, -half]])


def _centre_rows(step: BoxMap) -> Matrix:
    """m+ = X v."""
    X = step.X.mid
    return np.hstack([np.zeros((len(X), len(X))), X, np.zeros_like(X)])


def _total(rows: Matrix, signed: slice) -> Matrix:
    """A row, (1, width), that gives twice the sum of |row| |v|; signed: what has a sign in v."""
    weights: Matrix = 2.0 * np.abs(rows).sum(axis=0, keepdims=True)
    weights[:, signed.stop :] += weights[:, signed]
    weights[:, signed] = 0.0
    return weights


@dataclass(frozen=True)
class _Rows:
    """Quantities within R r + g of X [m; y0; y1; u; 1]."""

    X: Enclosure
    R: Matrix
    g: Matrix

    @classmethod
    def of_map(cls, step: BoxMap) -> _Rows:
        """The states that a map leads to."""
        return cls(step.X, step.R, step.g)

    def times(self, left: Enclosure, plus: Enclosure | None = None) -> _Rows:
        """left times these, plus a known part."""
        weight, terms = size(left), 2 * len(self.g)
        X = left @ self.X
        return _Rows(
            X if plus is None else X + plus,
            raised(weight @ self.R, terms),
            raised(weight @ self.g, terms),
        )

    def upper(self, sign: float = 1.0) -> Matrix:
        """Rows that give at least sign X v + R r + g when they are multiplied in floats."""
        X = self.X.mid
        terms = 2 * (self.R.shape[1] + 2 * X.shape[1]) + 8 + _BOX_ROUNDINGS
        R = raised(self.R, terms)
        error = raised(self.X.rad + terms * UNIT * np.abs(X), terms)
        error[:, -1] = raised(error[:, -1] + self.g, terms) + TINY
        return np.hstack([R, sign * X, error])


def _radius_rows(step: BoxMap) -> Matrix:
    """r+ = R r + g, and the error of m+."""
    rows = _Rows(step.X, step.R, step.g).upper()
    n, columns = len(step.g), step.X.mid.shape[1]
    rows[:, n : n + columns] = 0.0
    return rows


def _ends(rows: _Rows) -> Matrix:
    """[lower; -upper] of all points within R r + g of X v, rounded outward."""
    return -np.vstack([rows.upper(-1.0), rows.upper()])


def _strip_ends(states: _Rows, C: Enclosure, V: Matrix, y_end: Enclosure) -> list[Matrix]:
    """Bounds of x_j from c_j x_j = y - v - sum of the other c_k x_k, elsewhere those of the box.

    As few candidates as rows of C with entries in one column take.
    """
    n, whole = len(states.g), _ends(states)
    candidates: list[Matrix] = []
    taken: list[set[int]] = []
    for i, j in zip(*np.nonzero(C.mid), strict=True):
        pair = _strip_pair(states, C, V, y_end, (int(i), int(j)))
        if pair is None:
            continue
        place = next((k for k, entries in enumerate(taken) if j not in entries), len(taken))
        if place == len(taken):
            candidates.append(whole.copy())
            taken.append(set())
        taken[place].add(int(j))
        candidates[place][j], candidates[place][n + j] = pair
    return candidates


def _strip_pair(
    states: _Rows, C: Enclosure, V: Matrix, y_end: Enclosure, entry: tuple[int, int]
) -> Matrix | None:
    """Rows for the lower and the upper bound of one state from one output; None if not finite."""
    i, j = entry
    c, error = float(C.mid[i, j]), float(C.rad[i, j])
    if not abs(c) > 2 * error:
        return None
    with np.errstate(over="ignore"):
        scale = abs(1.0 / c)
        # |1/c' - 1/c| <= |c' - c| / (|c| |c'|)
        off = UNIT * scale + (4 * error * scale * scale if error else 0.0)
    if not np.isfinite(scale + off):
        return None
    others = Enclosure(-C.mid[i : i + 1], C.rad[i : i + 1].copy())
    others.mid[0, j] = others.rad[0, j] = 0.0
    term = states.times(others, Enclosure(y_end.mid[i : i + 1], y_end.rad[i : i + 1]))
    largest = float(raised(np.array(scale + off), 2)) if error else scale
    R = raised(term.R * largest, 2)
    g = raised((term.g + V[i]) * largest, 4)
    pair = _ends(_Rows(term.X.scaled(1.0 / c, off), R, g))
    return pair if np.isfinite(pair).all() else None
