"""A candidate of synthesis: gains to be proved, and certificates that may help to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from lmi.arithmetic.arrays import Entries, EntriesByClaim, NewEntries
from lmi.solvers import Solvers, merged
from lmi.time_budget import Remark


@dataclass(frozen=True)
class Certificates:
    """Evidence by claim id, and the solvers whose results it holds."""

    evidence: dict[str, Entries] = field(default_factory=dict)
    solvers: Solvers = ()

    def joined(self, other: Certificates) -> Certificates:
        """Both; of the same claim, the other's."""
        evidence = {**self.evidence, **other.evidence}
        return Certificates(evidence, merged(self.solvers, other.solvers))


class StoredGains(Protocol):
    """Gains of a plant, or of all its modes."""

    def to_document(self) -> NewEntries:
        """Entries of a design file."""


@dataclass(frozen=True)
class Candidate:
    """One way to build the observer.

    label: the form or method; gains: what a design stores, None where floats hold none;
    certificates: by claim id, evidence that verification checks and never trusts.
    searched: window, gains, coordinates or strategy were chosen by synthesis; their refutation
    does not refute other ones, unless its witness is marked (`verification.choices`).
    cost: value of the problem's objective, None where order decides. goes_on: the next
    candidate is tried even if this one, or one before it, is proved. remarks: of the searches
    since the candidate before. solvers: those that the search for its gains called, and those whose
    results its certificates hold.
    """

    label: str
    gains: StoredGains | None
    certificates: EntriesByClaim = field(default_factory=dict)
    searched: bool = False
    cost: float | None = None
    goes_on: bool = False
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()

    def document(self) -> NewEntries:
        """The gains as a design file states them, for verification."""
        return {} if self.gains is None else self.gains.to_document()
