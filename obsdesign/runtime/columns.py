"""A record, and the estimates of it, as arrays with one row per time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import numbered
from obsdesign.runtime.bounds import Bounds

if TYPE_CHECKING:
    from obsdesign.runtime.base import Estimate

# an impulse, a jump or a violation: each kind has its own, and `Observer.event_cells` reads it
Event = Any


@dataclass(frozen=True)
class Columns:
    """t (rows,); y, u, w (rows, ...), None where a record has none; jump (rows,).

    jump (rows, events) where the plant has several events.
    NaN in y marks a missing sample. bounds: those of each row, None where it has none; mode: that
    of each row, None where it is unchanged.
    """

    t: Matrix
    y: Matrix | None
    u: Matrix | None
    w: Matrix | None
    jump: NDArray[np.bool_]
    bounds: tuple[Bounds | None, ...] | None = None
    mode: tuple[str | None, ...] | None = None

    @staticmethod
    def from_arrays(
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        bounds: Bounds | None = None,
        mode: Sequence[str | None] | None = None,
    ) -> Columns:
        """A record; ValueError without any row, and for arrays of other lengths than t."""
        times = np.asarray(t, dtype=np.float64)
        if not len(times):
            raise ValueError("at least one row is required; got none.")
        jumps = np.zeros(len(times), bool) if jump is None else np.asarray(jump, dtype=bool)
        _check_rows(jumps, times)
        y, u, w = (_table(values, times) for values in (y, u, w))
        rows = None if bounds is None else tuple(bounds.rows(len(times)))
        modes = None if mode is None else tuple(mode)
        if modes is not None:
            _check_rows(np.array(modes, dtype=object), times)
        return Columns(times, y, u, w, jumps, rows, modes)

    @property
    def happens(self) -> list[bool]:
        """Does a jump happen at the row?"""
        happens: list[bool] = np.atleast_1d(self.jump.reshape(len(self.t), -1).any(axis=1)).tolist()
        return happens

    @property
    def events(self) -> list[tuple[int, ...]]:
        """Places of the events of each row, where the plant has several."""
        if self.jump.ndim == 1:
            return [()] * len(self.t)
        return [tuple(np.flatnonzero(row).tolist()) for row in self.jump]


@dataclass(frozen=True)
class Batch:
    """Estimates of a whole record as arrays of shape (rows,) and (rows, n)."""

    t: Matrix
    x: Matrix | None
    lower: Matrix | None
    upper: Matrix | None
    d: Matrix | None
    status: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()  # of all rows, in order
    directions: Matrix | None = None  # (rows, 2, r)
    lagged: Matrix | None = None  # (rows, 2, n)
    d_bounds: Matrix | None = None  # (rows, 2, q)


_STACKED = ("x", "lower", "upper", "d", "directions", "lagged", "d_bounds")


def axis_sizes(n: int, reads: Mapping[str, int | bool]) -> dict[str, int]:
    """Sizes of axes: n states, p outputs, m known inputs, and y of a row."""
    p, m = int(reads["y"]), int(reads["u"])
    return {"n": n, "p": p, "m": m, "y": p}


def collect(estimates: Iterable[Estimate]) -> Batch:
    """Stack estimates row by row."""
    rows = list(estimates)

    def stacked(name: str) -> Matrix | None:
        values = [getattr(row, name) for row in rows]
        return None if not values or values[0] is None else np.array(values)

    columns = {name: stacked(name) for name in _STACKED}
    return Batch(
        np.array([row.t for row in rows]), **columns, status=tuple(r.status for r in rows),
        events=tuple(event for row in rows for event in row.events),
    )  # fmt: skip


def named_columns(letter: str, values: Matrix) -> dict[str, Matrix]:
    """The columns of a signal's values (rows, k), under the names that files give them."""
    return dict(zip(numbered(letter, values.shape[1]), values.T, strict=True))


def _table(values: ArrayLike | None, times: Matrix) -> Matrix | None:
    if values is None:
        return None
    array = np.asarray(values, dtype=np.float64)
    _check_rows(array, times)
    return array.reshape(len(times), -1)


def _check_rows(array: Matrix | NDArray[np.bool_], times: Matrix) -> None:
    if len(array) != len(times):
        raise ValueError(f"every array must have {len(times)} rows, as t has; got {len(array)}.")
