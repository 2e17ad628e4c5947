"""One step as one matrix-vector product: box, bounds, checks and rounding in a single matrix.

A kernel multiplies v = [r; m; y0; y1; u; 1; |m|; |y0|; |y1|; |u|; 1] (r, m: radius and centre in
the observer's coordinates; y0, y1: measurements at start and end; u: input, or w at a jump) and
gives

    r+, m+              the box after the step
    reach -+ (y1 - C m) both nonnegative unless no state of the predicted box can give y1
    a number            finite only if everything else is: above the sum of its absolute values
    lower, -upper       of x, several sound candidates: the largest of each holds

Rounding: |float(a'v) - a'v| <= gamma |a|'|v|. What is added on the radius side, or on the outer
side of a bound, covers it, what the enclosure of the maps is off by, and itself.

The kernels of an interval observer: one set for each length of a step, and those of jumps.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.enclosure import TINY, UNIT, Enclosure, Matrix, raised
from obsdesign.runtime.base import MODERATE, Vector, vector
from obsdesign.runtime.interval.maps import (
    BoxMap,
    flow_and_jump_spread,
    flow_maps,
    free_map,
    identity_map,
    jump_maps,
    sampled,
)
from obsdesign.runtime.interval.model import Model, exactly, model, size
from obsdesign.runtime.interval.state import Course, IntervalState, shared_box
from obsdesign.runtime.step_cache import shared_step


@dataclass(frozen=True, slots=True)
class Kernel:
    """A matrix and the layout of what it multiplies.

    rows: the matrix; n, p: states and outputs; candidates: how many bounds of x it gives; blank: v
    of nothing; middle: where its absolute values begin.
    """

    rows: Matrix
    n: int
    p: int
    candidates: int
    blank: Matrix
    middle: int

    @property
    def moderate(self) -> bool:
        """Does a product with moderate numbers stay far from overflow?"""
        return bool(np.abs(self.rows).max() < MODERATE)

    @property
    def width(self) -> int:
        """Length of v."""
        return int(self.rows.shape[1])

    def parts(self) -> tuple[slice, ...]:
        """Of v: the box, y1, what has an absolute value, and where that goes; of a result: the
        checks, the first and the second candidate for the bounds.
        """
        n, p, middle = self.n, self.p, self.middle
        first = 2 * n + 2 * p + 1
        return (
            slice(2 * n), slice(2 * n + p, 2 * n + 2 * p), slice(n, middle), slice(middle, None),
            slice(2 * n, first), slice(first, first + 2 * n), slice(first + 2 * n, first + 4 * n),
        )  # fmt: skip

    def vector(self, box: Matrix, y0: Matrix | None, y1: Matrix | None, u: Matrix) -> Matrix:
        """v for a box [r; m], measurements at the start and end of the step, and an input."""
        n, p, middle = self.n, self.p, self.middle
        v = self.blank.copy()
        v[: 2 * n] = box
        if y0 is not None:
            v[2 * n : 2 * n + p] = y0
        if y1 is not None:
            v[2 * n + p : 2 * n + 2 * p] = y1
        if u.size:
            v[2 * n + 2 * p : middle - 1] = u
        np.abs(v[n:middle], v[middle:])
        return v

    def bounds(self, out: Matrix) -> tuple[Matrix, Matrix]:
        """(lower, upper) of x from a result."""
        n = self.n
        ends = out[2 * n + 2 * self.p + 1 :]
        if self.candidates == 2:
            ends = np.maximum(ends[: 2 * n], ends[2 * n :])
        elif self.candidates > 2:
            ends = np.maximum.reduce(ends.reshape(self.candidates, 2 * n))
        return ends[:n], -ends[n:]

    def results(self, out: Matrix) -> tuple[Matrix, tuple[Matrix, Matrix], list[str]]:
        """(box, (lower, upper), what is wrong with them) from a result.

        Overflow leaves the only sound bounds: none.
        """
        n = self.n
        if not math.isfinite(out[2 * n + 2 * self.p]):
            nothing = np.full(n, np.inf)
            box = np.concatenate([nothing, np.zeros(n)])
            return box, (-nothing, nothing), ["bounds overflowed"]
        lower, upper = self.bounds(out)
        box = out[: 2 * n]
        if self.candidates > 1 and (lower > upper).any():
            lower, upper = replace(self, candidates=1).bounds(out)
            return box, (lower[:n], upper[:n]), ["bounds crossed"]
        return box, (lower, upper), []

    def implausible(self, out: Matrix) -> list[str]:
        """Measurements that no state inside the bounds can give: they refute the bounds."""
        n, p = self.n, self.p
        room = out[2 * n : 2 * n + 2 * p].tolist()
        if min(room) >= 0:
            return []
        return [f"y{i + 1} outside its bounds" for i in range(p) if min(room[i], room[p + i]) < 0]


def path_kernel(step: BoxMap, p: int) -> Kernel:
    """The box alone, p outputs, no disturbance, no noise: what rounding does to a centre."""
    with np.errstate(over="ignore", invalid="ignore"):
        n, columns = len(step.g), step.X.mid.shape[1]
        rows = np.vstack([_radius_rows(replace(step, g=np.zeros(n))), _centre_rows(step)])
        return Kernel(rows, n, p, 0, _blank(n, columns), n + columns)


def kernel(model: Model, step: BoxMap, predicted: BoxMap, C: Matrix, strips: bool) -> Kernel:
    """The kernel of a step; predicted: the same step without y1.

    C: in the coordinates of the plant. strips: intersect with |C x - y1| <= V and the prediction.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _kernel(model, step, predicted, C, strips)


