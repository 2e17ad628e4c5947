"""The state of operator `integral` along a record, from its first measurement on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from obsdesign.runtime.impulsive_input.history import History
from obsdesign.runtime.impulsive_input.integral.free_run import Track
from obsdesign.runtime.impulsive_input.integral.scan import Scan
from obsdesign.runtime.state_marks import Inputs, Past, Square, States


class HeldInput(NamedTuple):
    """A row after the last measurement, and the input u (m,) from then on."""

    t: Past
    u: Inputs


class AbsentRow(NamedTuple):
    """A row between two measurements, and how far the forcing moves the plant since the first."""

    t: Past
    displacement: States


@dataclass(frozen=True, slots=True)
class IntegralLive:
    """Open rows: measured ones in the track, with the search along them, and the others.

    covariance: of the error at time `since`, None where it is not known (yet).
    first: time of the first row of the record, the phase of periodic samples.
    largest: value of a search at which an impulse was evaluated, so far. confused_until: until when
    an impulse passes for an error of the state at first.
    """

    track: Track
    covariance: Square | None
    since: Past
    first: Past
    scan: Scan = field(default_factory=Scan)
    waiting: tuple[HeldInput, ...] = ()
    absent: tuple[AbsentRow, ...] = ()
    largest: float = 0.0
    confused_until: Past = -math.inf
    history: History = field(default_factory=History)

    def with_track(self, track: Track, scan: Scan) -> IntegralLive:
        """The state when rows in front were given out."""
        start = float(track.t[0])
        absent = tuple(row for row in self.absent if row.t >= start)
        return replace(self, track=track, scan=scan, absent=absent)
