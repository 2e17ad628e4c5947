"""Impulses and residuals of a record so far, by which a further impulse is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.residuals import LARGER, Residuals, birge_ratio
from obsdesign.runtime.state_marks import Past
from obsdesign.runtime.status import Reason

_DEVIATIONS = 3.0  # deviations by which a dwell time must be too short, a time wrong


@dataclass(frozen=True, slots=True)
class DoubtfulSpan:
    """Times whose rows rest on an impulse with doubts; at first none."""

    since: float = math.inf
    until: float = -math.inf
    doubts: tuple[str, ...] = ()

    def doubts_at(self, t: float) -> tuple[str, ...]:
        """Doubts of a row at time t."""
        return self.doubts if self.since <= t <= self.until else ()


@dataclass(frozen=True, slots=True)
class History:
    """Time of the last impulse and its deviation, doubts about it, residuals so far.

    doubt, doubt_before: the last spans of doubtful impulses; the row at which one ends may be
    decided once the next has begun. residuals: of the windows of impulses, and of rows that no
    window will use again.
    """

    t: Past = -math.inf
    t_std: float = 0.0
    doubt: DoubtfulSpan = field(default_factory=DoubtfulSpan)
    doubt_before: DoubtfulSpan = field(default_factory=DoubtfulSpan)
    residuals: Residuals = field(default_factory=Residuals)

    @property
    def earliest(self) -> float:
        """The time before which the last impulse hardly came."""
        return self.t - _DEVIATIONS * self.t_std

    def doubts_at(self, t: float) -> tuple[str, ...]:
        """Doubts of a row at time t, each once."""
        both = (*self.doubt_before.doubts_at(t), *self.doubt.doubts_at(t))
        return tuple(dict.fromkeys(both))

    def judged(self, event: Event, dwell: float, *, cost: float, freedom: int) -> Event:
        """The event with deviations for the residuals, and doubts about them and its dwell time.

        dwell: the shortest admissible; cost, freedom: of the residuals of its own window.
        """
        whole = self.residuals.ratio
        ratio = max(birge_ratio(cost, freedom), whole)
        if ratio > 1 and event.t_std is not None and event.weights_std is not None:
            event = replace(
                event,
                t_std=ratio * event.t_std,
                weights_std=ratio * event.weights_std,
                doubts=(*event.doubts, LARGER) if whole > 1 else event.doubts,
            )
        gap = short_dwell(self.t, event.t, dwell, self.t_std, event.t_std or 0.0)
        return replace(event, doubts=(*event.doubts, gap)) if gap else event

    def after(self, event: Event, since: float, until: float) -> History:
        """The history after a further impulse, on which the rows in [since, until] rest."""
        following = replace(self, t=event.t, t_std=event.t_std or 0.0)
        if not event.doubts:
            return following
        span = DoubtfulSpan(since, until, event.doubts)
        return replace(following, doubt=span, doubt_before=self.doubt)


def short_dwell(last: float, t: float, dwell: float, *deviations: float) -> str:
    """Sentence about a dwell time below the range by more than both deviations allow, or empty."""
    gap = t - last
    if gap >= dwell - time_tolerance(dwell, t) - _DEVIATIONS * math.hypot(*deviations):
        return ""
    return Reason.measured("dwell time", gap, f"below {dwell:.9g}")
