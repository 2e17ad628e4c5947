"""The result of a search, typed; `Outcome.result` holds it as the JSON answer states it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext

from lmi.arithmetic.arrays import Entries, NewEntries
from lmi.time_budget import ended_part

# the entries of an answer where no bracket was searched for
_WITHOUT_BRACKET = ("proved", "not_proved", "not_proved_verdict", "form")


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """A bracket: the end that is proved, and the nearest one that is not.

    accuracy: relative width that is required; None where no bracket was searched for. kept: the
    other end of the range; common_P: the end that one P proves, where windows of dwell times were
    tried beyond it; open: relative width between proved and not proved; islands: ranges of constant
    dwell times beyond the bracket that contract as well; reason, witness: why the far end is not
    proved; these_gains: the witness where it concerns only gains that were searched for; form,
    gains: those of the best candidate; ended: the budget that ended the search.
    """

    proved: float | None = None
    not_proved: float | None = None
    not_proved_verdict: str | None = None
    accuracy: float | None = None
    kept: float | None = None
    common_P: float | None = None
    open: float | None = None
    islands: tuple[tuple[float, float], ...] = ()
    reason: str | None = None
    witness: Entries | None = None
    these_gains: Entries = field(default_factory=dict)
    form: str = ""
    gains: Entries = field(default_factory=dict)
    ended: Entries = field(default_factory=dict)

    def to_dict(self) -> NewEntries:
        """Entries of the answer of `search --json`."""
        names = [entry.name for entry in fields(self) if entry.name != "ended"]
        if self.accuracy is None:
            names = [name for name in names if name in _WITHOUT_BRACKET]
        elif not self.these_gains:
            names.remove("these_gains")
        body: NewEntries = {name: getattr(self, name) for name in names}
        if "islands" in body:
            body["islands"] = [list(island) for island in self.islands]
        return body | dict(self.ended)

    def inequality(self, verdict: str) -> str:
        """The bracket of a search with that verdict, its ends in digits that tell them apart."""
        proved, other, word = self.proved, self.not_proved, self.not_proved_verdict
        if proved is None:
            return f"nothing is proved ({verdict})" + (
                "" if other is None else f", {other!r} {word}"
            )
        if other is None:
            return f"{proved:.10g} proved"
        if other < proved:
            low, high = _apart(other, proved)
            return f"{low} {word} < limit ≤ {high} proved"
        low, high = _apart(proved, other)
        return f"{low} proved ≤ limit < {high} {word}"

    @staticmethod
    def from_dict(body: Entries) -> SearchResult:
        """The result of any search; entries that its kind does not state keep their defaults."""
        names = [entry.name for entry in fields(SearchResult) if entry.name in body]
        known: NewEntries = {name: body[name] for name in names}
        known["islands"] = tuple((low, high) for low, high in body.get("islands", ()))
        return SearchResult(**known | {"ended": ended_part(body)})


def _apart(low: float, high: float) -> tuple[str, str]:
    """Two ends with a digit more than tells them apart, the lower rounded down, the upper up."""
    for digits in range(3, 17):
        if f"{low:.{digits}g}" != f"{high:.{digits}g}":
            break
    ends = []
    for value, mode in ((low, ROUND_FLOOR), (high, ROUND_CEILING)):
        with localcontext(prec=digits + 1, rounding=mode):
            ends.append("inf" if math.isinf(value) else f"{+Decimal(value):f}")
    return ends[0], ends[1]