def _kernel(model: Model, step: BoxMap, predicted: BoxMap, C: Matrix, strips: bool) -> Kernel:
    n, p = len(step.g), len(C)
    columns = step.X.mid.shape[1]
    y_end = np.zeros((p, columns))
    y_end[:, n + p : n + 2 * p] = np.eye(p)
    y_end[:, -1] = -model.y_mid
    blocks = [_radius_rows(step), _centre_rows(step)]
    box = _Rows(step.X, step.R, step.g)
    before = _Rows(predicted.X, predicted.R, predicted.g)
    residual = before.times(-model.C, exactly(y_end))
    residual = _Rows(residual.X, residual.R, residual.g + model.V)
    blocks += [residual.upper(), residual.upper(-1.0)]
    S = exactly(np.eye(n)) if model.S is None else model.S
    ends = [_ends(box.times(S))]
    if strips:
        ends += _strip_ends(before.times(S), C, model.V, y_end)
    total = _total(np.vstack([*blocks, *ends]), slice(n, n + columns))
    rows = np.vstack([*blocks, total, *ends])
    rows.setflags(write=False)
    return Kernel(rows, n, p, len(ends), _blank(n, columns), n + columns)


def _blank(n: int, columns: int) -> Matrix:
    blank = np.zeros(n + 2 * columns)
    blank[n + columns - 1] = 1.0
    blank.setflags(write=False)
    return blank


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
        terms = 2 * (self.R.shape[1] + 2 * X.shape[1]) + 8
        R = raised(self.R, terms)
        error = raised(self.X.rad + terms * UNIT * np.abs(X), terms)
        error[:, -1] = raised(error[:, -1] + self.g, terms) + TINY
        return np.hstack([R, sign * X, error])


def _radius_rows(step: BoxMap) -> Matrix:
    """r+ = R r + g, and all that m+ may be off by."""
    rows = _Rows(step.X, step.R, step.g).upper()
    n, columns = len(step.g), step.X.mid.shape[1]
    rows[:, n : n + columns] = 0.0
    return rows


def _ends(rows: _Rows) -> Matrix:
    """[lower; -upper] of what lies within R r + g of X v, rounded outward."""
    return -np.vstack([rows.upper(-1.0), rows.upper()])


def _strip_ends(box: _Rows, C: Matrix, V: Matrix, y_end: Matrix) -> list[Matrix]:
    """For each output: x_j from c_j x_j = y - v - sum of the other c_k x_k; else as predicted.

    With several outputs, which cost a reduction anyway, the prediction as a whole comes first.
    """
    whole = _ends(box)
    found = [whole] if len(C) > 1 else []
    n = len(box.g)
    for i in range(len(C)):
        ends = whole.copy()
        for j in np.flatnonzero(C[i]):
            others = C[i].copy()
            others[j] = 0.0
            rest = box.times(exactly(-others[None]), exactly(y_end[i][None]))
            scale = abs(1.0 / C[i, j])
            if not np.isfinite(scale):
                continue
            X = rest.X.scaled(1.0 / C[i, j], UNIT * scale)
            R = raised(rest.R * scale, 2)
            g = raised((rest.g + V[i]) * scale, 4)
            pair = _ends(_Rows(X, R, g))
            if np.isfinite(pair).all():
                ends[j], ends[n + j] = pair
        found.append(ends)
    return found


# step lengths as they come, before rounding: a few dozen differences of decimal time stamps
_RECENT = 1024


