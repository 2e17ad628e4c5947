"""What an interval observer keeps of events at uncertain times."""

from __future__ import annotations

from typing import NamedTuple

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.interval.curves import Spread
from obsdesign.runtime.interval.several_clocks import ClockedState
from obsdesign.runtime.state_marks import Bounded


class Window(NamedTuple):
    """An event that may happen from `since` until `until`.

    stamp: its time stamp; w: its known inputs; start: box of the state at `since`, before it; u:
    input that has held since then, None where it changed.
    """

    event: int
    stamp: float
    since: float
    until: float
    w: Matrix
    start: Bounded
    u: Matrix | None


class Branch(NamedTuple):
    """A box of the states where some of the windows' events have happened, a bit for each."""

    happened: int
    box: Bounded


class Known(NamedTuple):
    """An event whose window was opened before its own row."""

    event: int
    stamp: float


class UncertainState(NamedTuple):
    """The state of an observer with events at uncertain times.

    clocked: as without them, its box what is reported; spread: a second set that contains the
    state, as if events of open windows had not happened; None where no event was; windows: those
    that are open; branches: boxes by which of their events have happened, none without windows;
    known: events whose windows were opened, up to their own rows.
    """

    clocked: ClockedState
    spread: Spread | None = None
    windows: tuple[Window, ...] = ()
    branches: tuple[Branch, ...] = ()
    known: tuple[Known, ...] = ()

    @property
    def t(self) -> float:
        """Time of the last row."""
        return self.clocked.t

    @property
    def guards(self) -> tuple[DwellGuard, ...]:
        """Of every event."""
        return self.clocked.guards
