"""Gains of an observer of modes: those of each mode, its stays, what can follow, its events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from lmi.arithmetic.arrays import Array, Entries, NewEntries
from obsdesign.equations.clocks import EventGains
from obsdesign.equations.gains import PlantGains
from obsdesign.equations.stored import Stored, matrix, text

ModeGains = TypeVar("ModeGains", bound=PlantGains)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeSpan(Stored):
    """How long a mode lasts, and what can follow.

    every: (shortest, longest) stay; next: names of the modes that can follow, joined by "+".
    """

    name: str = text()
    every: Array = matrix(2)
    next: str = text()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.every[0] <= self.every[1]:
            raise ValueError("gains.every must be a range of times.")

    @property
    def successors(self) -> tuple[str, ...]:
        """Names of the modes that can follow."""
        return tuple(self.next.split("+")) if self.next else ()


@dataclass(frozen=True)
class SwitchedGains(Generic[ModeGains]):
    """Modes in the order of the problem, with the gains of each, and events within modes.

    Gains of a mode with a map on entry have it as their jump G. spacing: least time between events
    of different names, None for none.
    """

    spans: tuple[ModeSpan, ...]
    gains: tuple[ModeGains, ...]
    events: tuple[EventGains, ...] = ()
    spacing: float | None = None

    def __post_init__(self) -> None:
        """ValueError unless modes differ in name, follow each other, and all are of one size."""
        names = [span.name for span in self.spans]
        if len(names) < 2 or len(set(names)) < len(names):
            raise ValueError("gains.modes must be two modes or more that differ in name.")
        if not all(name in names for span in self.spans for name in span.successors):
            raise ValueError("gains.modes: next must hold names of modes.")
        sizes = {(own.n, own.p, own.columns["u"]) for own in self.gains}
        if len(sizes) > 1:
            raise ValueError("gains.modes must agree in the numbers of states, outputs and inputs.")
        if any(len(event.G) != own.n for event in self.events for own in self.gains):
            raise ValueError("gains.events must have one row per state.")
        for event in self.events:
            if event.modes is not None and not set(event.modes.split("+")) <= set(names):
                raise ValueError("gains.events: modes must hold names of modes.")

    @classmethod
    def from_document(cls, entries: Entries, kind: type[ModeGains]) -> SwitchedGains[ModeGains]:
        """The gains that a design file states; ValueError if one is missing or does not fit."""
        listed = mode_entries(entries)
        return cls(
            tuple(ModeSpan.from_document(own) for own in listed),
            tuple(kind.from_document(own) for own in listed),
            tuple(EventGains.from_document(own) for own in event_entries(entries)),
            entries.get("spacing"),
        )

    def to_document(self) -> NewEntries:
        """Entries of a design file."""
        pairs = zip(self.spans, self.gains, strict=True)
        modes = [span.to_document() | own.to_document() for span, own in pairs]
        events = [event.to_document() for event in self.events]
        stated: NewEntries = {"events": events or None, "spacing": self.spacing}
        return {"modes": modes} | {name: own for name, own in stated.items() if own is not None}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the modes."""
        return tuple(span.name for span in self.spans)

    @property
    def sees_after(self) -> bool:
        """Does the sensor see the state after an event?"""
        return self.gains[0].jump_measurement == "after"

    @property
    def following(self) -> tuple[tuple[int, ...], ...]:
        """Places of the modes that can follow each."""
        return following_places(self.spans)


def following_places(spans: Sequence[ModeSpan]) -> tuple[tuple[int, ...], ...]:
    """Places of the modes that can follow each."""
    names = [span.name for span in spans]
    return tuple(tuple(names.index(name) for name in span.successors) for span in spans)


def mode_entries(entries: Entries) -> list[Entries]:
    """The tables of all modes in a design's gains; ValueError where there are none."""
    return _tables(entries, "modes")


def event_entries(entries: Entries) -> list[Entries]:
    """The tables of all events in a design's gains, maybe none; ValueError where they are none."""
    return _tables(entries, "events") if "events" in entries else []


def _tables(entries: Entries, name: str) -> list[Entries]:
    listed = entries.get(name)
    if not isinstance(listed, list | tuple) or not all(isinstance(x, Mapping) for x in listed):
        raise ValueError(f"gains.{name} must be a list of tables.")
    return list(listed)
