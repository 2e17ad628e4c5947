"""Witnesses that are read again, where another choice of gains may avoid them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

from lmi.arithmetic.arrays import Entries, NewEntries

Age = float | list[float]  # or the ends of a bracket of it


@dataclass(frozen=True)
class Witness:
    """Entries of a witness by name; the sentence `reason` comes last in a document."""

    @classmethod
    def from_evidence(cls, evidence: Entries) -> Self | None:
        """The witness of this kind in the evidence of a claim; None if it is another or none."""
        witness = evidence.get("witness", {})
        names = [entry.name for entry in fields(cls)]
        if not all(name in witness for name in names):
            return None
        return cls(**{name: witness[name] for name in names})

    def to_dict(self) -> NewEntries:
        """Entries of the witness in the evidence of a claim."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


@dataclass(frozen=True)
class TooFewSamples(Witness):
    """The samples of a window are fewer than an impulse needs, whatever the plant."""

    samples: int
    reason: str


@dataclass(frozen=True)
class TooFewFeatures(Witness):
    """There are fewer features than states."""

    features: int
    states: int
    reason: str


@dataclass(frozen=True)
class EqualFeatures(Witness):
    """Two ages, or brackets of ages, and weights whose impulses leave the same features."""

    ages: Sequence[Age]
    weights: Sequence[float]
    reason: str
