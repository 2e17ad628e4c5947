"""Certificates by the names of their entries, before any of them is checked."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

from lmi.arithmetic.arrays import Entries


@dataclass(frozen=True)
class Proposal:
    """What a search proposes for a claim; None where a certificate does not state a field.

    Derived classes name the entries; whatever else a certificate holds is not read.
    """

    @classmethod
    def from_document(cls, entries: Entries) -> Self:
        """From a certificate, or from the evidence of the claim it was made for."""
        return cls(**{one.name: entries.get(one.name) for one in fields(cls)})
