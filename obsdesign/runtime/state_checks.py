"""Checks of what a state file holds: finite arrays, times in order, limits of the design."""

from __future__ import annotations

import functools
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, get_type_hints

import numpy as np

from lmi.arithmetic.arrays import Value
from obsdesign.runtime.dwell_guard import DwellGuard
from obsdesign.runtime.state_marks import MISSING, PAST, STEP, UNBOUNDED


@dataclass
class StateEntries:
    """Times and guards of a state by their names, as they are read."""

    times: list[tuple[str, float]] = field(default_factory=list)
    guards: list[tuple[str, DwellGuard]] = field(default_factory=list)

    def add(self, name: str, value: Value, marks: Sequence[str]) -> Value:
        """Check one marked entry and keep its times; raise TypeError unless it fits its marks."""
        if isinstance(value, np.ndarray):
            require_finite(name, value, marks)
        if PAST in marks:
            times = np.atleast_1d(value)
            if not (np.diff(times) >= 0).all():
                raise wrong(name, "in order", times.tolist())
            self.times += [(name, float(t)) for t in times[-1:]]
        return value

    def check(self, t: float, own: Sequence[DwellGuard]) -> None:
        """Raise TypeError unless times are not after t and guards have limits like `own`."""
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


def check_course(name: str, kind: Value, items: Sequence[Value]) -> None:
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
    if guard.last_dwell is not None and (guard.last_jump is None or not guard.last_dwell > 0):
        raise wrong(f"{name}.last_dwell", "positive, before last_jump", guard.last_dwell)
