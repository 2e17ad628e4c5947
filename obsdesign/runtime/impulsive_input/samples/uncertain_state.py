"""Rows whose state rests on an impulse of a weight that is hardly known.

A short window may show that an impulse came, and still not by how much: a late small impulse and
an early large one, or the reverse, then leave nearly the same samples, and the state after it is as
uncertain as the weight. Later samples, or decay, make it certain again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from obsdesign.equations.impulsive_input.gains import SamplesGains
from obsdesign.runtime.impulsive_input.event import Event
from obsdesign.runtime.impulsive_input.history import DoubtfulSpan, History
from obsdesign.runtime.impulsive_input.samples.filter import Filtered
from obsdesign.runtime.impulsive_input.significance import is_weight_significant

UNCERTAIN = "weight hardly above its deviation"
_AGES = 64  # at which the output is predicted, over the shortest dwell time


@dataclass(frozen=True)
class UncertainState:
    """Doubts about weights that are hardly known, and until which row they last."""

    gains: SamplesGains

    @cached_property
    def outputs(self) -> Matrix:
        """C e^{A s} for s over the shortest dwell time, (ages, p, n)."""
        step = self.gains.shortest_dwell / (_AGES - 1)
        return exponential_grid(self.gains.A, 0.0, step, _AGES, left=self.gains.C)

    def doubts(self, event: Event) -> tuple[str, ...]:
        """The doubt about an event whose weight is hardly above its deviation."""
        assert event.weights_std is not None
        return () if is_weight_significant(event.weights, event.weights_std) else (UNCERTAIN,)

    def continued(self, history: History, since: float, at: Filtered) -> History:
        """The history whose doubts about a weight at a row reach the next row `at`, where due."""
        spans = [self._continued(span, since, at) for span in (history.doubt, history.doubt_before)]
        return replace(history, doubt=spans[0], doubt_before=spans[1])

    def _continued(self, span: DoubtfulSpan, since: float, at: Filtered) -> DoubtfulSpan:
        lasts = UNCERTAIN in span.doubts and span.since <= since <= span.until < at.row.t
        return replace(span, until=at.row.t) if lasts and self._shows_error(at) else span

    def _shows_error(self, at: Filtered) -> bool:
        """Whether errors of the state change outputs to come by more than their noise."""
        deviations = np.linalg.norm(self.outputs @ at.factor, axis=2)
        return not bool((deviations <= at.row.spread).all())
