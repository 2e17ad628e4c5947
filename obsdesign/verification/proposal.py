"""Certificates by the names of their entries, before any of them is checked."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Array, Entries
from lmi.arithmetic.balls import exact


@dataclass(frozen=True)
class Proposal:
    """What a search proposes for a claim; None where a certificate does not state a field.

    Derived classes name the entries; whatever else a certificate holds is not read.
    """

    @classmethod
    def from_document(cls, entries: Entries) -> Self:
        """From a certificate, or from the evidence of the claim it was made for."""
        return cls(**{one.name: entries.get(one.name) for one in fields(cls)})


def vectors(proposed: Entries, names: tuple[str, ...], n: int) -> tuple[Array, ...] | None:
    """The proposed vectors, exact; None if one is missing, or not a finite vector."""
    result = []
    for name in names:
        try:
            value = np.asarray(proposed[name], dtype=np.float64)
            result.append(exact(value))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        if value.shape != (n,):
            return None
    return tuple(result)
