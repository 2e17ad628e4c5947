"""From a design file to a running observer."""

from __future__ import annotations

import importlib
import os
from typing import Any

import numpy as np

from obsdesign.document import Design, jsonable, load_design, same
from obsdesign.entries import is_number
from obsdesign.equations.estimation_error import noise_box
from obsdesign.errors import InputError
from obsdesign.runtime.base import Observer

# kind -> module and class; modules are imported when they are asked for
OBSERVERS = {
    "interval": ("obsdesign.runtime.interval.observer", "IntervalObserver"),
    "luenberger": ("obsdesign.runtime.luenberger.observer", "LuenbergerObserver"),
    "impulsive": ("obsdesign.runtime.impulsive.observer", "ImpulsiveObserver"),
    "finite_time": ("obsdesign.runtime.finite_time.observer", "FiniteTimeObserver"),
    "unknown_input": ("obsdesign.runtime.unknown_input.observer", "UnknownInputObserver"),
    "impulsive_input": ("obsdesign.runtime.impulsive_input.observer", "ImpulsiveInputObserver"),
}
# rows come later, which takes a state of another shape
_WITH_LAG = ("obsdesign.runtime.unknown_input.fixed_lag", "FixedLagObserver")


def load(path: str | os.PathLike[str]) -> Observer:
    """The observer of a design file.

    InputError when the file is not a design, was changed, or is of a kind that cannot run here.
    """
    return from_design(load_design(path), str(path))


def from_design(design: Design, path: str = "design") -> Observer:
    """The observer of a design in memory."""
    if design.kind not in OBSERVERS:
        known = ", ".join(OBSERVERS)
        raise InputError(f"{path}: kind must be one of {known}; got {design.kind!r}.")
    module, name = OBSERVERS[design.kind]
    if design.gains.get("differentiator") == "fixed_lag":
        module, name = _WITH_LAG
    _same_plant(design, path)
    try:
        observer: Observer = getattr(importlib.import_module(module), name).from_gains(design.gains)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return observer


# gains that repeat an entry of the problem, and where it stands there
_REPEATED = (
    ("A", "flow", "A"), ("B", "flow", "B"), ("C", "output", "C"), ("G", "jump", "G"),
    ("E", "jump", "E"), ("noise_bound", "output", "noise_bound"), ("period", "output", "period"),
    ("dwell_time", "jump", "dwell_time"), ("dwell_jitter", "jump", "dwell_jitter"),
    ("jump_measurement", "output", "jump_measurement"), ("noise_centre", "output", "noise_bound"),
)  # fmt: skip
# the same, of one kind: elsewhere the name is a matrix of the observer
_REPEATED_BY_KIND = {"impulsive_input": (("H", "jump", "H"),)}


def _same_plant(design: Design, path: str) -> None:
    """InputError when the gains are for another plant than the one the design names."""
    for name, block, key in (*_REPEATED, *_REPEATED_BY_KIND.get(design.kind, ())):
        table = design.problem.get(block)
        stated = table.get(key) if isinstance(table, dict) else None
        if key == "noise_bound":
            stated = _noise_part(stated, name)
        given = name in design.gains or (name == "noise_centre" and stated is not None)
        if given and not same(jsonable(design.gains.get(name)), jsonable(stated)):
            if name == "dwell_time" and _is_searched_range(design, stated):
                continue
            raise InputError(
                f"{path}: gains.{name} differs from problem.{block}.{key}; `obsdesign verify` "
                "tells more. Was the file put together by hand?"
            )


def _noise_part(stated: Any, name: str) -> Any:
    """The centre or the radius of noise bounds as a problem states them; None if it has none."""
    is_pairs = isinstance(stated, list) and any(isinstance(item, list) for item in stated)
    if not is_pairs:
        return stated if name == "noise_bound" else None
    try:
        centre, radius = noise_box(stated)
    except (TypeError, ValueError):
        return None
    return radius if name == "noise_bound" else centre


def _is_searched_range(design: Design, asked: Any) -> bool:
    """Is the range of the gains one that a search for the shortest dwell time may have proved?"""
    options, found = design.problem.get("observer"), design.gains["dwell_time"]
    if not isinstance(options, dict) or options.get("objective") != "shortest_dwell":
        return False
    if np.shape(found) != (2,) or np.shape(asked) != (2,):
        return False
    if not all(is_number(end) or end == "inf" for end in asked):
        return False
    low, high = (float(end) for end in asked)
    return bool(0.0 <= found[0] <= low and found[1] == high)
