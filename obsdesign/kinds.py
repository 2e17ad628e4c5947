"""The observer kinds: one literal table for every layer.

A kind has a folder of its own in each layer, with one file name per role. Modules are named here
and imported where they are used, so that a command loads the kinds that it needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
class Kind:
    """A kind of observer.

    observer: its class in the module of that role; gains: those that a problem may give, name ->
    (rows, columns) in n states, p outputs, q unknown inputs.
    """

    name: str
    observer: str
    gains: Mapping[str, tuple[str, str]]

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
    ),
    Kind("set_membership", "SetMembershipObserver", {}),
    Kind("luenberger", "LuenbergerObserver", {"L": ("n", "p"), "M": ("n", "p")}),
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
# kinds that take modes: each has modules `modes` in synthesis and verification
TAKING_MODES = ("interval", "luenberger")
# kinds that take plants in discrete time
TAKING_DISCRETE_TIME = (
    "interval", "set_membership", "luenberger", "finite_time", "unknown_input",
)  # fmt: skip

# what `search` knows: ends of a range of dwell times, and of finite_time
DWELL_SEARCHES = ("shortest_dwell", "longest_dwell")
PERIOD_SEARCHES = ("longest_period", "shortest_window")
SEARCHES = (*DWELL_SEARCHES, *PERIOD_SEARCHES)


def kind_named(name: str) -> Kind:
    """The kind of that name; InputError where there is none."""
    for kind in _TABLE:
        if kind.name == name:
            return kind
    raise InputError(f"kind must be one of {', '.join(KINDS)}; got {name!r}.")
