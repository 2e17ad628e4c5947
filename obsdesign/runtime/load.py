"""From a design file to a running observer."""

from __future__ import annotations

import importlib
import os
from typing import Protocol, cast

from lmi.arithmetic.arrays import Entries
from obsdesign.design_file import load_design
from obsdesign.document import Design
from obsdesign.errors import InputError, naming
from obsdesign.kinds import kind_named
from obsdesign.runtime.base import Observer
from obsdesign.runtime.stated_plant import refuse_other_plant


class RunnableKind(Protocol):
    """The class of a kind's observers."""

    def from_gains(self, gains: Entries, /) -> Observer:
        """The observer of a design's gains; ValueError where they are not such gains."""


# kinds whose observer in discrete time is one of its own
_IN_STEPS = {
    "luenberger": "StepObserver", "finite_time": "StepWindowObserver",
    "unknown_input": "StepInputObserver",
}  # fmt: skip


def observer_class(kind: str, gains: Entries) -> RunnableKind:
    """The class that runs gains of a kind; InputError for what is no kind."""
    known = kind_named(kind)
    if "modes" in gains:
        if known.modes is None:
            raise InputError(f"gains.modes: kind {kind!r} has no modes.")
        return _class_of(known.module("observer", has_modes=True), known.modes.observer)
    if gains.get("differentiator") == "fixed_lag":
        # rows come later, which takes a state of another shape
        from obsdesign.runtime.unknown_input.fixed_lag import FixedLagObserver

        return FixedLagObserver
    if kind == "interval" and "sensors" in gains:
        from obsdesign.runtime.interval.several_clocks import ClockedIntervalObserver

        if any("time_error" in event for event in gains.get("events", ())):
            from obsdesign.runtime.interval.uncertain_times import UncertainTimesObserver

            return UncertainTimesObserver
        return ClockedIntervalObserver
    if "dt" in gains and kind in _IN_STEPS:
        module = importlib.import_module(f"obsdesign.runtime.{kind}.discrete_time")
        return cast(RunnableKind, vars(module)[_IN_STEPS[kind]])
    if known.name == "set_membership" and "d_rate" in gains:
        from obsdesign.runtime.set_membership.input_bounds import InputBoundsObserver

        return InputBoundsObserver
    if known.name == "set_membership" and "effects" in gains:
        from obsdesign.runtime.set_membership.uncertain_observer import (
            UncertainSetMembershipObserver,
        )

        return UncertainSetMembershipObserver
    return _class_of(known.module("observer"), known.observer)


def _class_of(module: str, name: str) -> RunnableKind:
    """A class of observers by its name."""
    return cast(RunnableKind, vars(importlib.import_module(module))[name])


def load(path: str | os.PathLike[str]) -> Observer:
    """The observer of a design file.

    InputError when the file is not a design, was changed, or is of a kind that cannot run here.
    """
    return from_design(load_design(path), str(path))


def from_design(design: Design, path: str = "design") -> Observer:
    """The observer of a design in memory; path: what an InputError begins with.

    InputError where gains do not fit each other or are not those of the problem's plant.
    """
    with naming(path):
        runnable = observer_class(design.kind, design.gains)
        refuse_other_plant(design)
    with naming(path, ValueError):
        return runnable.from_gains(design.gains)
