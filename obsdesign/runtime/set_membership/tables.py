"""What a step of one length, or a jump, does to a state: enclosed, in balanced units.

    z+ = Phi z + forced [u; w_mid] + what the disturbance adds

The last term is known by its support function (`obsdesign.equations.set_membership.support`): its
columns F0, FM, F1, E2, E0 for every piece of a step and every active column of the disturbance, of
radius one. A jump is one piece with F0 alone, of length zero.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.enclosure import UNIT, Enclosure, powers, raised
from obsdesign.equations.time_grid import rounded_steps
from obsdesign.runtime.set_membership.counted_steps import counted_step
from obsdesign.runtime.set_membership.model import JumpModel, Model
from obsdesign.runtime.set_membership.series import FlowSeries
from obsdesign.runtime.set_membership.short_steps import ShortSteps, StepParts
from obsdesign.runtime.step_cache import cached_step, shared_step

# ||A|| times the length of a piece, roughly: its square is the error of the support function
_PIECE = 0.25
_MOST_PIECES = 32
# most pieces of a step that is short for the flow: ||A|| times it is at most 2
_SHORT_PIECES = 8
_RECENT = 256  # step lengths as they come, before rounding; at least those of a window
# pieces that are taken as one in the search for multipliers, where a step has more than two
_GROUPED = 2
_SHORT = 0.4  # ||A|| times a step that is one piece in that search

# (generators, their columns of the disturbance, remainder) of a table
Generators = tuple[Matrix, Indices, Matrix]


@dataclass(frozen=True)
class Table:
    """A map of a stage.

    Phi (n, n), with phi_error, that of a product with it included; forced (n, inputs + columns);
    columns (n, 3, pieces, width): F0, FM, F1, with column_error; sizes (n, 2, pieces, width): E2
    and E0; length: of a piece, rounded up. generators (n, g), units (g,), remainder (n, width):
    generators, scaled by the radius of their column, and a box, which together contain what the
    disturbance adds, up to rounding: for the search of multipliers alone. cover (n, n): size of the
    inverse of the first n generators, None where there is none.
    """

    Phi: Matrix
    phi_error: Matrix
    forced: Enclosure
    columns: Matrix
    column_error: Matrix
    sizes: Matrix
    length: float
    generators: Matrix
    units: Indices
    remainder: Matrix
    cover: Matrix | None

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return int(self.columns.shape[2])


class Tables:
    """Tables of steps and of jumps, made when they are first needed."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._series = FlowSeries(model.A)
        self._short_steps: dict[int, ShortSteps] = {}
        self._steps: OrderedDict[tuple[float, int], Table] = OrderedDict()
        self._counts: OrderedDict[int, Table] = OrderedDict()
        self._recent: dict[tuple[float, int], Table] = {}

    def for_step(self, h: float, size: float) -> Table:
        """The table of a step of about h >= 0 between time stamps of magnitude `size`.

        In discrete time of as many steps as there are in h, whatever the stamps.
        """
        if self._model.dt is not None:
            count = rounded_steps(h, self._model.dt)
            with np.errstate(over="ignore", invalid="ignore"):
                return cached_step(self._counts, count, self._counted)
        key = (h, math.frexp(size)[1])
        table = self._recent.get(key)
        if table is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
            table = self._recent[key] = shared_step(self._steps, h, size, self._built)
        return table

    @cached_property
    def jumps(self) -> tuple[Table, ...]:
        """The tables of all events."""
        return tuple(self._jump(jump) for jump in self._model.jumps)

    def _jump(self, jump: JumpModel) -> Table:
        n, width, c = self._model.n, self._model.width, jump.c
        forced = Enclosure.exactly(np.hstack([jump.inputs, c.matrix]))
        columns = np.zeros((n, 3, 1, width))
        columns[:, 0, 0, : len(c.active)] = c.matrix[:, c.active]
        units = np.arange(len(c.active))
        none, sizes = np.zeros((n, 0)), np.zeros((n, 2, 1, width))
        sizes[:, 1] = np.abs(columns[:, 0])
        return _table(
            Enclosure.exactly(jump.G), forced, Enclosure(columns, np.zeros_like(columns)),
            sizes, length=0.0, generators=(columns[:, 0, 0, units], units, none),
        )  # fmt: skip

    def _counted(self, count: int) -> Table:
        """The table of so many steps of discrete time."""
        if count == 0:
            return self._zero_step
        width, step = self._model.width, counted_step(self._model, count)
        pieces, n, r = step.pieces.mid.shape
        nothing = Enclosure.exactly(np.zeros_like(step.pieces.mid))
        columns = _padded([step.pieces, nothing, nothing], width)  # as those of a jump: F0 alone
        sizes = np.zeros((n, 2, pieces, width))
        sizes[:, 1] = columns.magnitude[:, 0]
        generators = (step.generators, np.tile(np.arange(r), pieces), np.zeros((n, r)))
        return _table(step.Phi, step.forced, columns, sizes, length=0.0, generators=generators)

    @cached_property
    def _squares(self) -> Enclosure:
        A = Enclosure.exactly(self._model.A)
        return A @ A

    def _built(self, h: float, error: float) -> Table:
        with np.errstate(over="ignore", invalid="ignore"):  # overflow shows as infinite radii
            return self._zero_step if h == 0.0 else self._flow(h, error)

    @cached_property
    def _zero_step(self) -> Table:
        """The table of a step of length zero."""
        model, width = self._model, self._model.width
        n, k = model.n, model.inputs.shape[1] + model.flow.matrix.shape[1]
        nothing = Enclosure.exactly(np.zeros((n, 3, 1, width)))
        none = (np.zeros((n, 0)), np.zeros(0, dtype=int), np.zeros((n, 0)))
        return _table(
            Enclosure.exactly(np.eye(n)), Enclosure.exactly(np.zeros((n, k))), nothing,
            np.zeros((n, 2, 1, width)), length=0.0, generators=none,
        )  # fmt: skip

    def _flow(self, h: float, error: float) -> Table:
        argument, active = self._series.norm * h, self._model.flow.active
        count = _piece_count(argument)
        is_short = count <= _SHORT_PIECES
        parts = self._short(count).parts(h, error) if is_short else self._long(h, error, count)
        length = math.nextafter((h + error) / count, math.inf)
        groups, r = _group_count(argument, count), len(active)
        generators = _generators(parts.columns.mid[..., :r], parts.sizes[..., :r], length, groups)
        return _table(
            parts.Phi, parts.forced, parts.columns, parts.sizes, length=length,
            generators=generators,
        )  # fmt: skip

    def _short(self, count: int) -> ShortSteps:
        if count not in self._short_steps:
            self._short_steps[count] = ShortSteps(self._model, self._series, count)
        return self._short_steps[count]

    def _long(self, h: float, error: float, count: int) -> StepParts:
        """The parts of a step of so many pieces, from the flow over half of one."""
        model, series = self._model, self._series
        half, half_error = 0.5 * h / count, 0.5 * error / count  # exact: powers of two
        middle, integral = series.flow(half, half_error)
        integral = integral + middle @ integral
        step = middle @ middle
        starts = powers(step, count)  # e^{A i d}
        Phi = Enclosure(starts.mid[-1], starts.rad[-1]) @ step
        b, active = model.flow, model.flow.active
        known = np.hstack([model.inputs, b.matrix])
        entering = Enclosure.exactly(b.matrix[:, active])
        ends = _side_by_side(integral @ Enclosure.exactly(known), middle @ entering)
        pushed = starts @ ends  # (count, n, known + r)
        k = known.shape[1]
        forced = _summed(Enclosure(pushed.mid[:, :, :k], pushed.rad[:, :, :k]))
        first = k - b.matrix.shape[1]
        F0 = Enclosure(pushed.mid[:, :, first + active], pushed.rad[:, :, first + active])
        FM = Enclosure(pushed.mid[:, :, k:], pushed.rad[:, :, k:])
        F1 = Enclosure.exactly(model.A) @ FM
        sizes = np.zeros((model.n, 2, count, model.width))
        of_pieces = self._sizes(starts, middle, half, half_error)
        sizes[..., : len(active)] = np.stack(of_pieces).transpose(2, 0, 1, 3)
        return StepParts(Phi, forced, _padded([F0, FM, F1], model.width), sizes)

    def _sizes(
        self, starts: Enclosure, middle: Enclosure, half: float, half_error: float
    ) -> tuple[Matrix, Matrix]:
        """(E2, E0), (pieces, n, r) each, of pieces that begin with `starts`; half: their length."""
        entering = np.abs(self._model.flow.matrix[:, self._model.flow.active])
        roundings = 4 * len(entering)
        curved = (self._squares @ (starts @ middle)).magnitude
        E2 = curved @ raised(self._series.growth(half + half_error) @ entering, roundings)
        pushed = self._series.reach(2.0 * half, 2.0 * half_error, entering)
        return raised(E2, roundings), raised(starts.magnitude @ pushed, roundings)


