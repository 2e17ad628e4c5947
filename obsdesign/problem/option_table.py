"""The options of every kind in one table, and look-ups in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from lmi.window_memory import AUTO, Memory
from obsdesign.problem.gain_constraints import ConstrainedGains
from obsdesign.problem.options import (
    FiniteTimeOptions,
    ImpulsiveInputOptions,
    ImpulsiveOptions,
    IntervalOptions,
    LuenbergerOptions,
    SetMembershipOptions,
    UnknownInputOptions,
)
from obsdesign.problem.options_base import Options

OPTIONS_OF: Mapping[str, type[Options]] = {
    "interval": IntervalOptions,
    "set_membership": SetMembershipOptions,
    "luenberger": LuenbergerOptions,
    "impulsive": ImpulsiveOptions,
    "finite_time": FiniteTimeOptions,
    "impulsive_input": ImpulsiveInputOptions,
    "unknown_input": UnknownInputOptions,
}


# kind -> names of its options
OPTIONS: Mapping[str, tuple[str, ...]] = {
    kind: tuple(option.name for option in fields(options)) for kind, options in OPTIONS_OF.items()
}


def owners(name: str) -> list[str]:
    """Kinds that know an option."""
    return [kind for kind, options in OPTIONS.items() if name in options]


def memory_of(options: Options) -> Memory:
    """Dwell times a certificate may look at; AUTO where the problem or its kind has none."""
    return options.memory if isinstance(options, ConstrainedGains) else AUTO


def is_whole(kind: str | None, name: str) -> bool:
    """Does this option of this kind count something?"""
    declared = () if kind is None else fields(OPTIONS_OF[kind])
    return any(option.name == name and option.metadata["whole"] for option in declared)
