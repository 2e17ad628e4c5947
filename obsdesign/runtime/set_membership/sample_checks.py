"""Samples that are missing or late, with their status.

Claimed widths are of samples in time; the bounds hold in any case.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.set_membership.gains import SetMembershipGains
from obsdesign.runtime.base import Sample
from obsdesign.runtime.set_membership.state import SetMembershipState
from obsdesign.runtime.time_stamps import time_tolerance


def objections_to_sample(
    gains: SetMembershipGains, state: SetMembershipState, sample: Sample, y: Matrix | None
) -> list[str]:
    """Sentences on a sample that is missing or late; state: the one before it."""
    is_due = gains.measured != "at_jumps" or sample.jump
    if sample.jump and gains.jump_measurement == "none":
        is_due = False
    sentences = []
    if gains.period is not None and gains.measured == "periodic" and state.started:
        apart = sample.t - state.sampled
        slack = time_tolerance(apart, sample.t)
        is_due = is_due and apart >= gains.period - slack
        if y is not None and apart > gains.period + slack:
            limit = f"above {gains.period:.9g}"
            sentences.append(f"time {apart:.9g} since the last sample, {limit}")
    absent = [] if y is None else [f"y{i + 1}" for i in np.flatnonzero(np.isnan(y))]
    if is_due and (y is None or absent):
        which = f" of {' '.join(absent)}" if absent else ""
        sentences.insert(0, f"missing sample{which}")
    return sentences
