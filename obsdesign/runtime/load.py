"""From a design file to a running observer."""

from __future__ import annotations

import importlib
import os

from obsdesign.document import Design, load_design
from obsdesign.errors import InputError
from obsdesign.runtime.base import Observer

# kind -> module and class; modules are imported when they are asked for
OBSERVERS = {
    "interval": ("obsdesign.runtime.interval", "IntervalObserver"),
    "luenberger": ("obsdesign.runtime.luenberger", "LuenbergerObserver"),
}


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
    try:
        observer: Observer = getattr(importlib.import_module(module), name).from_gains(design.gains)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return observer
