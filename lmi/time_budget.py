"""Time budgets: values that every search is given, and the remarks that it returns.

budget = TimeBudget.from_seconds(60.0)   # ends after 60 s of processor time
for attempt in budget.attempts():        # own limits 1, then 4, 16, ... times as large
    ...                                  # search(problem, attempt)

A search's own limits are counted in work (iterations, evaluations, windows, boxes), so that every
machine comes to the same result; time ends a search only where a total is stated. `ended` is the
evidence of it. A proof of stored numbers ends early only with the total, undecided.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

from lmi.arithmetic.arrays import Entries, NewEntries

# own limits of the next attempt, relative to those of the last
_STRETCH = 4.0
_LARGEST_FACTOR = 1e9


@dataclass(frozen=True)
class TimeBudget:
    """A total, `seconds` long, that ends at `end` (process time), and the factor of own limits."""

    seconds: float = math.inf
    end: float = math.inf
    factor: float = 1.0

    @staticmethod
    def from_seconds(seconds: float | None) -> TimeBudget:
        """A total of so many seconds of processor time from now on; None: unlimited.

        ValueError unless seconds > 0.
        """
        if seconds is None:
            return UNLIMITED
        if not seconds > 0:
            raise ValueError(f"a budget must be a positive number of seconds; got {seconds!r}")
        return TimeBudget(seconds, time.process_time() + seconds)

    def stretched(self, factor: float) -> TimeBudget:
        """The same total, with own limits of searches `factor` times as large."""
        return replace(self, factor=factor)

    def attempts(self) -> Iterator[TimeBudget]:
        """Yield this budget, and while its total lasts ever more stretched ones."""
        budget = self
        yield budget
        while 0 < budget.remaining() < math.inf:
            budget = budget.stretched(_STRETCH * budget.factor)
            yield budget

    def part(self, share: float) -> TimeBudget:
        """A budget that ends after this share of what is left: the other is for what follows."""
        left = max(self.remaining(), 0.0)
        return self if math.isinf(left) else replace(self, end=self.end - (1 - share) * left)

    def remaining(self) -> float:
        """Seconds of processor time that are left; negative when the total has ended."""
        return self.end - time.process_time()

    def scaled(self, count: int) -> int:
        """A search's own limit, stretched."""
        return int(count * min(self.factor, _LARGEST_FACTOR))

    def ended(self) -> NewEntries:
        """Evidence that time ended a search: {"ended_by": "time", "seconds"}; {} if it did not."""
        return {"ended_by": "time", "seconds": self.seconds} if self.remaining() < 0 else {}


UNLIMITED = TimeBudget()
# entries of evidence that a budget ended a search: the unit of its limit, the limit
_ENDED = ("ended_by", "seconds", "limit")


@dataclass(frozen=True)
class Remark:
    """A sentence for the caller; or a search that a budget ended, with the evidence of `ended`.

    matters: is a better answer worth a longer search once there is one that is proved?
    """

    text: str
    search: str = ""
    evidence: Entries = field(default_factory=dict)
    matters: bool = True


def remark_end(search: str, evidence: Entries, *, matters: bool = True) -> tuple[Remark, ...]:
    """Return the remark that a budget ended a search; none where the evidence is empty."""
    if not evidence:
        return ()
    text = f"the search of {search} {ending(evidence)}; a longer --time might find better"
    return (Remark(text, search, evidence, matters),)


def sentences(remarks: Iterable[Remark]) -> list[str]:
    """Texts of remarks; of a search that was ended several times the last."""
    return [entry.text for entry in {item.search or item.text: item for item in remarks}.values()]


def last_end(remarks: Iterable[Remark]) -> Entries:
    """Evidence of the last search that a budget ended; {} where none was."""
    return next((entry.evidence for entry in reversed([*remarks]) if entry.evidence), {})


def ended_by_count(unit: str, limit: int) -> NewEntries:
    """Evidence that a search was ended by a number of "windows" or "evaluations", from `scaled`."""
    return {"ended_by": unit, "limit": limit}


def ended_part(evidence: Entries) -> NewEntries:
    """The entries of `ended` or `ended_by_count` in some evidence; {} if it has none."""
    return {name: evidence[name] for name in _ENDED if "ended_by" in evidence and name in evidence}


def ending(evidence: Entries) -> str:
    """Return "ended after 3 s", from the evidence of `ended` or `ended_by_count`."""
    unit, seconds, limit = (evidence.get(name) for name in _ENDED)
    return f"ended after {seconds:.6g} s" if unit == "time" else f"ended after {limit} {unit}"
