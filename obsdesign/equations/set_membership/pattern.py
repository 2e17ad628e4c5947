"""The nominal pattern of samples and jumps, for which a width can be stated before any data.

Samples every period, jumps as early as the dwell time allows: at the first sample after it, or at
the shortest dwell time where y is known at jumps only. With jump_measurement "none" at least one
sample falls between two jumps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from obsdesign.equations.set_membership.gains import SetMembershipGains

MOST_STEPS = 120
# steps of discrete time in a stage with a disturbance of its own each; older ones share a box
MOST_COUNTED = 32
# relative tolerance of dwell times that are multiples of the period, as for time stamps
_RELATIVE_TOLERANCE = 1e-9


class Step(NamedTuple):
    """A stage of the pattern: a time h, or a jump (h = 0); a sample after it; the end of a row."""

    h: float
    jump: bool
    sampled: bool
    ends_row: bool


@dataclass(frozen=True)
class Pattern:
    """Steps of one cycle, which repeats itself."""

    cycle: tuple[Step, ...]

    @property
    def ends(self) -> tuple[int, ...]:
        """Indices of the steps that end a row."""
        return tuple(k for k, step in enumerate(self.cycle) if step.ends_row)

    def window(self, end: int, count: int) -> tuple[Step, ...]:
        """The `count` steps up to step `end` of the cycle, oldest first."""
        return tuple(self.cycle[k % len(self.cycle)] for k in range(end - count + 1, end + 1))

    def start(self, end: int, count: int) -> tuple[int, Step | None]:
        """(row, step): a window begins after that row, or after that step of the row behind it."""
        first = (end - count) % len(self.cycle)
        if self.cycle[first].ends_row:
            return self.ends.index(first), None
        return self.ends.index((first - 1) % len(self.cycle)), self.cycle[first]

    def windows(self, count: int) -> tuple[tuple[Step, ...], ...]:
        """The different windows that rows end with, in the order of the cycle."""
        return tuple(dict.fromkeys(self.window(end, count) for end in self.ends))

    def fewest_samples(self, count: int) -> int:
        """The least number of samples in a window."""
        return min(sum(step.sampled for step in one) for one in self.windows(count))

    def __str__(self) -> str:
        return self.described("")

    def described(self, unit: str) -> str:
        """The pattern in words, its times in a unit: "a jump every 0.2 s"; "" for none."""
        steps, last = self.cycle, f" {unit}" if unit else ""
        rows, period = len(self.ends), steps[0].h
        if not steps[-1].jump:
            return f"a sample every {period:.9g}{last}"
        between = f"a jump every {rows * period:.9g}{last}"
        return f"a sample every {period:.9g}{last} and {between}" if rows > 1 else between


def nominal_pattern(gains: SetMembershipGains) -> Pattern | str:
    """The pattern of a design, or the reason for which there is none."""
    if gains.d_rate is not None:
        return "the unknown input is estimated too, and no width of both is proved"
    if gains.sensors:
        return (
            "events and sensors keep times of their own, and no pattern of rows repeats itself; "
            "kind interval claims widths for all of these times"
        )
    if gains.measured == "continuous":
        return "output.measured is continuous: the spacing of the samples is not stated"
    if reason := _reason_against_steps(gains):
        return reason
    when = gains.jump_measurement
    jump = Step(0.0, True, when == "after", True)
    if gains.G is None:
        if gains.measured == "at_jumps" or gains.period is None:
            return "there are no jumps, and y is known at jumps only"
        return Pattern((Step(gains.period, False, True, True),))
    if gains.dwell_time is None:
        return "jump.dwell_time is not stated"
    low, high = gains.dwell_range
    if gains.measured == "at_jumps":
        if low == 0:
            return "the shortest dwell time is zero"
        return Pattern((Step(low, False, when == "before", False), jump))
    assert gains.period is not None
    rows = low / gains.period * (1 - _RELATIVE_TOLERANCE)
    if rows > MOST_STEPS:
        return f"more than {MOST_STEPS} samples fall between two jumps"
    # a jump that hides the sample of its row leaves none if there is one in every row
    rows = max(math.ceil(rows), 2 if when == "none" else 1)
    if rows * gains.period > high * (1 + _RELATIVE_TOLERANCE):
        if when == "none" and gains.period <= high * (1 + _RELATIVE_TOLERANCE):
            return "every sample falls on a jump, and output.jump_measurement is none"
        return "no multiple of the period is a dwell time"
    plain = Step(gains.period, False, True, True)
    last = Step(gains.period, False, when == "before", False)
    return Pattern((*(plain,) * (rows - 1), last, jump))


def _reason_against_steps(gains: SetMembershipGains) -> str | None:
    """Reason against a pattern in discrete time, where a stage has too many steps, or None."""
    if gains.dt is None:
        return None
    stage = gains.dwell_range[0] if gains.measured == "at_jumps" else gains.period
    if stage is None or stage <= gains.dt * (MOST_COUNTED + 0.5):
        return None
    return f"more than {MOST_COUNTED} steps lie between two samples"
