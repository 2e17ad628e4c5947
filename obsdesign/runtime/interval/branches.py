"""Boxes of states by which of the events whose windows are open have happened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure
from obsdesign.equations.interval.uncertain_jump import is_short, parts_of
from obsdesign.runtime.boxes import BoundsFault
from obsdesign.runtime.interval.curves import Spread, plus
from obsdesign.runtime.interval.kernel import crossed
from obsdesign.runtime.interval.several_clocks import ClockedState, Cut, Measured
from obsdesign.runtime.interval.uncertain_state import Branch, Known, UncertainState, Window

if TYPE_CHECKING:
    from obsdesign.runtime.interval.uncertain_times import UncertainTimesObserver

# windows that are open at once; of more nothing is known
MOST_WINDOWS = 5


class Branches:
    """The sets of a state on the way to the next one; each method moves them on.

    boxes: bit i of a key says that the event of window i has happened; key 0 alone without windows.
    """

    def __init__(self, observer: UncertainTimesObserver, state: UncertainState) -> None:
        self.observer, self.inner = observer, observer.inner
        self.clocked, self.spread = state.clocked, state.spread
        self.windows, self.notes = list(state.windows), tuple[str, ...]()
        self.boxes = {branch.happened: branch.box for branch in state.branches}
        if not self.boxes:
            self.boxes = {0: state.clocked.box}

    def state(self, clocked: ClockedState, known: tuple[Known, ...]) -> UncertainState:
        """The state of these sets, with clocks and inputs of the last row."""
        if not np.array_equal(clocked.u, self.clocked.u):
            self.windows = [window._replace(u=None) for window in self.windows]
        branches = tuple(Branch(key, box) for key, box in self.boxes.items() if self.windows)
        return UncertainState(clocked, self.spread, tuple(self.windows), branches, known)

    def begun_anew(self, clocked: ClockedState) -> UncertainState:
        """The state with these bounds, whichever of the windows' events have happened."""
        keys = range(2 ** len(self.windows) if self.windows else 0)
        windows = tuple(window._replace(u=None) for window in self.windows)
        branches = tuple(Branch(key, clocked.box) for key in keys)
        return UncertainState(clocked, None, windows, branches)

    @property
    def hull(self) -> Matrix:
        """The box around all branches."""
        return reduce(np.minimum, self.boxes.values())

    def advance(self, t: float, opened: Iterable[Window]) -> None:
        """Move to time t; windows open and close on the way."""
        coming = list(opened)
        while True:
            times = [window.since for window in coming] + [x.until for x in self.windows]
            if not times or min(times) > t:
                break
            now = min(times)
            self._move(now)
            if coming and coming[0].since <= now:
                self._open(coming.pop(0))
            else:
                self._close(next(k for k, x in enumerate(self.windows) if x.until <= now))
        self._move(t)

    def used(self, y: Measured, events: Sequence[tuple[int, Matrix]]) -> Cut:
        """The hull after the samples and exact events of a row, and what contradicts it."""
        cuts = {key: self.inner.used(Cut(box), y, events) for key, box in self.boxes.items()}
        alive = {key: cut for key, cut in cuts.items() if not self._is_contradicted(cut)}
        faults = () if alive else next(iter(cuts.values())).faults
        self.boxes = {key: cut.box for key, cut in (alive or cuts).items()}
        if events:
            self._disturbed(events)
        if not self.windows:
            self.spread = None if self.spread is None else self._used_spread(y, events)
            self._reconcile()
        if alive and self.windows:
            self._detect()
        box = self.hull
        if not np.isfinite(box).all():
            faults = (BoundsFault.OVERFLOWED, *self.notes)
        return Cut(box, faults)

    def _is_contradicted(self, cut: Cut) -> bool:
        return bool(cut.faults) and cut.faults[0] is not BoundsFault.OVERFLOWED

    def _disturbed(self, events: Sequence[tuple[int, Matrix]]) -> None:
        """Exact events in open windows: their maps no longer begin where the windows do."""
        if not self.windows:
            return
        self.windows = [window._replace(u=None) for window in self.windows]
        for event, w in events:
            if self.spread is not None and not self._is_plain(event):
                self.spread = None
            elif self.spread is not None:
                self.spread = self._jumped(self.spread, event, w)

    def _is_plain(self, event: int) -> bool:
        """Does an event leave what the state was?"""
        G = self.observer.gains.events[event].G
        return np.array_equal(G, np.eye(len(G)))

    def _move(self, t: float) -> None:
        """All sets at time t; in open windows in parts in which the flow changes little."""
        start = self.clocked.t
        parts = parts_of(self.observer.gains.A, t - start) if self.windows and t > start else 1
        for k in range(1, parts):
            self._step(start + (t - start) * (k / parts))
        self._step(t)

    def _step(self, t: float) -> None:
        """All sets at time t, from maps of one step."""
        before = self.clocked
        h, size = t - before.t, max(abs(t), abs(before.t))
        if h <= 0:
            return
        if self.spread is not None:
            body = self.inner.flowed(before._replace(box=self.spread.body), t).box
            self.spread = self.spread.transported(body, self.observer.flow(h, size))
        old = self.boxes
        self.boxes = {
            key: self.inner.flowed(before._replace(box=box), t).box for key, box in old.items()
        }
        for k, window in enumerate(self.windows):
            for key, box in old.items():
                if not key >> k & 1:
                    jumped = self.observer.uncertain_box(
                        window, box, h, size, before.held, before.u
                    )
                    self._add(key | 1 << k, self.observer.box_of(*jumped))
        if len(self.windows) > 1:
            self._two_at_once(old, h)
        self.clocked = before._replace(t=t)
        self._cut_from_start()
        if not self.windows:
            self._reconcile()

    def _add(self, key: int, box: Matrix) -> None:
        self.boxes[key] = np.minimum(self.boxes.get(key, box), box)

    def _two_at_once(self, old: dict[int, Matrix], h: float) -> None:
        """Add the states where two windows' events happen in one step, in any order."""
        held, u = self.clocked.held, self.clocked.u
        during = {key: self.observer.tube(box, h, held, u) for key, box in old.items()}
        came: dict[int, Matrix] = {}
        for key in range(1 << len(self.windows)):
            for k, window in enumerate(self.windows):
                source = key & ~(1 << k)
                if source == key:
                    continue
                for sets, is_second in ((during, False), (came, True)):
                    if source not in sets:
                        continue
                    box = self.observer.tube(self._jump(sets[source], window), h, held, u)
                    came[key] = np.minimum(came.get(key, box), box)
                    if is_second:
                        self._add(key, box)

    def _jump(self, box: Matrix, window: Window) -> Matrix:
        """A box after the event of a window."""
        nothing = Measured(*np.full((2, self.observer.gains.p), np.nan))
        return self.inner.happened(Cut(box), window.event, window.w, nothing).box

    def _cut_from_start(self) -> None:
        """Cut the states after the one open window's event by its map from where it opened."""
        if len(self.windows) != 1 or 1 not in self.boxes:
            return
        body_curve = self._from_start(self.windows[0])
        if body_curve is None:
            return
        cut = np.maximum(self.boxes[1], self.observer.box_of(*body_curve))
        if not crossed(cut):
            self.boxes[1] = cut

    def _from_start(self, window: Window) -> tuple[Matrix, Matrix] | None:
        """(body, curve) of the event from the box where its window opened; None if unknown."""
        now = self.clocked.t
        if window.u is None or now == window.since:
            return None
        if not is_short(self.observer.gains.A, now - window.since):
            return None
        gains, size = self.observer.gains, max(abs(now), abs(window.since))
        declared = np.stack([gains.flow_lower, gains.flow_upper])
        return self.observer.uncertain_box(
            window, window.start, now - window.since, size, declared, window.u
        )

    def _open(self, window: Window) -> None:
        """A window opens at the present time."""
        if len(self.windows) == MOST_WINDOWS:
            nothing = np.full_like(self.clocked.box, -np.inf)
            self.boxes, self.windows, self.spread = {0: nothing}, [], None
            self.notes = (f"more than {MOST_WINDOWS} events may happen at once",)
            return
        if self.windows:  # maps from where they opened know of one event alone
            self.windows = [each._replace(u=None) for each in self.windows]
            window = window._replace(u=None)
        elif self.spread is None:
            self.spread = Spread(self.hull)
        bit = 1 << len(self.windows)
        if not self.clocked.started and window.u is None:  # it may be in the first bounds already
            self.boxes |= {key | bit: box for key, box in self.boxes.items()}
            self.spread = None
        self.windows.append(window._replace(start=self.hull))

    def _close(self, place: int) -> None:
        """The event of a window has happened."""
        bit, window = 1 << place, self.windows[place]
        if not any(key & bit for key in self.boxes):
            self.boxes = {key | bit: self._jump(box, window) for key, box in self.boxes.items()}
        self.spread = self._spread_after(window)
        del self.windows[place]
        low = bit - 1
        self.boxes = {
            key & low | (key >> 1) & ~low: box for key, box in self.boxes.items() if key & bit
        }
        if not self.windows:
            self._reconcile()

    def _spread_after(self, window: Window) -> Spread | None:
        """The second set after the event of a window."""
        now = self.clocked.t
        if self._is_plain(window.event):
            if self.spread is None:
                return None
            size = max(abs(now), abs(window.since))
            body, curve = self.observer.uncertain_jump_alone(window, now - window.since, size)
            return self.spread._replace(body=plus(self.spread.body, body)).with_curve(curve)
        spread = self._from_start(window)
        return None if spread is None else Spread(spread[0], (spread[1],))

    def _detect(self) -> None:
        """Windows end where an event must have happened, and begin anew where it cannot have."""
        for place in reversed(range(len(self.windows))):
            bit, window = 1 << place, self.windows[place]
            if all(key & bit for key in self.boxes):
                self._close(place)
            elif not any(key & bit for key in self.boxes):
                u = self.clocked.u if len(self.windows) == 1 else None
                self.windows[place] = window._replace(
                    since=self.clocked.t, start=self.hull, u=u
                )  # fmt: skip

    def _used_spread(self, y: Measured, events: Sequence[tuple[int, Matrix]]) -> Spread | None:
        """The second set after the samples and events of a row; None where these contradict it."""
        spread = self.spread
        for event, measured in self.inner.in_turn(y, events):
            if spread is None:
                return None
            if event is not None:
                spread = self._jumped(spread, *event)
            elif np.isfinite(measured.y).any():
                spread = self._sampled(spread, measured)
        return spread

    def _jumped(self, spread: Spread, event: int, w: Matrix) -> Spread:
        """The second set after an exact event."""
        nothing = Measured(*np.full((2, self.observer.gains.p), np.nan))
        body = self.inner.happened(Cut(spread.body), event, w, nothing).box
        return spread.transported(body, Enclosure.exactly(self.observer.gains.events[event].G))

    def _sampled(self, spread: Spread, measured: Measured) -> Spread | None:
        """The second set after samples: C x_b is within the noise of y less C times the curves."""
        low, high = spread.outputs(self.observer.gains.C)
        middle = 0.5 * (low + high)
        y = measured.y - middle
        rounding = np.spacing(np.abs(measured.y) + np.abs(middle))
        radius = np.nextafter(
            measured.radius + np.maximum(high - middle, middle - low) + 2 * rounding, np.inf
        )
        cut = self.inner.sampled(Cut(spread.body), Measured(y, np.where(np.isnan(y), 0.0, radius)))
        return None if cut.faults else spread._replace(body=cut.box)

    def _reconcile(self) -> None:
        """Cut each of the two sets by the other one."""
        if self.spread is None:
            return
        box = np.maximum(self.boxes[0], self.spread.box)
        if crossed(box):
            self.spread = None
            return
        self.boxes = {0: box}
        self.spread = self.spread.within(box)
