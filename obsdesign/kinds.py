"""The observer kinds: one literal table for every layer.

A kind has a folder of its own in each layer, with one file name per role. Modules are named here
and imported where they are used, so that a command loads the kinds that it needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

from obsdesign.errors import InputError

Role = Literal["candidates", "claims", "guarantees", "observer"]

# role -> the layer it is played in
LAYERS: Mapping[Role, str] = {
    "candidates": "synthesis",
    "claims": "verification",
    "guarantees": "verification",
    "observer": "runtime",
}


@dataclass(frozen=True)
class WithModes:
    """How a kind takes modes, in modules `modes` of synthesis, verification and run time.

    observer: its class there; options: those that are about each mode alike.
    """

    observer: str
    options: tuple[str, ...]


@dataclass(frozen=True)
class Kind:
    """A kind of observer.

    observer: its class in the module of that role; gains: those that a problem may give, name ->
    (rows, columns) in n states, p outputs, q unknown inputs; modes: None where it takes none.
    """

    name: str
    observer: str
    gains: Mapping[str, tuple[str, str]]
    modes: WithModes | None = None

    def module(self, role: Role, *, has_modes: bool = False) -> str:
        """Name of the module that plays a role; has_modes: for plants with modes."""
        return f"obsdesign.{LAYERS[role]}.{self.name}.{'modes' if has_modes else role}"


_TABLE = (
    Kind(
        "interval",
        "IntervalObserver",
        {
            "L": ("n", "p"),
            "M": ("n", "p"),
            "S": ("n", "n"),
            "D0": ("n", "n"),
            "D1": ("n", "n"),
            "Gp": ("n", "n"),
            "Gn": ("n", "n"),
            "S2": ("n", "n"),
            "T": ("n", "n"),
            "R": ("n", "n"),
        },
        WithModes("SwitchedIntervalObserver", options=("form",)),
    ),
    Kind("set_membership", "SetMembershipObserver", {}),
    Kind(
        "luenberger",
        "LuenbergerObserver",
        {"L": ("n", "p"), "M": ("n", "p")},
        WithModes("SwitchedPointObserver", options=("decay_rate",)),
    ),
    Kind("impulsive", "ImpulsiveObserver", {}),
    Kind("finite_time", "FiniteTimeObserver", {"L": ("n", "p")}),
    Kind("impulsive_input", "ImpulsiveInputObserver", {"K": ("n", "p")}),
    Kind("unknown_input", "UnknownInputObserver", {"L": ("n-q", "p-q"), "T1": ("n", "n")}),
)

KINDS = tuple(kind.name for kind in _TABLE)
GAINS: Mapping[str, Mapping[str, tuple[str, str]]] = {kind.name: kind.gains for kind in _TABLE}

# kinds that give bounds: they start from bounds of the state
GIVING_BOUNDS = ("interval", "set_membership")
# kinds that take several events and sensors, each on a clock of its own, and which of them have
# gains for each by its name
TAKING_CLOCKS = ("interval", "set_membership")
WITH_NAMED_GAINS = ("interval",)
TAKING_MODES = tuple(kind.name for kind in _TABLE if kind.modes is not None)
# kinds that take plants in discrete time
TAKING_DISCRETE_TIME = (
    "interval", "set_membership", "luenberger", "finite_time", "unknown_input",
)  # fmt: skip
# kinds that take events whose time stamps have an error
TAKING_TIME_ERRORS = ("interval",)
# kinds that take parameters known up to a range
TAKING_PARAMETERS = ("interval", "luenberger", "set_membership")

# what `search` knows: ends of a range of dwell times, of finite_time, errors of time stamps,
# ranges of parameters
DWELL_SEARCHES = ("shortest_dwell", "longest_dwell")
PERIOD_SEARCHES = ("longest_period", "shortest_window")
LARGEST_TIME_ERROR = "largest_time_error"
LARGEST_UNCERTAINTY = "largest_uncertainty"
SEARCHES = (*DWELL_SEARCHES, *PERIOD_SEARCHES, LARGEST_TIME_ERROR, LARGEST_UNCERTAINTY)


def kind_named(name: str) -> Kind:
    """The kind of that name; InputError where there is none."""
    for kind in _TABLE:
        if kind.name == name:
            return kind
    near = get_close_matches(name, KINDS, 1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise InputError(f"kind must be one of {', '.join(KINDS)}; got {name!r}.{hint}")
