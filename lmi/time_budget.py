"""Budgets of searches in seconds of processor time: their own, and a total for all of them.

with total_budget(60.0):             # every search in here ends after 60 s of processor time in all
    for factor in stretch_factors():     # 1, then 4, 16, ... while the total lasts
        with stretched(factor):
            ...                      # own budgets are so many times as long

with collect_remarks() as remarks:
    ...              # searches that ended early or settled for less

A search asks `deadline(its own budget)` for the moment to stop at; `ended` is the evidence that it
had to. A proof of stored numbers has no budget of its own: it ends early only inside of
`total_budget`, undecided.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Any

# own budgets of the next attempt, relative to those of the last
_STRETCH = 4.0


@dataclass(frozen=True)
class _Budget:
    """seconds: of the total, which ends at `end` (process time); factor: of own budgets."""

    seconds: float = math.inf
    end: float = math.inf
    factor: float = 1.0


@dataclass(frozen=True)
class Remark:
    """A sentence for the caller; or a search that a budget ended, with the evidence of `ended`.

    matters: is a better answer worth a longer search once there is one that is proved?
    """

    text: str
    search: str = ""
    evidence: Mapping[str, Any] = field(default_factory=dict)
    matters: bool = True


_UNLIMITED = _Budget()
_BUDGET: ContextVar[_Budget] = ContextVar("budget", default=_UNLIMITED)
_REMARKS: ContextVar[list[Remark] | None] = ContextVar("remarks", default=None)


@contextmanager
def collect_remarks() -> Iterator[list[Remark]]:
    """What searches in here remark: that one ended early, or had to settle for less."""
    remarks: list[Remark] = []
    token = _REMARKS.set(remarks)
    try:
        yield remarks
    finally:
        _REMARKS.reset(token)


def remark(text: str) -> None:
    """Hand one sentence to the caller, once; nobody may be listening."""
    remarks, entry = _REMARKS.get(), Remark(text)
    if remarks is not None and entry not in remarks:
        remarks.append(entry)


def remark_end(search: str, evidence: Mapping[str, Any], *, matters: bool = True) -> None:
    """Remark that a budget ended a search; nothing where the evidence is empty."""
    remarks = _REMARKS.get()
    if evidence and remarks is not None:
        text = f"the search of {search} {ending(evidence)}; a longer --time might find better"
        remarks.append(Remark(text, search, evidence, matters))


def sentences(remarks: Iterable[Remark]) -> list[str]:
    """Texts of remarks; of a search that was ended several times the last."""
    return [entry.text for entry in {one.search or one.text: one for one in remarks}.values()]


@contextmanager
def _budget(budget: _Budget) -> Iterator[None]:
    token = _BUDGET.set(budget)
    try:
        yield
    finally:
        _BUDGET.reset(token)


@contextmanager
def total_budget(seconds: float | None) -> Iterator[None]:
    """Bound all searches in here together, in seconds of processor time; nested, the least.

    None: no bound. ValueError unless seconds > 0.
    """
    if seconds is not None and not seconds > 0:
        raise ValueError(f"a budget must be a positive number of seconds; got {seconds!r}")
    budget = _BUDGET.get()
    end = math.inf if seconds is None else time.process_time() + seconds
    if seconds is not None and end < budget.end:
        budget = replace(budget, seconds=seconds, end=end)
    with _budget(budget):
        yield


@contextmanager
def stretched(factor: float) -> Iterator[None]:
    """Multiply the searches' own budgets by `factor`."""
    with _budget(replace(_BUDGET.get(), factor=factor)):
        yield


def stretch_factors() -> Iterator[float]:
    """1, and while a total is stated and lasts, ever larger factors of own budgets."""
    factor = 1.0
    yield factor
    while 0 < remaining() < math.inf:
        factor *= _STRETCH
        yield factor


def deadline(seconds: float) -> float:
    """`time.process_time()` at which a search with this budget of its own has to stop."""
    budget = _BUDGET.get()
    return min(time.process_time() + budget.factor * seconds, budget.end)


def remaining(seconds: float = math.inf) -> float:
    """What remains of a budget that starts now; negative when the total has ended."""
    return deadline(seconds) - time.process_time()


def scaled(count: int) -> int:
    """A search's own limit of evaluations or windows, as many times as its seconds."""
    return int(count * min(_BUDGET.get().factor, 1e9))


def ended(end: float = math.inf, seconds: float = math.inf) -> dict[str, Any]:
    """Evidence that time ended a search: {"ended_by": "time", "seconds": its budget}; {} if not.

    end: moment at which it had to stop, from `deadline(seconds)`; by default that of the total.
    """
    budget, now = _BUDGET.get(), time.process_time()
    if now > budget.end:
        return {"ended_by": "time", "seconds": budget.seconds}
    return {"ended_by": "time", "seconds": budget.factor * seconds} if now > end else {}


def ended_by_count(unit: str, limit: int) -> dict[str, Any]:
    """Evidence that a search was ended by a number of "windows" or "evaluations", from `scaled`."""
    return {"ended_by": unit, "limit": limit}


def ended_part(evidence: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `ended` or `ended_by_count` in some evidence; {} if it has none."""
    return {name: evidence[name] for name in ("ended_by", "seconds", "limit")
            if "ended_by" in evidence and name in evidence}  # fmt: skip


def ending(evidence: Mapping[str, Any]) -> str:
    """Return "ended after 3 s", from the evidence of `ended` or `ended_by_count`."""
    if evidence["ended_by"] == "time":
        return f"ended after {evidence['seconds']:.6g} s"
    return f"ended after {evidence['limit']} {evidence['ended_by']}"
