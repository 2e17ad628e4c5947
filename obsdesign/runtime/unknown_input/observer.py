"""Unknown-input observer at run time: one stacked product per sample.

    w+   = Ad w + Bw (Gu U + H Yc),  Yc = (y + y_prev)/2, U = mean of [u; 1]     (29), (30)
    x    = X w+ + Xy y                                       at the time of the sample, (31)
    d    = Q Wc + R Yc + S U + N Y'                          mean over the interval, (33)

with Ad = (I - hF/2)^-1 (I + hF/2), Bw = h (I - hF/2)^-1, Wc = (w + w+)/2. Y' is the difference
quotient (y - y_prev)/h (`cell`), which is (34) for trapezoid averages that start at the first
sample, or its damped recursion (`damped`). With `batch`, `run` smooths the whole record to its
noise first, and `step` takes samples as they come; with `fixed_lag` see `fixed_lag.py`.

A step covers the time since the last measurement, of any length (`steps.py`).
Source: P. Ahn (2002), (29)-(34).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import hypot
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.column_names import numbered
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.runtime.base import (
    MODERATE,
    NOTHING_FURTHER,
    Estimate,
    Sample,
    Stepped,
    by_position,
    centred,
    instant,
    later,
    vector,
)
from obsdesign.runtime.jump import no_jumps
from obsdesign.runtime.point_observer import PointObserver
from obsdesign.runtime.state_marks import Axes, Outputs, Past, States
from obsdesign.runtime.status import status_of
from obsdesign.runtime.unknown_input.measurements import smoothed_record, usable
from obsdesign.runtime.unknown_input.steps import (
    LONGEST,
    SHORTEST,
    Interval,
    Slope,
    Steps,
    damped_slope,
)


class UnknownInputState(NamedTuple):
    """Everything the next step needs.

    t: time of the last row; t_measured, w, y: time, reduced state and output at the last
    measurement (y None: none yet, w then a guess or None); u: [u; 1] held since t; u_integral:
    integral of it since t_measured; slope: that of the last interval, for `damped`; interval: the
    last one; moderate: w, x and d are below `MODERATE`.
    """

    t: float
    t_measured: Past
    x: States
    w: Annotated[Matrix, Axes("k")] | None
    y: Outputs | None
    u: Annotated[Matrix, Axes("i")]
    u_integral: Annotated[Matrix, Axes("i")] | None = None
    slope: Slope | None = None
    interval: Interval | None = None
    started: bool = True
    moderate: bool = False

    def input_integral(self, t: float) -> Matrix:
        """Integral of [u; 1] from the last measurement to t."""
        return self.u * (t - self.t) + (0.0 if self.u_integral is None else self.u_integral)


@dataclass(frozen=True)
class UnknownInputObserver(PointObserver[UnknownInputState], Stepped[UnknownInputState]):
    """Executes a design of kind `unknown_input`."""

    gains: UnknownInputGains
    kind: ClassVar[str] = "unknown_input"
    finds_events: ClassVar[bool] = False

    @classmethod
    def from_gains(cls, gains: Entries) -> UnknownInputObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(UnknownInputGains.from_document(gains))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        return super().names + numbered("d", self.gains.q)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of axes: as for points, k reduced states, i inputs, and the maps of a step."""
        sizes, k, i = super().sizes, self.gains.k, self.gains.m + 1
        results = k + self.gains.n + self.gains.q
        return sizes | {"k": k, "i": i, "in": k + 2 * self.gains.p + i, "out": results}

    @property
    def takes_whole_records(self) -> bool:
        """Whether `run` needs all rows at once."""
        return self.gains.differentiator == "batch"

    @cached_property
    def _steps(self) -> Steps:
        return Steps(self.gains)

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> UnknownInputState:
        """State at time t, before the first sample.

        x: a guess of x(t), of which T x is kept; zeros give the paper's w(0) = 0. None: the w(0)
        of least norm that agrees with the first sample.
        """
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        with np.errstate(over="ignore", invalid="ignore"):
            w = None if x is None else self.gains.T @ guess
        inputs = np.zeros(self.gains.m + 1)
        inputs[-1] = 1.0
        t = instant(t)
        return UnknownInputState(t=t, t_measured=t, x=guess, w=w, y=None, u=inputs, started=False)

    def step(self, state: UnknownInputState, sample: Sample) -> tuple[UnknownInputState, Estimate]:
        """Move to the time of the sample and use it.

        ValueError if time does not increase (the first sample may share the initial time), or if
        the sample says jump.
        """
        if sample.jump:
            raise no_jumps()
        t = later(sample, state.t, state.started)
        y = self._moderate(sample.y)
        if y is not None and state.moderate and SHORTEST < t - state.t_measured < LONGEST:
            return self._step(state, t, y, sample)  # no overflow: `errstate` takes its time
        with np.errstate(over="ignore", invalid="ignore"):  # the status names what is not finite
            return self._step(state, t, y, sample)

    def _moderate(self, y: ArrayLike | None) -> Matrix | None:
        """The array itself if its length alone shows that every entry is usable."""
        if type(y) is np.ndarray and y.dtype.char == "d" and y.shape == self._steps.shape:
            return y if hypot(*y.tolist()) < MODERATE else None
        return None

    def _step(
        self, state: UnknownInputState, t: float, y: Matrix | None, sample: Sample
    ) -> tuple[UnknownInputState, Estimate]:
        u, why = state.u, ""
        if y is None:
            y, why = usable(sample.y, self.gains.p)
        if y is not None and self.gains.noise_centre is not None:
            y = centred(y, self.gains)
        if sample.u is not None and len(u) > 1:
            u = np.append(vector(sample.u, len(u) - 1, "u"), 1.0)
        if state.y is None or state.w is None:
            return self._first(state, t, y, u, why)
        steps, h, integral = self._steps, t - state.t_measured, None
        interval = steps.interval(state.interval, h, max(abs(t), abs(state.t)))
        if y is None or state.u_integral is not None:
            integral = state.input_integral(t)
        mean = state.u if integral is None else integral / h
        known = np.concatenate((state.w, state.y, state.y if y is None else y, mean))
        if interval.step is None:
            estimates = steps.free.estimates(h, known)
        else:
            estimates = interval.step.dot(known)
        if y is None:
            nothing, x = np.full(self.gains.q, np.nan), estimates[steps.x]
            following = state._replace(t=t, x=x, u=u, u_integral=integral)
            return following, Estimate(t, x=x, d=nothing, status=why)
        # the sample's own array is the caller's
        return self._corrected(state, t, (known[steps.y], u), interval, estimates)

    def _corrected(
        self,
        state: UnknownInputState,
        t: float,
        inputs: tuple[Matrix, Matrix],
        interval: Interval,
        estimates: Matrix,
    ) -> tuple[UnknownInputState, Estimate]:
        """The state from [w+; x; d]; inputs: the measurement, and [u; 1] from it on."""
        steps, (y, u), slope = self._steps, inputs, None
        if steps.is_damped:
            assert state.y is not None
            slope = damped_slope(state.slope, t - state.t_measured, state.y, y)
            estimates[steps.d] += self.gains.N @ slope[2]
        w, x, d = estimates[steps.w], estimates[steps.x], estimates[steps.d]
        status, moderate = interval.status, steps.has_usual_gains
        moderate = moderate and hypot(*estimates.tolist()) < MODERATE
        if not moderate:
            status = status_of([status] if status != "ok" else [], x, d)
        elif u is not state.u or not state.moderate:
            moderate = hypot(*u.tolist()) < MODERATE
        fields = (t, t, x, w, y, u, None, slope, interval, True, moderate)
        following = by_position(UnknownInputState, fields)
        return following, by_position(
            Estimate, (t, x, None, None, d, (), status, *NOTHING_FURTHER)
        )  # fmt: skip

    def run(self, state: UnknownInputState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples; with `batch`, of the record smoothed as a whole."""
        if self.takes_whole_records:
            assert self.gains.noise_std is not None
            samples = smoothed_record([_copied(row) for row in samples], self.gains.noise_std)
        return super().run(state, samples)

    def _first(
        self, state: UnknownInputState, t: float, y: Matrix | None, u: Matrix, why: str
    ) -> tuple[UnknownInputState, Estimate]:
        """No interval yet, so nothing is known of d; before any measurement, x is the guess."""
        nothing = np.full(self.gains.q, np.nan)
        if y is None:
            following = state._replace(t=t, u=u, started=True)
            return following, Estimate(t, x=state.x, d=nothing, status=why)
        w = self.gains.first @ y if state.w is None else state.w
        x = self.gains.X @ w + self.gains.Xy @ y
        # a copy: the sample's own array is the caller's
        following = UnknownInputState(t=t, t_measured=t, x=x, w=w, y=y.copy(), u=u)
        return following, Estimate(t, x=x, d=nothing, status=status_of([], x))


def _copied(sample: Sample) -> Sample:
    """A sample that outlives the caller's arrays."""
    y, u = (None if values is None else np.array(values) for values in (sample.y, sample.u))
    return sample._replace(y=y, u=u)
