"""Bounds of an unknown input of bounded rate, beside those of the state.

d is a state of its own, d' = r with |r| <= rate, and in every row its declared bounds are one more
measurement of it: the multiplier observer of (x, d) does the rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.column_names import numbered, pairs
from obsdesign.equations.clocks import EventGains
from obsdesign.equations.noise_bounds import noise_box
from obsdesign.equations.set_membership.gains import IRREGULAR, SetMembershipGains
from obsdesign.runtime.base import Estimate, Sample, vector
from obsdesign.runtime.bounds import Bounds, DeclaredBounds, DeclaredBox, Pair
from obsdesign.runtime.bounds_observer import BoundsObserver
from obsdesign.runtime.boxes import initial_bounds
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.set_membership.clocks import Clocks
from obsdesign.runtime.set_membership.observer import SetMembershipObserver
from obsdesign.runtime.set_membership.state import SetMembershipState


@dataclass(frozen=True)
class InputBoundsObserver(BoundsObserver[SetMembershipState]):
    """Executes a design of kind `set_membership` whose plant has d_bounds with a rate."""

    gains: SetMembershipGains
    kind: ClassVar[str] = "set_membership"

    @classmethod
    def from_gains(cls, gains: Entries) -> InputBoundsObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        made = cls(SetMembershipGains.from_document(gains))
        _ = made._input  # is all there?
        return made

    @property
    def guards(self) -> Sequence[DwellGuard]:
        """A guard for every event of the design."""
        return self._inner.guards

    @property
    def capacities(self) -> Mapping[str, int]:
        """Stages of a window, and boxes of earlier rows."""
        return self._inner.capacities

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the axes of a state's arrays, which is one of (x, d)."""
        return {**self._inner.sizes, "y": self.gains.p}

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, ..., d1_lo, ..., l1_lo, ..., x1_lag_lo, ..."""
        listed = self._of_state.names
        return (*listed[: 2 * self.n], *pairs(numbered("d", self._q)), *listed[2 * self.n :])

    @cached_property
    def declared_bounds(self) -> DeclaredBounds:
        """Bounds of b (or w of b = Bw w) and v that those of a row must not exceed."""
        _, lower, upper = self.gains.declared_disturbance
        v = self._inner.declared_bounds.v
        return DeclaredBounds(
            DeclaredBox("b", lower, upper), None,
            DeclaredBox("v", v.lower[: self.gains.p], v.upper[: self.gains.p]),
        )  # fmt: skip

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> SetMembershipState:
        """State at time t from bounds of x(t); ValueError unless they are finite and in order."""
        low, high = self._extended(lower, upper)
        return self._inner.init(t, lower=low, upper=high)

    def reset(
        self, state: SetMembershipState, *, lower: ArrayLike, upper: ArrayLike
    ) -> SetMembershipState:
        """The same instant with new bounds of x(t): ends the refutation of a state."""
        low, high = self._extended(lower, upper)
        return self._inner.reset(state, lower=low, upper=high)

    def step(
        self, state: SetMembershipState, sample: Sample
    ) -> tuple[SetMembershipState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so; as for the kind."""
        y = np.full(self.gains.p, math.nan)
        if sample.y is not None:
            y = vector(sample.y, self.gains.p, "y")
        bounds = sample.bounds
        if bounds is not None:
            inner = self._inner.declared_bounds
            b, v = _padded(bounds.b, inner.b), _padded(bounds.v, inner.v)
            bounds = Bounds(b, bounds.c, v)
        full = sample._replace(y=np.concatenate([y, np.zeros(self._q)]), bounds=bounds)
        state, estimate = self._inner.step(state, full)
        return state, self._split(estimate)

    def _split(self, estimate: Estimate) -> Estimate:
        n, lower, upper, lagged = self.n, estimate.lower, estimate.upper, estimate.lagged
        assert lower is not None
        assert upper is not None
        return estimate._replace(
            lower=lower[:n], upper=upper[:n], d_bounds=np.stack([lower[n:], upper[n:]]),
            lagged=None if lagged is None else lagged[:, :n],
        )  # fmt: skip

    def _extended(self, lower: ArrayLike, upper: ArrayLike) -> tuple[Matrix, Matrix]:
        """Bounds of (x, d): those of d are the declared ones."""
        low, high = initial_bounds(self.n, lower, upper)
        _, least, most, _ = self._input
        return np.concatenate([low, least]), np.concatenate([high, most])

    @property
    def _q(self) -> int:
        return len(self._input[1])

    @cached_property
    def _input(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """D, lower and upper bounds of d, and of its rate."""
        gains = self.gains
        entries = [gains.D, gains.d_lower, gains.d_upper, gains.d_rate]
        present = [entry for entry in entries if entry is not None]
        if len(present) < len(entries):
            raise ValueError("gains.D, d_lower, d_upper and d_rate belong together.")
        D, lower, upper, rate = present
        return D, lower, upper, rate

    @cached_property
    def _of_state(self) -> SetMembershipObserver:
        """The observer of x alone, for its columns."""
        return SetMembershipObserver(self.gains)

    @cached_property
    def _inner(self) -> SetMembershipObserver:
        return _StateAndInput(_with_input(self.gains, *self._input), self.gains)


@dataclass(frozen=True)
class _StateAndInput(SetMembershipObserver):
    """The multiplier observer of (x, d); declared: gains of the design, with its clocks."""

    declared: SetMembershipGains

    @cached_property
    def _clocks(self) -> Clocks:
        return Clocks(self.declared, further=self.gains.p - self.declared.p)


def _with_input(
    gains: SetMembershipGains, D: Matrix, lower: Matrix, upper: Matrix, rate: Matrix
) -> SetMembershipGains:
    """Gains for (x, d): the last outputs read 0 = d + v, with v between -upper and -lower."""
    (n, q), p = D.shape, gains.p
    # d' = r, in discrete time d(t + dt) = d + dt r
    below, still = np.zeros((q, n)), np.zeros((q, q)) if gains.dt is None else np.eye(q)
    rate = rate if gains.dt is None else np.nextafter(gains.dt * rate, np.inf)
    Bw, least, most = gains.declared_disturbance
    centre, radius = noise_box(np.column_stack([-upper, -lower]))
    own = np.zeros(p) if gains.noise_centre is None else gains.noise_centre
    directions = gains.directions
    return replace(
        gains, A=np.block([[gains.A, D], [below, still]]), C=_diagonal(gains.C, q),
        B=None if gains.B is None else _zeros_below(gains.B, q),
        noise_bound=np.concatenate([gains.noise_bound, radius]),
        noise_centre=np.concatenate([own, np.zeros(q) if centre is None else centre]),
        flow_lower=np.concatenate([gains.flow_lower, -rate]),
        flow_upper=np.concatenate([gains.flow_upper, rate]),
        disturbance_matrix=_diagonal(Bw, q),
        disturbance_lower=np.concatenate([least, -rate]),
        disturbance_upper=np.concatenate([most, rate]),
        events=tuple(_event_with_input(event, q) for event in gains.every_event),
        sensors=(),
        directions=None if directions is None else np.pad(directions, ((0, 0), (0, q))),
        measured=IRREGULAR, period=None, jump_measurement="before", dwell_time=None,
        dwell_jitter=None, G=None, E=None, jump_lower=None, jump_upper=None,
        jump_disturbance_matrix=None, jump_disturbance_lower=None, jump_disturbance_upper=None,
        D=None, d_lower=None, d_upper=None, d_rate=None, multipliers=None,
    )  # fmt: skip


def _event_with_input(event: EventGains, q: int) -> EventGains:
    """The same event for (x, d): d does not jump."""
    columns, _, _ = event.disturbance
    return replace(
        event, G=_diagonal(event.G, q), E=None if event.E is None else _zeros_below(event.E, q),
        disturbance_matrix=_zeros_below(columns, q),
    )  # fmt: skip


def _zeros_below(columns: Matrix, q: int) -> Matrix:
    """The columns of x, which do not act on d."""
    return np.pad(columns, ((0, q), (0, 0)))


def _diagonal(block: Matrix, q: int) -> Matrix:
    """The block, and the identity of d below it."""
    return np.block([
        [block, np.zeros((len(block), q))], [np.zeros((q, block.shape[1])), np.eye(q)],
    ])  # fmt: skip


def _padded(pair: Pair | None, declared: DeclaredBox) -> Pair | None:
    """Bounds of a row, and the declared ones of what stands behind them."""
    if pair is None:
        return None
    more = len(declared.lower)
    ends = [np.asarray(end, dtype=np.float64).reshape(-1) for end in pair]
    low, high = (
        np.pad(end, (0, max(more - len(end), 0)), constant_values=math.nan) for end in ends
    )
    return low, high
