"""Rows of a record that are left out, and what later estimates say of it.

A line that is no row, or a row that comes too late, may have held an event or a known input: the
bounds of later rows are then those of another course. A row with measurements alone is a missing
sample, which statuses name where it counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from obsdesign.column_names import pairs
from obsdesign.data.arrivals import Arrivals, Remark
from obsdesign.data.layout import Layout
from obsdesign.runtime.base import Estimate, Observer, Sample
from obsdesign.runtime.status import Reason, with_reasons

LEFT_OUT = Reason("a row was left out that may have held an event or an input")


class LeftOut:
    """What was left out of a record so far, for an observer with bounds: others forget.

    begins: was a row left out of an earlier part that may have held an event or an input?
    """

    def __init__(self, layout: Layout, observer: Observer, *, begins: bool) -> None:
        self._has_bounds = pairs(("x1",))[0] in observer.names
        self._may_hold = layout.jump or layout.u > 0 or bool(layout.modes)
        # an event may be earlier than its stamp; rows of a time act one after the other
        self._early = 0.0 if layout.clocks is None else max(layout.clocks.errors, default=0.0)
        self._may_repeat = layout.may_repeat
        self._latest, self._after = -math.inf, -math.inf if begins else math.inf

    @property
    def counts(self) -> bool:
        """Was any left out that may have held an event or an input?"""
        return self._after < math.inf

    def skipping(self, arrivals: Arrivals, remark: Remark) -> Remark:
        """A remark on a line that is skipped, which is noted."""

        def skip(text: str) -> None:
            if self._has_bounds and self._may_hold:
                since = arrivals.buffer.now - arrivals.buffer.lag  # before, it would be too late
                self._after = min(self._after, max(self._latest, since) - self._early)
            remark(text)

        return skip

    def note(self, sample: Sample) -> None:
        """A row came too late."""
        held = sample.jump or sample.events or sample.u is not None or sample.mode is not None
        if self._has_bounds and (held or sample.bounds is not None):
            self._after = min(self._after, sample.t - self._early)

    def watched(self, samples: Iterator[Sample]) -> Iterator[Sample]:
        """The rows that are taken."""
        for sample in samples:
            self._latest = sample.t
            yield sample

    def marked(self, estimates: Iterator[Estimate]) -> Iterator[Estimate]:
        """The estimates, those behind a row that was left out with that reason."""
        for estimate in estimates:
            if estimate.t > self._after or (self._may_repeat and estimate.t == self._after):
                status = with_reasons(estimate.status, [LEFT_OUT])
                yield estimate._replace(status=status)
            else:
                yield estimate
