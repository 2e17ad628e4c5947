"""Unknown-input observer with a fixed lag: a sample is smoothed with those that follow it.

A sample is decided when `lag` further measurements have come. It and the one before are then
replaced by their values in the window of smoothing (`equations.smoothing`) that reaches from
2 lag measurements before it to lag measurements after it, and the observer of `observer.py` takes
its step between the two: both ends of the difference quotient come from one window, so that
differences between windows do not enter y'. Delay: lag samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.equations.unknown_input.smoothing import smoothed_window
from obsdesign.runtime.base import Delayed, Estimate, Row, Sample, centred
from obsdesign.runtime.point_observer import PointObserver
from obsdesign.runtime.state_marks import Outputs
from obsdesign.runtime.unknown_input.measurements import usable
from obsdesign.runtime.unknown_input.observer import UnknownInputObserver, UnknownInputState


@dataclass(frozen=True, slots=True)
class FixedLagState:
    """Everything the next step needs.

    present: state of the observer that takes samples as they come, for predictions; past: its state
    at the last decided row; measured: (t, y) of the measurements of a window, decided ones first;
    done: how many of them are decided; waiting: (t, y, u) of rows that are not; decided: rows that
    the last step settled, oldest first.
    """

    present: UnknownInputState
    past: UnknownInputState
    measured: tuple[tuple[float, Outputs], ...] = ()
    done: int = 0
    waiting: tuple[Row, ...] = ()
    decided: tuple[Estimate, ...] = ()

    @property
    def t(self) -> float:
        """Time of the last row."""
        return self.present.t


@dataclass(frozen=True)
class FixedLagObserver(PointObserver[FixedLagState], Delayed[FixedLagState]):
    """Executes a design of kind `unknown_input` with `differentiator = "fixed_lag"`."""

    gains: UnknownInputGains
    inner: UnknownInputObserver
    kind: ClassVar[str] = "unknown_input"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Entries) -> FixedLagObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        inner = UnknownInputObserver.from_gains(gains)
        return cls(inner.gains, inner)

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return self.inner.names

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the axes of a state's arrays."""
        return self.inner.sizes

    @cached_property
    def _lag(self) -> int:
        assert self.gains.lag is not None
        return self.gains.lag

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> FixedLagState:
        """State at time t, before the first sample; x as for `UnknownInputObserver.init`."""
        state = self.inner.init(t, x=x)
        return FixedLagState(present=state, past=state)

    def step(self, state: FixedLagState, sample: Sample) -> tuple[FixedLagState, Estimate]:
        """Take a sample; the estimate is that without smoothing, at its own time.

        Rows that it settles are in `decided` of the state. ValueError as for the inner observer.
        """
        present, prediction = self.inner.step(state.present, sample)
        # copies: the sample's own arrays are the caller's
        y, u = (None if value is None else np.array(value, float) for value in (sample.y, sample.u))
        t, measured = float(sample.t), state.measured
        measurement, _ = usable(y, self.gains.p)
        if measurement is not None:
            measured = (*measured, (t, measurement))
        waiting = (*state.waiting, (t, y, u))
        state = replace(state, present=present, measured=measured, waiting=waiting)
        return self._decided(state, self._lag), prediction

    def block(self, state: FixedLagState, samples: Sequence[Sample]) -> FixedLagState:
        """Take several samples: `decided` holds the rows that all of them settled."""
        rows: list[Estimate] = []
        for sample in samples:
            state, _ = self.step(state, sample)
            rows += state.decided
        return replace(state, decided=tuple(rows))

    def finish(self, state: FixedLagState) -> tuple[Estimate, ...]:
        """Rows that were waiting when the record ended, smoothed with what there is after them."""
        return self._decided(state, 0).decided

    def _decided(self, state: FixedLagState, lag: int) -> FixedLagState:
        """Settle the waiting rows that `lag` measurements follow."""
        past, measured, done, rows = state.past, state.measured, state.done, []
        waiting = list(state.waiting)
        while waiting:
            usable_row = done < len(measured) and waiting[0][0] == measured[done][0]
            if len(measured) - done - usable_row < lag:
                break
            sample = Sample(*waiting.pop(0))
            if usable_row:
                before, sample = self._smoothed(measured, done, sample)
                past = past if before is None else past._replace(y=before)
                done += 1
                surplus = max(0, done - 2 * self._lag)
                measured, done = measured[surplus:], done - surplus
            past, estimate = self.inner.step(past, sample)
            rows.append(estimate)
        return replace(
            state,
            past=past,
            measured=measured,
            done=done,
            waiting=tuple(waiting),
            decided=tuple(rows),
        )

    def _smoothed(
        self, measured: tuple[tuple[float, Matrix], ...], k: int, sample: Sample
    ) -> tuple[Matrix | None, Sample]:
        """(the measurement before the k-th, the k-th sample), both smoothed in one window."""
        window = measured[: k + self._lag + 1]
        t = np.array([time for time, _ in window])
        assert self.gains.noise_std is not None
        y = smoothed_window(t, np.array([row for _, row in window]), self.gains.noise_std)
        # the inner observer keeps measurements less the middle of the noise
        return (centred(y[k - 1], self.gains) if k else None), sample._replace(y=y[k])
