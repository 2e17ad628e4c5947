"""What synthesis hands over: gains to be proved, and certificates that may help to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from obsdesign.equations.gains import Gains


@dataclass(frozen=True)
class Candidate:
    """One way to build the observer.

    label: the form or method; gains: what a design stores; certificates: by claim
    id, what the finder believes shows it (a matrix P, say). Verification trusts none of it.
    searched: window, gains, coordinates or strategy were chosen, so that their failure says nothing
    of other ones, unless a witness says that it does (`verification.choices`).
    cost: what the problem's objective makes of it, None where order decides. goes_on: the next
    candidate is worth a look even if this one, or one before it, is proved.
    """

    label: str
    gains: Gains | Mapping[str, Any]
    certificates: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    searched: bool = False
    cost: float | None = None
    goes_on: bool = False

    def document(self) -> dict[str, Any]:
        """The gains as a design file states them: what verification gets to see."""
        gains = self.gains
        return gains.to_document() if isinstance(gains, Gains) else dict(gains)
