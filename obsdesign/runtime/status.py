"""The status of a row: `ok`, or the reasons why its guarantee does not hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from lmi.arithmetic.arrays import Matrix

OK = "ok"
# of rows after one that refutes the bounds, or that voids the bound of an error
VOID, VOID_ERROR = "bounds void", "error bound void"
# how reasons begin that have the time of a row before
VOID_SINCE = "void since time"
# between the reasons of a status
_BETWEEN = "; "


class Reason(str):
    """Why the guarantee of a row does not hold: a text without commas and semicolons.

    kind: what such reasons have in common, whatever the numbers of the row; number: by how much or
    when, None where the kind says everything.
    """

    __slots__ = ("kind", "number")
    kind: str
    number: float | None

    def __new__(cls, text: str, kind: str | None = None, number: float | None = None) -> Self:
        """A reason; a text alone is its own kind."""
        reason = super().__new__(cls, text)
        reason.kind = text if kind is None else kind
        reason.number = number
        return reason

    @classmethod
    def measured(cls, quantity: str, number: float, finding: str) -> Self:
        """A quantity of the row with a finding on it: ("step", 2.5, "above 1")."""
        return cls(f"{quantity} {number:.9g} {finding}", f"{quantity} {finding}", number)

    def of_clock(self, name: str) -> Reason:
        """The reason with the name of the event or sensor that it is about."""
        return Reason(f"{name}: {self}", f"{name}: {self.kind}", self.number)


# of a row without a sample that was due
MISSING_SAMPLE = Reason("missing sample")
# of a row with a sample that no period ends at
OFF_PERIOD = Reason("sample off the period is not used")
# of a row of discrete time without an event that was due
MISSING_EVENT = Reason("missing event")
NOT_FINITE = Reason("estimate is not finite")


class Status(str):
    """A status that is not `ok`: the text of its reasons."""

    __slots__ = ("reasons",)
    reasons: tuple[Reason, ...]

    def __new__(cls, reasons: Sequence[str]) -> Self:
        """The status of several reasons; each may be a status itself."""
        status = super().__new__(cls, _BETWEEN.join(reasons))
        status.reasons = tuple(each for reason in reasons for each in reasons_of(reason))
        return status

    def __getnewargs__(self) -> tuple[tuple[Reason, ...]]:  # type: ignore[override]
        """What a copy is made of."""
        return (self.reasons,)


def reasons_of(status: str) -> tuple[Reason, ...]:
    """The reasons of a status or of a text that is one reason; none of `ok`."""
    if isinstance(status, Status):
        return status.reasons
    if isinstance(status, Reason):
        return (status,)
    return () if status == OK else (Reason(status),)


def status_of(reasons: Sequence[str], *values: Matrix) -> str:
    """`ok`, or the reasons why not; an estimate that is not finite is one."""
    if not all(np.isfinite(value).all() for value in values):
        reasons = [*reasons, NOT_FINITE]
    return with_reasons(OK, reasons)


def with_reasons(status: str, reasons: Sequence[str]) -> str:
    """A status with further reasons why not: `ok` without any."""
    if not reasons:
        return status
    return Status(reasons if status == OK else [status, *reasons])


def late_sample(apart: float, longest: float) -> Reason:
    """Reason of a row that comes `apart` after the last sample, and not within `longest`."""
    return Reason.measured("time", apart, f"since the last sample exceeds {longest:.9g}")


def void_since(t: float, cause: str) -> Reason:
    """Reason of all rows after the one at t, in which the bounds were refuted."""
    return still_void(f"{VOID_SINCE} {t:.9g} ({cause})")


def still_void(text: str, kind: str = VOID) -> Reason:
    """The reason of a state's refutation, whose text it keeps."""
    return Reason(text, kind)
