"""Observer of impulses of unknown times and weights: delayed rows, events, a tail.

Rows are given out once no later impulse can change them: with the window (tau) and what it takes to
see that |R| has passed its maximum. A record's last rows stay `unresolved`. `step` answers at the
sample's own time with the prediction so far; the rows that it settled are in `state.decided`, and
`finish` gives the tail. `run` and `run_batch` put these together, one row per sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.equations.impulsive_input.gains import (
    IntegralGains,
    SamplesGains,
    gains_from_document,
)
from obsdesign.runtime.base import (
    Delayed,
    Estimate,
    KindState,
    Sample,
    centred,
    instant,
    later,
    optional_measurement,
    vector,
)
from obsdesign.runtime.columns import Batch, Columns, collect
from obsdesign.runtime.impulsive_input.event import OPEN, Event
from obsdesign.runtime.impulsive_input.initial import Initial
from obsdesign.runtime.impulsive_input.integral.engine import IntegralEngine
from obsdesign.runtime.impulsive_input.integral.live import IntegralLive
from obsdesign.runtime.impulsive_input.record_checks import check_resolution, check_size
from obsdesign.runtime.impulsive_input.samples.engine import SamplesEngine
from obsdesign.runtime.impulsive_input.samples.live import SampledLive
from obsdesign.runtime.point_observer import PointObserver
from obsdesign.runtime.state_marks import Inputs

_BLOCK = 1024  # rows that a batch hands over at once, at least a window of them


Live = TypeVar("Live")


class Engine(Protocol[Live]):
    """One way to find impulses along a record; rows come in blocks, y NaN where it is missing."""

    def extended(self, live: Live, t: Matrix, y: Matrix, u: Matrix) -> tuple[Live, list[Estimate]]:
        """The state after further rows, and the rows that are decided now."""

    def prediction(self, live: Live) -> Matrix:
        """The estimate at the last row, as far as it is known."""

    def tail(self, live: Live) -> tuple[Estimate, ...]:
        """Rows that are not decided."""


@dataclass(frozen=True, slots=True)
class ImpulsiveInputState:
    """Everything the next step needs; decided: rows that the last step settled, oldest first."""

    t: float
    u: Inputs
    started: bool
    live: Initial | IntegralLive | SampledLive
    decided: tuple[Estimate, ...] = ()


@dataclass(frozen=True)
class ImpulsiveInputObserver(PointObserver[ImpulsiveInputState], Delayed[ImpulsiveInputState]):
    """Executes a design of kind `impulsive_input`."""

    gains: IntegralGains | SamplesGains
    engine: Engine[KindState]  # a state goes back to the engine that it came from
    kind: ClassVar[str] = "impulsive_input"
    finds_events: ClassVar[bool] = True

    @classmethod
    def from_gains(cls, gains: Entries) -> ImpulsiveInputObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        typed = gains_from_document(gains)
        if isinstance(typed, IntegralGains):
            return cls(typed, IntegralEngine.from_gains(typed))
        return cls(typed, SamplesEngine.from_gains(typed))

    @property
    def reads(self) -> dict[str, int | bool]:
        """Numbers of y and u in a sample; impulses are not reported."""
        return self.gains.columns | {"w": 0, "jump": False}

    @property
    def event_names(self) -> tuple[str, ...]:
        """Columns of an event file; weights are numbered where H has several columns."""
        q = self.gains.directions
        ends = [""] if q == 1 else [str(i + 1) for i in range(q)]
        weights, spread = (tuple(f"weight{i}{tail}" for i in ends) for tail in ("", "_std"))
        return ("t", *weights, "t_std", *spread, "status")

    def event_cells(self, event: Event) -> Sequence[float | str]:
        """Cells of a decided impulse in an event file."""
        return event.row()

    @property
    def latency(self) -> float:
        """Time by which rows are late at least: the window; confirming a maximum adds to it."""
        return self.gains.window

    def init(
        self, t: float = 0.0, *, x: ArrayLike | None = None, covariance: ArrayLike | None = None
    ) -> ImpulsiveInputState:
        """State at time t from a guess of x(t), before the first sample.

        covariance: (n, n) of that guess, used by `gls`; by default that of `initial_std` of the
        design, and without it taken from the data of the first window: states that would explain
        their range, those of an impulse or each by itself.
        """
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        if not np.isfinite(guess).all():
            raise ValueError("x must be finite.")
        check_size("x", guess[None], np.array([instant(t)]))
        P = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        if P is not None and P.shape != (self.n, self.n):
            raise ValueError(f"covariance must be {self.n}x{self.n}; got shape {P.shape}.")
        if P is not None and not (np.isfinite(P).all() and (np.diag(P) >= 0).all()):
            raise ValueError("covariance must be finite, its diagonal not negative.")
        if P is None and self.gains.initial_std is not None:
            P = np.diag(self.gains.initial_std**2)
        live = Initial(
            t=float(t), x=guess, u=np.zeros(self.gains.inputs), covariance=P, since=float(t)
        )
        return ImpulsiveInputState(t=live.t, u=live.u, started=False, live=live)

    def step(
        self, state: ImpulsiveInputState, sample: Sample
    ) -> tuple[ImpulsiveInputState, Estimate]:
        """Take a sample; the estimate is the prediction at its time, and new events.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        later(sample, state.t, state.started)
        state = self.block(state, [sample])
        events = tuple(event for row in state.decided for event in row.events)
        x = self.engine.prediction(state.live)
        return state, Estimate(state.t, x=x, events=events, status=OPEN)

    def finish(self, state: ImpulsiveInputState) -> tuple[Estimate, ...]:
        """Rows that were not decided when the record ended, as far as they are known."""
        return self.engine.tail(state.live)

    def batch(self, state: ImpulsiveInputState, record: Columns) -> Batch:
        """The whole record in blocks: what `run` gives, faster."""
        t, rows, p, m = record.t, len(record.t), self.gains.p, self.gains.m
        if not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
            raise ValueError("times must be finite and increase.")
        y = np.full((rows, p), np.nan) if record.y is None else record.y
        u = np.zeros((rows, m)) if record.u is None else record.u
        for name, values, width in (("y", y, p), ("u", u, m)):
            if values.shape[1] != width:
                raise ValueError(f"{name} must have {width} entries; got {values.shape[1]}.")
            check_size(name, values, t)
        y = centred(y, self.gains)
        check_resolution(t, self.gains)
        live, estimates = state.live, []
        for k in range(0, rows, _BLOCK):
            cut = slice(k, k + _BLOCK)
            live, decided = self.engine.extended(live, t[cut], y[cut], u[cut])
            estimates += decided
        return collect([*estimates, *self.engine.tail(live)])

    def block(self, state: ImpulsiveInputState, samples: Sequence[Sample]) -> ImpulsiveInputState:
        """The state after several samples at once; `decided` holds the rows they settled.

        Times are the caller's to check: they must increase.
        """
        p, m = self.gains.p, self.gains.inputs
        y, u, held = np.full((len(samples), p), np.nan), np.zeros((len(samples), m)), state.u
        for k, sample in enumerate(samples):
            measured = optional_measurement(sample.y, p)
            if measured is not None:
                y[k] = measured
            held = held if sample.u is None else vector(sample.u, m, "u")
            u[k] = held
        t = np.array([float(sample.t) for sample in samples])
        check_size("y", y, t)
        y = centred(y, self.gains)
        check_size("u", u, t)
        check_resolution(t, self.gains)
        live, decided = self.engine.extended(state.live, t, y, u)
        return replace(
            state, t=float(t[-1]), u=held, started=True, live=live, decided=tuple(decided)
        )
