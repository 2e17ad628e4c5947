"""The check of dwell times at run time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from obsdesign.equations.gains import PlantGains
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.state_marks import Past
from obsdesign.runtime.status import MISSING_EVENT, Reason


@dataclass(frozen=True, slots=True)
class DwellGuard:
    """Check that dwell times stay in the range of the design, and change no faster.

    jitter: largest change from one dwell time to the next. last_jump and last_dwell are None until
    there were one and two jumps: the time before the first one is not a dwell time.
    """

    shortest: float
    longest: float
    last_jump: Past | None = None
    jitter: float = math.inf
    last_dwell: float | None = None

    @classmethod
    def from_gains(cls, gains: PlantGains) -> DwellGuard:
        """The guard of a design's gains; without jumps it accepts every time."""
        jitter = math.inf if gains.dwell_jitter is None else gains.dwell_jitter
        return cls(*gains.dwell_range, jitter=jitter)

    def after(
        self, t: float, jump: bool, *, is_step: bool = False
    ) -> tuple[DwellGuard, Reason | None]:
        """The guard after an instant, and why the instant is inadmissible (None: it is not).

        is_step: of discrete time, where no later row has the event that is due.
        """
        violation = None
        elapsed = None if self.last_jump is None else t - self.last_jump
        if elapsed is not None:
            slack = time_tolerance(elapsed, t)
            change = 0.0 if self.last_dwell is None else abs(elapsed - self.last_dwell)
            if jump and elapsed < self.shortest - slack:
                violation = Reason.measured("dwell time", elapsed, f"below {self.shortest:.9g}")
            elif elapsed > self.longest + slack:
                violation = Reason.measured("dwell time", elapsed, f"above {self.longest:.9g}")
            elif is_step and not jump and elapsed >= self.longest - slack:
                violation = MISSING_EVENT
            elif jump and change > self.jitter + 2 * slack:
                limit = f"of the dwell time above {self.jitter:.9g}"
                violation = Reason.measured("change", change, limit)
        if not jump:
            return self, violation
        return replace(self, last_jump=t, last_dwell=elapsed), violation