class StepKernels:
    """Kernels, made when they are first needed.

    gains: of a design of kind `interval`. Of a step: "none" without a measurement, "start" and
    "end" with one there (continuous y), "sampled" (periodic samples), and for the path of a
    `Course` "path" and "sampled path".
    """

    def __init__(self, gains: Mapping[str, Any]) -> None:
        self.gains = gains
        self.periodic = "period" in gains
        self._steps: OrderedDict[tuple[float, int], dict[str, Kernel]] = OrderedDict()
        self._jumped: OrderedDict[tuple[float, int], tuple[Matrix, Matrix]] = OrderedDict()
        self._recent: dict[tuple[float, int], dict[str, Kernel]] = {}
        # (length as it comes, exponent of the later time) -> the kernel of a sample there, in parts
        self.usual: dict[tuple[float, int], tuple[Any, ...]] = {}

    @cached_property
    def model(self) -> Model:
        """The plant in the observer's coordinates, enclosed."""
        with np.errstate(over="ignore", invalid="ignore"):
            return model(self.gains)

    def at(self, h: float, size: float) -> dict[str, Kernel]:
        """For a step of about h between time stamps of magnitude `size`."""
        key = (h, math.frexp(size)[1])
        found = self._recent.get(key)
        if found is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
                self.usual.clear()
            found = shared_step(self._steps, h, size, self._built)
            self._recent[key] = found
            if self.periodic:
                chosen = found["sampled"]
                if chosen.moderate:
                    self.usual[key] = (chosen.rows, chosen.blank, *chosen.parts())
        return found

    @cached_property
    def still(self) -> Mapping[str, Kernel]:
        """Of no time passing."""
        return self.at(0.0, 0.0)

    @cached_property
    def jumps(self) -> dict[bool, Kernel]:
        """Of a jump: with the correction M (y - C x), and without."""
        with np.errstate(over="ignore", invalid="ignore"):
            maps = jump_maps(self.model, self.gains)
        return {
            corrected: kernel(self.model, step, step, self.gains["C"], False)
            for corrected, step in maps.items()
        }

    def after_jump(
        self, step: Mapping[str, Kernel], out: Vector, state: IntervalState, y: Vector | None,
        w: ArrayLike | None, off: bool, course: Course | None,
    ) -> tuple[Kernel, Vector]:  # fmt: skip
        """The result after a jump, from `out` just before it; `step`: the kernels that led there.

        With samples as events: the sample and the jump, one after the other, then cut with the
        jump corrected by M. off: the sample is off the period. course: up to the jump, as long as
        no sample ended it.
        """
        if "G" not in self.gains:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        inputs = self.gains["E"].shape[1] if "E" in self.gains else 0
        known = np.zeros(inputs) if w is None else vector(w, inputs, "w")
        when = self.gains["jump_measurement"]

        def jumped(box: Vector, measured: bool) -> tuple[Kernel, Vector]:
            k = self.jumps[measured]
            return k, k.rows.dot(k.vector(box, None, y if measured else None, known))

        n2 = len(state.box)
        use = y is not None and when != "none"
        if not self.periodic:
            return jumped(out[:n2], use)
        k, after = jumped(out[:n2], False)
        if course is not None:
            k, after = self.shared(k, after, [self._after_course(course, known)], state.u)
        if not use:
            return k, after
        if when == "after":
            k, free = self.still["sampled"], after
            after = k.rows.dot(k.vector(free[:n2], None, y, state.u))
            if off:
                k, after = self.shared(k, after, [free[:n2]], state.u)
        if np.any(self.gains["M"]):
            plain = step["none"]
            before = plain.rows.dot(plain.vector(state.box, state.y, None, state.u))
            _, other = jumped(before[:n2], True)
            box = shared_box(after[:n2], other[:n2], k.n)
            k = self.still["none"]
            after = k.rows.dot(k.vector(box, None, None, state.u))
        return k, after

    def _after_course(self, course: Course, known: Vector) -> Vector:
        """The box after a jump that ends a course."""
        path = self._jump_path.rows.dot(self._jump_path.vector(course.path, None, None, known))
        n, t = len(course.radius), course.now
        size = max(abs(t), abs(course.since))
        R, g = shared_step(self._jumped, t - course.since, size, self._flow_and_jump)
        reach = raised(R @ course.radius + g, 2 * n)
        return np.concatenate([raised(reach + path[:n], 1), path[n:]])

    def _flow_and_jump(self, h: float, h_error: float) -> tuple[Matrix, Matrix]:
        return flow_and_jump_spread(self.model, self.gains, h, h_error)

    @cached_property
    def _jump_path(self) -> Kernel:
        return path_kernel(jump_maps(self.model, self.gains)[False], len(self.gains["C"]))

    def shared(
        self, chosen: Kernel, used: Vector, boxes: Sequence[Vector], u: Vector
    ) -> tuple[Kernel, Vector]:
        """The result of what `used` shares with further boxes, which the first of them bounds.

        What is reported is cut with all that the sample says, as far as that leaves something.
        """
        n = chosen.n
        k = self.still["none"]
        box = boxes[0]
        for other in (*boxes[1:], used[: 2 * n]):
            box = shared_box(box, other, n)
        out: Vector = k.rows.dot(k.vector(box, None, None, np.zeros_like(u)))
        lower, upper = chosen.bounds(used)
        ends = np.maximum(out[-2 * n :], np.concatenate([lower, -upper]))
        if (ends[:n] <= -ends[n:]).all():
            out[-2 * n :] = ends
        return k, out

    def _built(self, h: float, h_error: float) -> dict[str, Kernel]:
        plant = self.model
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            if h == 0.0:
                maps = {"none": identity_map(plant)}
            elif self.periodic:
                maps = {"none": free_map(plant, h, h_error)}
            else:
                maps = flow_maps(plant, h, h_error)
            if self.periodic:
                maps["sampled"] = sampled(plant, maps["none"], h, h_error)
        built = {name: self._kernel(name, maps) for name in maps}
        if self.periodic:
            p = len(self.gains["C"])
            built["path"] = path_kernel(maps["none"], p)
            built["sampled path"] = path_kernel(maps["sampled"], p)
        return built

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        predicted = maps["start" if name == "start" else "none"]
        return kernel(self.model, maps[name], predicted, self.gains["C"], name == "sampled")
