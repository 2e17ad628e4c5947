"""The observer kinds: which gains and options each knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from obsdesign.problem.options import OPTIONS_OF

# gain -> (rows, columns) in n states, p outputs, q unknown inputs
GAINS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "interval": {
        "L": ("n", "p"),
        "M": ("n", "p"),
        "S": ("n", "n"),
        "D0": ("n", "n"),
        "D1": ("n", "n"),
        "Gp": ("n", "n"),
        "Gn": ("n", "n"),
        "S2": ("n", "n"),
        "T": ("n", "n"),
    },
    "luenberger": {"L": ("n", "p"), "M": ("n", "p")},
    "impulsive": {},
    "finite_time": {"L": ("n", "p")},
    "impulsive_input": {"K": ("n", "p")},
    "unknown_input": {"L": ("n-q", "p-q"), "T1": ("n", "n")},
}

# kind -> names of its options
OPTIONS: Mapping[str, tuple[str, ...]] = {
    kind: tuple(option.name for option in fields(options))  # type: ignore[arg-type]
    for kind, options in OPTIONS_OF.items()
}

KINDS = tuple(GAINS)

# what `search` knows: ends of a range of dwell times, and of finite_time
DWELL_SEARCHES = ("shortest_dwell", "longest_dwell")
PERIOD_SEARCHES = ("longest_period", "shortest_window")
SEARCHES = (*DWELL_SEARCHES, *PERIOD_SEARCHES)

# changes of coordinates: their inverse is needed
INVERTIBLE = ("S", "S2", "T1")


def owners(name: str) -> list[str]:
    """Kinds that know an option."""
    return [kind for kind, options in OPTIONS.items() if name in options]