def _table(
    Phi: Enclosure, forced: Enclosure, columns: Enclosure, sizes: Matrix, *,
    length: float, generators: Generators,
) -> Table:  # fmt: skip
    n = len(Phi.mid)
    remainder = np.zeros((n, sizes.shape[3]))
    remainder[:, : generators[2].shape[1]] = generators[2]
    return Table(
        Phi=Phi.mid, phi_error=_with_product(Phi, n), forced=forced, columns=columns.mid,
        column_error=_with_product(columns, n), sizes=sizes, length=length,
        generators=generators[0], units=generators[1], remainder=remainder,
        cover=_cover(generators[0]),
    )  # fmt: skip


def _cover(generators: Matrix) -> Matrix | None:
    """|X^-1| of the first n generators X; None where they are fewer or dependent."""
    n = len(generators)
    square = generators[:, :n]
    if square.shape != (n, n) or not np.isfinite(square).all():
        return None
    try:
        return np.asarray(np.abs(np.linalg.inv(square)))
    except np.linalg.LinAlgError:
        return None


def _with_product(X: Enclosure, n: int) -> Matrix:
    """Error of p'X in parts of |p|: of X, and of a product of length n."""
    size = np.abs(X.mid)
    error = raised(X.rad + (n + 2) * UNIT * size, n + 4)
    return np.where((size == 0) & (X.rad == 0), 0.0, error)


