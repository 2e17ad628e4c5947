"""Matrices that follow from the gains of a finite-time observer, each built once."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import UNIT
from obsdesign.equations.finite_time.gains import PRINTED, FiniteTimeGains
from obsdesign.equations.finite_time.rows import (
    last_state,
    least_squares_gain,
    sample_rows,
    state_scales,
)
from obsdesign.runtime.base import MODERATE
from obsdesign.runtime.finite_time.error_radius import WindowError
from obsdesign.runtime.finite_time.flow_maps import FlowMaps, flow_maps
from obsdesign.runtime.finite_time.known_inputs import ApproximateInputs
from obsdesign.runtime.step_cache import shared_step

_LEAST_PERIODS_COUNTED = 64
# singular values of the rows below this part of the largest belong to unobserved states
_UNOBSERVED = 1e-12


@dataclass(frozen=True)
class WindowConstants:
    """The gains of a design, and matrices made of them."""

    gains: FiniteTimeGains
    _steps: dict[float, OrderedDict[tuple[float, int], FlowMaps]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @cached_property
    def n(self) -> int:
        """Number of states."""
        return self.gains.n

    @cached_property
    def p(self) -> int:
        """Number of outputs."""
        return self.gains.p

    @cached_property
    def k(self) -> int:
        """Samples in the window."""
        return self.gains.samples

    @cached_property
    def period(self) -> float:
        """Time from one sample to the next."""
        return self.gains.period

    @cached_property
    def most_periods_counted(self) -> int:
        """Periods that are counted from the same instant: a window, or more for short ones."""
        return max(self.k, _LEAST_PERIODS_COUNTED)

    @cached_property
    def gain(self) -> Matrix:
        """G_0, ..., G_{k-1} side by side, (n, k p)."""
        return np.ascontiguousarray(self.gains.window_gain)

    @cached_property
    def has_moderate_gains(self) -> bool:
        """Are products of the gains with a moderate window finite?"""
        return bool(np.abs(self.gain).max() < MODERATE)

    @cached_property
    def has_bounds(self) -> bool:
        """Are there bounds for disturbance or noise, and hence for the state?"""
        return bool(np.any(0.0 if self.gains.radius is None else self.gains.radius))

    @cached_property
    def is_driven(self) -> bool:
        """Does anything known drive the plant? Otherwise w is zero throughout."""
        return self.gains.B is not None or bool(np.any(self.drift))

    @cached_property
    def is_plain(self) -> bool:
        """Is the estimate the product of the gains with the window, and nothing else?"""
        return not self.is_driven and not self.has_bounds

    # --- the plant ------------------------------------------------------------------------------

    @cached_property
    def drift(self) -> Matrix:
        """Middle of the bounds of b (n,)."""
        return self.gains.flow_drift

    def forced(self, u: Matrix) -> Matrix:
        """B u + b_mid; `drift` itself without inputs."""
        B = self.gains.B
        return self.drift if B is None or not len(u) else self.drift + B.dot(u)

    def forced_size(self, u: Matrix) -> Matrix:
        """|B| |u| + |b_mid|: what the rounding of `forced` is a part of."""
        B, drift = self.gains.B, np.abs(self.drift)
        return drift if B is None or not len(u) else drift + np.abs(B).dot(np.abs(u))

    def driven(self, u: Matrix) -> Matrix:
        """Contribution of the input u to (w, C w) in a period, or to (d, c) of `inputs`."""
        return np.asarray(self._once_and_output.dot(self.forced(u)))

    def maps(self, h: float, size: float, slack: float = 0.0) -> FlowMaps:
        """Matrices of a step of length h between stamps of magnitude at most `size`.

        slack: how far its ends may be from their stamps beyond rounding.
        """
        # a power of two, so that few differ
        slack = 2.0 ** math.ceil(math.log2(slack)) if slack > 0.0 else 0.0
        steps = self._steps.setdefault(slack, OrderedDict())
        return shared_step(steps, h, size, lambda h, error: flow_maps(self.gains, h, error + slack))

    @cached_property
    def period_maps(self) -> FlowMaps:
        """Matrices of a step of one period."""
        return flow_maps(self.gains, self.period, 0.0)

    @cached_property
    def flow_and_output(self) -> Matrix:
        """(A_d, C A_d), (n + p, n)."""
        flow = self.period_maps.flow
        return np.vstack([flow, self.gains.C @ flow])

    @cached_property
    def _once_and_output(self) -> Matrix:
        if self.inputs is not None:  # (14) as printed integrates inputs by itself, without w
            return self.inputs.per_period
        once = self.period_maps.once
        return np.vstack([once, self.gains.C @ once])

    # --- the window -----------------------------------------------------------------------------

    @cached_property
    def rows(self) -> Matrix:
        """C A_d^(j-k), or relative to the start C A_d^j, (k p, n)."""
        gains = self.gains
        rows = sample_rows(gains.A, gains.C, self.period, self.k, gains.window_reference)
        return rows.reshape(-1, self.n)

    @cached_property
    def scales(self) -> Matrix:
        """Units of the states for this window (n,), see `state_scales`."""
        return np.asarray(state_scales(self.gains.A, self.gains.C, self.gains.window))

    @cached_property
    def last(self) -> Matrix:
        """x(t_i) as a function of the state that `rows` speak of, (n, n)."""
        if self.has_bounds and self.error.start is not None:
            return self.error.start.last.mid
        return last_state(self.gains.A, self.gains.window, self.gains.window_reference)

    @cached_property
    def start_gain(self) -> Matrix | None:
        """Gain (n, k p) from the residuals to x(t_i - T) - w; None where rows speak of x(t_i).

        It leaves unobserved states where they are.
        """
        if not self.gains.is_relative_to_start:
            return None
        return least_squares_gain(self.rows, np.ones(len(self.rows)), _UNOBSERVED)

    @cached_property
    def reproduced_state(self) -> Matrix:
        """sum_j G_j C A_d^(j-k): the identity, but for (14) with its delay taken off."""
        if self.gains.is_unbiased:
            return np.eye(self.n)
        return np.asarray(self.gains.window_gain @ self.rows)

    @cached_property
    def inputs(self) -> ApproximateInputs | None:
        """Known inputs of (14) as printed; None for every other method."""
        if self.gains.is_unbiased or self.gains.half_sample != PRINTED:
            return None
        return ApproximateInputs.from_gains(self.gains)

    # --- bounds ---------------------------------------------------------------------------------

    def output_rounding(self, w: Matrix) -> Matrix:
        """Bound (n,) of the rounding of C w, as an error of w."""
        return ((self.n + 32) * UNIT) * np.abs(w)

    @cached_property
    def error(self) -> WindowError:
        """Constants of the radius, for a design that has one."""
        return WindowError.from_gains(self.gains)

    @cached_property
    def has_finite_radius(self) -> bool:
        """Is the radius of ordinary data finite? States that no sample shows have no bound."""
        ones = np.ones(self.n)
        with np.errstate(over="ignore", invalid="ignore"):
            radius = self.error.radius(1.0, ones, ones, 0 * ones, ones)
        return bool(np.isfinite(radius).all())
