"""How long searches may take: their own budgets, and what whoever asks has the patience for.

with at_most(0.5):
    ...              # every search in here ends after half a second of processor time, undecided

with listening() as remarks:
    ...              # sentences of searches that ended early or settled for less

A search asks `until(its own budget)` for the moment to stop at, and who finds more than was asked
for, the better of two answers or how good one is, asks `hurried()` first. A proof of stored numbers
has no budget of its own: it ends early only inside of `at_most`, undecided.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_END: ContextVar[float] = ContextVar("end", default=math.inf)
_HEARD: ContextVar[list[str] | None] = ContextVar("heard", default=None)


@contextmanager
def listening() -> Iterator[list[str]]:
    """What searches in here remark: that one ended early, or had to settle for less."""
    heard: list[str] = []
    token = _HEARD.set(heard)
    try:
        yield heard
    finally:
        _HEARD.reset(token)


def remark(text: str) -> None:
    """One sentence for whoever asked, said once; nobody may be listening."""
    heard = _HEARD.get()
    if heard is not None and text not in heard:
        heard.append(text)


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """No search in here goes on for longer, in seconds of processor time; nested, the least."""
    token = _END.set(until(seconds))
    try:
        yield
    finally:
        _END.reset(token)


def hurried() -> bool:
    """Does anybody wait? Then only what decides is worth doing: whether, and not how well."""
    return _END.get() < math.inf


def until(seconds: float) -> float:
    """`time.process_time()` at which a search with this budget has to stop."""
    return min(time.process_time() + seconds, _END.get())


def left(seconds: float = math.inf) -> float:
    """What remains of a budget that starts now; negative when patience has ended."""
    return until(seconds) - time.process_time()
