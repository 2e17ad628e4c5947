"""What follows from the gains of a finite-time observer, worked out once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from obsdesign.equations.finite_time import gains as equations
from obsdesign.runtime.base import MODERATE, Vector
from obsdesign.runtime.finite_time.error_radius import WindowError
from obsdesign.runtime.finite_time.flow_maps import FlowMaps, flow_maps
from obsdesign.runtime.finite_time.known_inputs import ApproximateInputs

_LEAST_TICKS = 64
_UNSEEN = 1e-12


@dataclass(frozen=True)
class WindowConstants:
    """The gains of a design, and matrices made of them."""

    gains: Mapping[str, Any]
    _steps: OrderedDict[tuple[float, int], Any] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @cached_property
    def k(self) -> int:
        """Samples in the window."""
        return int(self.gains["samples"])

    @cached_property
    def _most_ticks(self) -> int:
        """Instants that are counted from the same one: a window, and not too few."""
        return max(self.k, _LEAST_TICKS)

    @cached_property
    def bounded(self) -> bool:
        """Are there bounds for disturbance or noise, and hence for the state?"""
        return bool(np.any(self.gains.get("radius", 0.0)))

    def _drive(self, u: Vector) -> Vector:
        return np.asarray(self._once_and_seen.dot(self._forced(u)))

    def _forced(self, u: Vector) -> Vector:
        return self._middle + self.gains["B"].dot(u) if len(u) else self._middle

    @cached_property
    def _p(self) -> int:
        return len(self.gains["C"])

    @cached_property
    def _gain(self) -> Vector:
        return np.ascontiguousarray(self.gains["window_gain"])

    @cached_property
    def _moderate_gains(self) -> bool:
        """Are products of the gains with a moderate window finite?"""
        return bool(np.abs(self._gain).max() < MODERATE)

    @cached_property
    def _middle(self) -> Vector:
        return np.asarray((self.gains["flow_lower"] + self.gains["flow_upper"]) / 2)

    @cached_property
    def _period(self) -> float:
        return float(self.gains["period"])

    @cached_property
    def _driven(self) -> bool:
        """Does anything known drive the plant? If not, w is zero and stays so."""
        return "B" in self.gains or bool(np.any(self._forced(np.zeros(0))))

    @cached_property
    def _period_maps(self) -> FlowMaps:
        return flow_maps(self.gains, self._period, 0.0)

    @cached_property
    def _flow_and_seen(self) -> Vector:
        flow = self._period_maps.flow
        return np.vstack([flow, self.gains["C"] @ flow])

    @cached_property
    def _once_and_seen(self) -> Vector:
        if self._inputs is not None:  # (14) as printed has its own way, and no need of w
            return self._inputs.of_period
        once = self._period_maps.once
        return np.vstack([once, self.gains["C"] @ once])

    @cached_property
    def _rows(self) -> Vector:
        """C A_d^(j-k), or C A_d^j where the window speaks of its start, (k p, n)."""
        gains = self.gains
        rows = equations.sample_rows(gains["A"], gains["C"], self._period, self.k, self._reference)
        return rows.reshape(-1, len(self.gains["A"]))

    @cached_property
    def _reference(self) -> str:
        return str(self.gains.get("reference", equations.END))

    @cached_property
    def _last(self) -> Vector:
        """x(t_i) as a function of what `_rows` speak of."""
        if self.bounded and self._error.start is not None:
            return self._error.start.last.mid
        return equations.last_state(self.gains["A"], self.k * self._period, self._reference)

    @cached_property
    def _of_start(self) -> Vector | None:
        """x(t_i - T) - w from the window; None where the window speaks of its end."""
        if self._reference == equations.END:
            return None
        # what the window does not see need not move
        return equations.least_squares_gain(self._rows, np.ones(len(self._rows)), _UNSEEN)

    @cached_property
    def _scales(self) -> Vector:
        A, C = self.gains["A"], self.gains["C"]
        return np.asarray(equations.state_scales(A, C, self.k * self._period))

    @cached_property
    def _seen_back(self) -> Vector:
        """sum_j G_j C A_d^(j-k): the identity, but for (14) with its delay taken off."""
        if self.gains["method"] != "approximate":
            return np.eye(len(self.gains["A"]))
        return np.asarray(self.gains["window_gain"] @ self._rows)

    @cached_property
    def _error(self) -> WindowError:
        return WindowError.of(self.gains)

    @cached_property
    def _has_bounds(self) -> bool:
        """Is the radius of ordinary data finite? States that no sample shows have no bound."""
        one = np.ones(len(self.gains["A"]))
        with np.errstate(over="ignore", invalid="ignore"):
            radius = self._error.radius(1.0, one, one, 0 * one, one)
        return self.bounded and bool(np.isfinite(radius).all())

    @cached_property
    def _inputs(self) -> ApproximateInputs | None:
        """How (14) as printed treats known inputs; None for every other method."""
        if self.gains["method"] != "approximate" or self.gains["half_sample"] != "printed":
            return None
        return ApproximateInputs.of(self.gains)