def _piece_count(argument: float) -> int:
    """A power of two: lengths of pieces are exact."""
    wanted = min(max(argument / _PIECE, 1.0), _MOST_PIECES)
    return 1 << math.ceil(math.log2(wanted))


def _side_by_side(left: Enclosure, right: Enclosure) -> Enclosure:
    return Enclosure(np.hstack([left.mid, right.mid]), np.hstack([left.rad, right.rad]))


def _summed(X: Enclosure) -> Enclosure:
    """Sum over the first axis."""
    count = len(X.mid)
    rounding = count * UNIT * np.abs(X.mid).sum(axis=0)
    return Enclosure(X.mid.sum(axis=0), raised(X.rad.sum(axis=0) + rounding, 2 * count))


def _padded(parts: list[Enclosure], width: int) -> Enclosure:
    """(n, parts, pieces, width) from parts of (pieces, n, r)."""
    pieces, n, r = parts[0].mid.shape
    mid, rad = np.zeros((2, n, len(parts), pieces, width))
    for i, part in enumerate(parts):
        mid[:, i, :, :r] = part.mid.transpose(1, 0, 2)
        rad[:, i, :, :r] = part.rad.transpose(1, 0, 2)
    return Enclosure(mid, rad)


def _group_count(argument: float, count: int) -> int:
    """Pieces of the search for multipliers, a part of all; argument: ||A|| times the step."""
    return 1 if argument <= _SHORT else min(count, max(2, count // _GROUPED))


def _generators(columns: Matrix, sizes: Matrix, length: float, groups: int) -> Generators:
    """(generators, their columns, remainder (n, r)) of pieces, several of them as one.

    A piece of length d adds F0 w_mean, a deviation of at most d^2/4 |p'F1| from it and a box of
    d^3/12 E2; a box of E0 holds all of it. columns: F0, FM and F1, sizes: E2 and E0, of r columns.
    """
    n, _, count, r = columns.shape
    shape = (n, groups, count // groups, r)
    d = length * shape[2]
    mean = columns[:, 0].reshape(shape).sum(axis=2)
    slope = np.abs(columns[:, 2]).reshape(shape).mean(axis=2) * (0.25 * d * d)
    bend = sizes[:, 0].reshape(shape).max(axis=2) * (d * d * d / 12.0)
    remainder = np.fmin((slope + bend).sum(axis=1), sizes[:, 1].sum(axis=1))
    return mean.reshape(n, -1), np.tile(np.arange(r), groups), remainder
