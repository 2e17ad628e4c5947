"""Steps of the unknown-input observer: formulas (30), (31), (33), and their matrices.

Of two equal steps in a row the second is one product with a shared matrix, any other is a solution
of (30). Source: P. Ahn (2002), (14), (29)-(34).
"""

from __future__ import annotations

import math
from collections import OrderedDict
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.spectrum import spectral_radius
from obsdesign.equations.unknown_input.formulas import DAMPING, STEP_LIMIT
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.runtime.state_marks import Axes, Outputs
from obsdesign.runtime.status import Reason, status_of
from obsdesign.runtime.step_cache import cached_step

# time stamps must resolve a step to this part of its length
_RESOLVED = 0.01
# gains and lengths of a step with which moderate numbers cannot overflow
_LARGEST_GAIN, SHORTEST, LONGEST = 1e30, 1e-30, 1e30


class Interval(NamedTuple):
    """The last interval between measurements.

    length: its time; step: the matrix of such steps, None until a second one follows; status: "ok",
    or why steps of this length are no good; is_resolved: time stamps are fine enough for it, so
    that its matrix is worth keeping.
    """

    length: float
    step: Annotated[Matrix, Axes("out in")] | None
    status: str
    is_resolved: bool


# derivative of the measurement over an interval: length, mean of y, y'
Slope = tuple[float, Outputs, Outputs]


def damped_slope(before: Slope | None, h: float, y_before: Matrix, y: Matrix) -> Slope:
    """y' of (14) with the pole at -DAMPING instead of -1; intervals of any length."""
    mean = (y + y_before) / 2
    if before is None:
        return h, mean, (y - y_before) / h
    h_before, mean_before, slope = before
    r = DAMPING
    return h, mean, (1 + r) * (mean - mean_before) / ((h + h_before) / 2) - r * slope


class Steps:
    """Steps [w; y_prev; y; U] -> [w+; x; d] of an observer; with `damped`, d without N Y'.

    U is the mean of [u; 1] over the step.
    """

    def __init__(self, gains: UnknownInputGains) -> None:
        g, k, p = gains, gains.k, gains.p
        self.gains, self.is_damped = gains, gains.differentiator == "damped"
        self.shape = (p,)  # of a measurement
        self.cache: OrderedDict[float, Matrix] = OrderedDict()
        numbers = [np.abs(X).max() for X in vars(g).values() if np.ndim(X) and np.size(X)]
        self.has_usual_gains = bool(max(numbers) < _LARGEST_GAIN)
        self._fastest = spectral_radius(g.F)
        # places of y in what is known before a step, and of what it gives
        self.y = slice(k + p, k + 2 * p)
        self.w, self.x, self.d = slice(k), slice(k, k + g.n), slice(k + g.n, k + g.n + g.q)

    def interval(self, before: Interval | None, h: float, size: float) -> Interval:
        """The interval of length h at times of the given size: usually the one before once more.

        Decided by the state alone, so that a stream gives the same numbers whatever ran before.
        """
        if before is None or abs(h - before.length) > 2 * math.ulp(size):
            return self._first_interval(h, size)
        if before.step is not None:
            return before
        step = cached_step(self.cache, h, self.matrix) if before.is_resolved else None
        return before._replace(length=h, step=step)

    def _first_interval(self, h: float, size: float) -> Interval:
        reasons = list[Reason]()
        is_resolved = 4 * math.ulp(size) <= _RESOLVED * h
        if not is_resolved:
            text = f"time stamps resolve {2 * math.ulp(size):.2g} for sampling time {h:.9g}"
            reasons.append(Reason(text, "time stamps too coarse for the sampling time", h))
        if h * self._fastest > STEP_LIMIT:
            limit = STEP_LIMIT / self._fastest
            reasons.append(Reason.measured("sampling time", h, f"above {limit:.6g} = 2/|f|"))
        return Interval(h, None, status_of(reasons), is_resolved)

    def matrix(self, h: float) -> Matrix:
        """The matrix of a step of length h."""
        g = self.gains
        F, k, p = g.F, g.k, g.p
        eye, half = np.eye(k), h / 2 * F
        driven = np.hstack([eye + half, h / 2 * g.H, h / 2 * g.H, h * g.Gu])
        w = np.linalg.solve(eye - half, driven)  # (30)
        x = g.X @ w  # (31)
        x[:, k + p : k + 2 * p] += g.Xy  # (31)
        w_mean = w / 2
        w_mean[:, :k] += eye / 2
        slope = np.zeros_like(g.N) if self.is_damped else g.N / h  # (34)
        d = g.Q @ w_mean  # (33)
        d += np.hstack([np.zeros(g.Q.shape), g.R / 2 - slope, g.R / 2 + slope, g.S])  # (33)
        return np.vstack([w, x, d])

    @cached_property
    def free(self) -> FreeStep:
        """Steps of lengths that come once."""
        return FreeStep(self.gains, self.is_damped)


class FreeStep:
    """A step of any length without its matrix: one solution of (I - hF/2) w+ = ..., no cache."""

    def __init__(self, g: UnknownInputGains, damped: bool) -> None:
        n, k, p, q, v = g.n, g.k, g.p, g.q, g.m + 1
        self.k, self.q, self.eye, self.half = k, q, np.eye(k), g.F / 2
        slope = np.zeros_like(g.N) if damped else g.N
        # [w; y_prev; y; U] -> the driven part of w', that of [x; d] beside w+, and N (y - y_prev)
        self.driven = np.block(
            [
                [g.F / 2, g.H / 2, g.H / 2, g.Gu],  # (30)
                [np.zeros((n, k)), np.zeros((n, p)), g.Xy, np.zeros((n, v))],  # (31)
                [g.Q / 2, g.R / 2, g.R / 2, g.S],  # (33)
                [np.zeros((q, k)), -slope, slope, np.zeros((q, v))],  # (34)
            ]
        )
        self.end = np.vstack([g.X, g.Q / 2])  # (31), (33)

    def estimates(self, h: float, known: Matrix) -> Matrix:
        """[w+; x; d] as `Steps.matrix` gives them."""
        k, q, driven = self.k, self.q, self.driven.dot(known)
        w = known[:k] + h * driven[:k]
        if k:
            w = np.linalg.solve(self.eye - h * self.half, w)
        estimate = driven[k:-q] + self.end.dot(w)
        estimate[-q:] += driven[-q:] / h
        return np.concatenate((w, estimate))
