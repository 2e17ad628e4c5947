"""Checks of what a state file holds: finite arrays, times in order, limits of the design."""

from __future__ import annotations

import functools
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, get_type_hints

import numpy as np

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.state_marks import (
    MISSING,
    PAST,
    RADIUS,
    ROWS,
    STACKED,
    STEP,
    UNBOUNDED,
    Axes,
    Below,
)


@dataclass
class StateEntries:
    """Entries of a state as they are read: sizes and order, times and guards by their names.

    sizes: of the axes of arrays, by letter; own: of those that are not there, in a record;
    crossed: names of bounds that are not in order; is_refuted: void bounds, which may be so.
    """

    sizes: Mapping[str, int] = field(default_factory=dict)
    times: list[tuple[str, float]] = field(default_factory=list)
    guards: list[tuple[str, DwellGuard]] = field(default_factory=list)
    own: dict[str, int] = field(default_factory=dict)
    crossed: list[str] = field(default_factory=list)
    is_refuted: bool = False

    def add(self, name: str, value: Value, marks: Sequence[str]) -> Value:
        """Check one marked entry and keep its times; raise TypeError unless it fits its marks."""
        if isinstance(value, np.ndarray):
            require_finite(name, value, marks)
            self._check_array(name, value, marks)
        for mark in marks:
            if isinstance(mark, Below) and not 0 <= value < self.sizes[mark]:
                raise wrong(name, f"from 0 to below {self.sizes[mark]}", value)
        if PAST in marks:
            times = np.atleast_1d(value)
            if not (np.diff(times) >= 0).all():
                raise wrong(name, "in order", times.tolist())
            self.times += [(name, float(t)) for t in times[-1:]]
        return value

    def _check_array(self, name: str, array: Matrix, marks: Sequence[str]) -> None:
        """Raise TypeError unless an array has its axes, and no radius is negative; note its order.

        Bounds that are not in order are those of a refuted state, or wrong.
        """
        for mark in marks:
            if isinstance(mark, Axes):
                self._check_axes(name, array, mark)
        if RADIUS in marks and not (array >= 0).all():
            raise wrong(name, "at least 0", float(array.min()))
        if STACKED in marks:
            lower, upper = np.split(array * np.repeat([1.0, -1.0], len(array) // 2), 2)
        elif ROWS in marks:
            lower, upper = array
        else:
            return
        if (lower > upper).any():
            self.crossed.append(name)

    def _check_axes(self, name: str, array: Matrix, axes: Axes) -> None:
        """Raise TypeError unless an array has these axes; keep the sizes of further letters."""
        letters, known = axes.split(), {"2": 2, "2n": 2 * self.sizes.get("n", 0), **self.sizes}
        fits = len(letters) == array.ndim
        for letter, size in zip(letters, array.shape, strict=False):
            fits &= size == known.get(letter, self.own.setdefault(letter, size))
        if not fits:
            required = ", ".join(str(known.get(x, self.own.get(x, x))) for x in letters)
            raise wrong(name, f"of shape ({required})", list(array.shape))

    def check(self, t: float, own: Sequence[DwellGuard]) -> None:
        """Raise TypeError unless times are not after t and guards have limits like `own`."""
        if self.crossed and not self.is_refuted:
            raise TypeError(f"{self.crossed[0]} must have lower <= upper; got crossed bounds.")
        for name, time in self.times:
            if not time <= t:
                raise wrong(name, f"at most {t!r}, state.t", time)
        if len(self.guards) != len(own):
            raise wrong("guards", f"{len(own)} of them, one for each event", len(self.guards))
        for (name, guard), limits in zip(self.guards, own, strict=True):
            _check_guard(name, guard, limits)


def require_finite(name: str, array: np.ndarray[Value, Value], marks: Sequence[str]) -> None:
    """Raise TypeError unless the entries of an array are finite, or what its marks allow."""
    if array.dtype.kind != "f":
        return
    allowed = np.isfinite(array)
    if MISSING in marks:
        allowed |= np.isnan(array)
    if UNBOUNDED in marks:
        allowed |= np.isinf(array)
    if not allowed.all():
        required = {MISSING: "finite, or nan", UNBOUNDED: "finite, or infinite"}
        text = next((required[mark] for mark in marks if mark in required), "finite")
        raise wrong(name, text, repr(float(array[~allowed][0])))


def check_times_of_list(name: str, kind: Value, items: Sequence[Value]) -> None:
    """Raise TypeError unless times of the entries of a list are in order, and steps lie between."""
    path, steps = _time_of(kind), _marked(kind, STEP)
    if not path:
        return
    times = [functools.reduce(getattr, path, item) for item in items]
    for k, (since, now) in enumerate(itertools.pairwise(times)):
        if not -math.inf < since <= now:
            entry = ".".join(path)
            raise wrong(f"{name}[{k + 1}].{entry}", f"at least {since!r}, the one before", now)
        for h in steps:
            if (step := getattr(items[k + 1], h)) != now - since:
                raise wrong(f"{name}[{k + 1}].{h}", f"{now - since!r}, since {since!r}", step)


def _time_of(kind: Value) -> tuple[str, ...]:
    """Where a class has its time: the first `Past` that is always there, of its own or a part's."""
    if names := _marked(kind, PAST):
        return names[:1]
    for name, part in get_type_hints(kind).items():
        if isinstance(part, type) and (names := _marked(part, PAST)):
            return name, *names[:1]
    return ()


def _marked(kind: Value, mark: str) -> tuple[str, ...]:
    """Names of the floats of a class with a mark."""
    hints = get_type_hints(kind, include_extras=True)
    return tuple(name for name, hint in hints.items() if hint == Annotated[float, mark])


def wrong(name: str, required: str, arrived: Value) -> TypeError:
    """The refusal of an entry."""
    text = json.dumps(arrived, default=str)
    text = text if len(text) <= 60 else f"{text[:57]}..."
    return TypeError(f"{name} must be {required}; got {text}.")


def _check_guard(name: str, guard: DwellGuard, limits: DwellGuard) -> None:
    """Raise TypeError unless a guard has the design's limits, and a dwell time with its jump."""
    for entry in ("shortest", "longest", "jitter"):
        limit, stored = getattr(limits, entry), getattr(guard, entry)
        if stored != limit:
            raise wrong(f"{name}.{entry}", f"{limit!r}, that of the design", stored)
    if guard.last_jump is not None and not math.isfinite(guard.last_jump):
        raise wrong(f"{name}.last_jump", "finite", guard.last_jump)
    if guard.last_dwell is not None and (guard.last_jump is None or not guard.last_dwell >= 0):
        raise wrong(f"{name}.last_dwell", "not negative, before last_jump", guard.last_dwell)
