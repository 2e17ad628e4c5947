"""Rows of a record that are left out, and what later estimates say of it.

A row acts beyond its own time where it holds an event, a known input, a mode or bounds of b, or is
the first row, for which --initial is stated. Bounds behind such a row are those of another course
where it is left out, and so are point estimates whose error is bounded. A row with measurements
alone is a missing sample, which statuses name where it counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from obsdesign.column_names import pairs
from obsdesign.data.arrivals import BadLine, Remark, Skip
from obsdesign.data.layout import Layout
from obsdesign.data.records import Block
from obsdesign.errors import InputError
from obsdesign.runtime.announced import opening
from obsdesign.runtime.base import Estimate, Observer, Sample
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.status import Reason, with_reasons

LEFT_OUT = Reason("a row was left out on which these bounds may depend")


class LeftOut:
    """What was left out of a record so far, for an observer whose estimates are guaranteed.

    progress: where an earlier part ended, or the numbers --initial of a record that begins; after:
    time behind which estimates are known to miss a row; has_error_bound: is the error of point
    estimates bounded?
    """

    def __init__(
        self, layout: Layout, observer: Observer, progress: Progress, after: float = math.inf,
        *, has_error_bound: bool = False,
    ) -> None:  # fmt: skip
        self._has_bounds = pairs(("x1",))[0] in observer.names
        self._is_guaranteed = self._has_bounds or has_error_bound
        self._may_act = layout.jump or layout.u > 0 or bool(layout.modes)
        # bounds of b that a row sets which waits from an earlier part on
        self._may_act |= any(
            bool(row.bounds) and row.bounds[0] is not None for row in progress.late
        )
        # an event may be earlier than its stamp
        self._early = 0.0 if layout.clocks is None else max(layout.clocks.errors, default=0.0)
        # rows of a time act one after the other; where they may be late, the first ones are final
        self._shares_time = layout.may_repeat and layout.lag == 0
        self.in_force, self._latest = progress.in_force, progress.t
        self._begins = self._has_bounds and progress.initial is not None
        # times of the first row that is taken, and of the first one that is left out
        self.first, self._lost = progress.first, math.inf
        self._after = -math.inf if progress.left_out else after

    @property
    def after(self) -> float:
        """Time behind which bounds are known to miss a row; infinity where none is."""
        misses_first = self._has_bounds and self._lost < self.first
        return -math.inf if misses_first else self._after

    @property
    def counts(self) -> bool:
        """Was any left out on which bounds depend?"""
        return self.after < math.inf

    def skipping(self, remark: Remark) -> Skip:
        """What happens to a bad line: a remark, and it is noted; the first row is not skipped."""

        def skip(line: BadLine) -> None:
            if line.is_first and self._begins:
                raise InputError(
                    f"{line.reason} --skip-bad does not skip the first row, since --initial is "
                    "stated for it."
                )
            self._lost = min(self._lost, self._latest if math.isnan(line.t) else line.t)
            if self._may_act or self.in_force.b is not None:
                is_before = self._early > 0 or self._shares_time
                self._mark(opening(self._latest, self._early) if is_before else self._latest)
                if line.t <= self._latest:
                    self._mark(opening(line.t, self._early))
            remark(f"{line.reason} Line {line.number} is skipped.")

        return skip

    def note(self, sample: Sample, waiting: Sequence[Sample]) -> None:
        """A row came too late; waiting: rows that are taken after those so far."""
        self._lost = min(self._lost, sample.t)
        in_force = self.in_force
        for row in waiting:
            in_force = in_force.following(row) if row.t <= sample.t else in_force
        if sample.jump or sample.events or in_force.is_changed_by(sample):
            self._mark(opening(sample.t, self._early))

    def _mark(self, after: float) -> None:
        """Bounds of later rows than this time miss a row."""
        if self._is_guaranteed:
            self._after = min(self._after, after)

    def watched(self, blocks: Iterator[Block]) -> Iterator[Block]:
        """The rows that are taken."""
        for block in blocks:
            if isinstance(block, Columns):
                first, self._latest = float(block.t[0]), float(block.t[-1])
                self.in_force = self.in_force.behind(block)
            else:
                first = self._latest = block.t
                self.in_force = self.in_force.following(block)
            self.first = min(self.first, first)
            yield block

    def marked(self, estimate: Estimate) -> Estimate:
        """The estimate, with that reason behind a row that was left out."""
        if estimate.t <= self.after:
            return estimate
        return estimate._replace(status=with_reasons(estimate.status, [LEFT_OUT]))

    def marked_rows(self, batch: Batch) -> Batch:
        """Estimates of rows, with that reason likewise."""
        if batch.t[-1] <= self.after:
            return batch
        rows = zip(batch.t.tolist(), batch.status, strict=True)
        status = [own if t <= self.after else with_reasons(own, [LEFT_OUT]) for t, own in rows]
        return replace(batch, status=tuple(status))
