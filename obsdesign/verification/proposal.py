"""Certificates by the names of their entries, before any of them is checked."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

from lmi.arithmetic.arrays import Array, Entries, Matrix, floats
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
            value = floats(proposed[name])
            result.append(exact(value))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
        if value.shape != (n,):
            return None
    return tuple(result)


def matrix_of(values: object, n: int) -> Matrix | None:
    """A matrix of a certificate as floats, (n, n); None if it is not one."""
    P = numbers_of(values)
    return P if P is not None and P.shape == (n, n) else None


def numbers_of(values: object) -> Matrix | None:
    """Numbers of a certificate as floats, of any shape; None if something else stands there."""
    try:
        return floats(values)
    except (TypeError, ValueError, OverflowError):
        return None
