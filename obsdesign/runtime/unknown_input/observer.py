"""Unknown-input observer at run time: one stacked product per sample.

    w+   = Ad w + Bw (Gu U + H Yc),  Yc = (y + y_prev)/2, U = mean of [u; 1]     (29), (30)
    x    = X w+ + Xy y                                       at the time of the sample, (31)
    d    = Q Wc + R Yc + S U + N Y'                          mean over the interval, (33)

with Ad = (I - hF/2)^-1 (I + hF/2), Bw = h (I - hF/2)^-1, Wc = (w + w+)/2. Y' is the difference
quotient (y - y_prev)/h (`cell`) or its damped recursion (`damped`); (34) needs no recursion, see
`equations.block_pulse`. With `batch`, `run` smooths the whole record to its noise first, and `step`
takes samples as they come; with `fixed_lag` see `fixed_lag.py`.

A step covers the time since the last measurement, of any length: of two equal ones in a row the
second is one product, any other is a solution of (30).
Source: P. Ahn (2002), (29)-(34).
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.equations.unknown_input.formulas import DAMPING, STEP_LIMIT
from obsdesign.equations.unknown_input.gains import UnknownInputGains
from obsdesign.equations.unknown_input.smoothing import smoothed
from obsdesign.runtime.base import (
    MODERATE,
    Estimate,
    Sample,
    Stepped,
    Vector,
    centred,
    later,
    optional_measurement,
    status_of,
    vector,
)
from obsdesign.runtime.point_observer import PointObserver
from obsdesign.runtime.step_cache import cached_step

# of measurements: differences and products of larger ones overflow
_LARGEST = 1e150


class Interval(NamedTuple):
    """The last interval between measurements.

    length: its time; step: the matrix of such steps, None until a second one follows; status: "ok",
    or why steps of this length are no good; is_resolved: time stamps are fine enough for it, so
    that its matrix is worth keeping.
    """

    length: float
    step: Vector | None
    status: str
    is_resolved: bool


class UnknownInputState(NamedTuple):
    """Everything the next step needs.

    t: time of the last row; t_measured, w, y: time, reduced state and output at the last
    measurement (y None: none yet, w then a guess or None); u: [u; 1] held since t; u_integral:
    integral of it since t_measured; slope: (h, mean of y, y') of the last interval, for `damped`;
    interval: the last one; moderate: w, x and d are below `MODERATE`.
    """

    t: float
    t_measured: float
    x: Vector
    w: Vector | None
    y: Vector | None
    u: Vector
    u_integral: Vector | None = None
    slope: tuple[float, Vector, Vector] | None = None
    interval: Interval | None = None
    started: bool = True
    moderate: bool = False


def stacked(g: UnknownInputGains, h: float, damped: bool) -> Vector:
    """[w; y_prev; y; U] -> [w+; x; d] for an interval of length h; with damped, d without N Y'."""
    F, k, p = g.F, g.k, g.p
    eye, half = np.eye(k), h / 2 * F
    driven = np.hstack([eye + half, h / 2 * g.H, h / 2 * g.H, h * g.Gu])
    w = np.linalg.solve(eye - half, driven)  # (30)
    x = g.X @ w  # (31)
    x[:, k + p : k + 2 * p] += g.Xy
    w_mean = w / 2
    w_mean[:, :k] += eye / 2
    slope = np.zeros_like(g.N) if damped else g.N / h
    d = g.Q @ w_mean  # (33)
    d += np.hstack([np.zeros(g.Q.shape), g.R / 2 - slope, g.R / 2 + slope, g.S])
    return np.vstack([w, x, d])


class FreeStep:
    """A step of any length without its matrix: one solution of (I - hF/2) w+ = ..., no cache."""

    def __init__(self, g: UnknownInputGains, damped: bool) -> None:
        n, k, p, q, v = g.n, g.k, g.p, g.q, g.m + 1
        self.k, self.q, self.eye, self.half = k, q, np.eye(k), g.F / 2
        slope = np.zeros_like(g.N) if damped else g.N
        # [w; y_prev; y; U] -> the driven part of w', that of [x; d] beside w+, and N (y - y_prev)
        self.known = np.block(
            [
                [g.F / 2, g.H / 2, g.H / 2, g.Gu],
                [np.zeros((n, k)), np.zeros((n, p)), g.Xy, np.zeros((n, v))],
                [g.Q / 2, g.R / 2, g.R / 2, g.S],
                [np.zeros((q, k)), -slope, slope, np.zeros((q, v))],
            ]
        )
        self.end = np.vstack([g.X, g.Q / 2])

    def estimates(self, h: float, known: Vector) -> tuple[Vector, Vector]:
        """(w+, [x; d]) as `stacked` gives them in one."""
        k, q, driven = self.k, self.q, self.known.dot(known)
        w = known[:k] + h * driven[:k]
        if k:
            w = np.linalg.solve(self.eye - h * self.half, w)
        estimate = driven[k:-q] + self.end.dot(w)
        estimate[-q:] += driven[-q:] / h
        return w, estimate


def _input_integral(state: UnknownInputState, t: float) -> Vector:
    """Integral of [u; 1] since the last measurement."""
    return state.u * (t - state.t) + (0.0 if state.u_integral is None else state.u_integral)


def damped_slope(state: UnknownInputState, h: float, y: Vector) -> tuple[float, Vector, Vector]:
    """(h, mean of y, y') with the pole at -DAMPING; intervals of any length."""
    assert state.y is not None
    mean = (y + state.y) / 2
    if state.slope is None:
        return h, mean, (y - state.y) / h
    before, mean_before, slope = state.slope
    r = DAMPING
    return h, mean, (1 + r) * (mean - mean_before) / ((h + before) / 2) - r * slope


def usable(y: ArrayLike | None, size: int) -> tuple[Vector | None, str]:
    """(the measurement or None, why it is not used)."""
    measurement = optional_measurement(y, size)
    if measurement is None:
        return None, "missing sample"
    if not np.abs(measurement).max() < _LARGEST:
        return None, f"measurement beyond {_LARGEST:g}"
    return measurement, ""


def copied(sample: Sample) -> Sample:
    """A sample that outlives the caller's arrays."""
    y, u = (None if values is None else np.array(values) for values in (sample.y, sample.u))
    return sample._replace(y=y, u=u)


def smoothed_record(samples: Sequence[Sample], deviation: Vector) -> list[Sample]:
    """The samples with each output smoothed to its noise; missing ones stay missing."""
    rows = [usable(sample.y, len(deviation))[0] for sample in samples]
    measured = [k for k, y in enumerate(rows) if y is not None]
    if not measured:
        return list(samples)
    t = np.array([float(samples[k].t) for k in measured])
    if not np.all(np.diff(t) > 0):
        raise ValueError("time must increase in a record that is smoothed.")
    values = smoothed(t, np.array([rows[k] for k in measured]), deviation)
    result = list(samples)
    for k, y in zip(measured, values, strict=True):
        result[k] = samples[k]._replace(y=y)
    return result


# time stamps must resolve a step to this part of its length
_RESOLVED = 0.01
# gains, and lengths of a step and their inverses, with which moderate numbers cannot overflow
_USUAL = 1e30


@dataclass(frozen=True)
class UnknownInputObserver(PointObserver[UnknownInputState], Stepped[UnknownInputState]):
    """Executes a design of kind `unknown_input`."""

    gains: UnknownInputGains
    kind: ClassVar[str] = "unknown_input"
    finds_events: ClassVar[bool] = False
    _steps: OrderedDict[float, Vector] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> UnknownInputObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        return cls(UnknownInputGains.from_document(gains))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        states = (f"x{i + 1}" for i in range(self.gains.n))
        return (*states, *(f"d{i + 1}" for i in range(self.gains.q)))

    @property
    def takes_whole_records(self) -> bool:
        """Whether `run` needs all rows at once."""
        return self.gains.differentiator == "batch"

    @property
    def _noise_std(self) -> Vector:
        assert self.gains.noise_std is not None
        return self.gains.noise_std

    @cached_property
    def _damped(self) -> bool:
        return self.gains.differentiator == "damped"

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> UnknownInputState:
        """State at time t, before the first sample.

        x: a guess of x(t), of which T x is kept; zeros give the paper's w(0) = 0. None: the w(0)
        of least norm that agrees with the first sample.
        """
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        with np.errstate(over="ignore", invalid="ignore"):
            w = None if x is None else self.gains.T @ guess
        inputs = np.zeros(int(self.reads["u"]) + 1)
        inputs[-1] = 1.0
        t = float(t)
        return UnknownInputState(t=t, t_measured=t, x=guess, w=w, y=None, u=inputs, started=False)

    def step(self, state: UnknownInputState, sample: Sample) -> tuple[UnknownInputState, Estimate]:
        """Move to the time of the sample and use it.

        ValueError if time does not increase (the first sample may share the initial time), or if
        the sample says jump.
        """
        if sample.jump:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        t = later(sample.t, state.t, state.started)
        y = self._measurement(sample.y)
        if y is not None and state.moderate and 1.0 / _USUAL < t - state.t_measured < _USUAL:
            return self._step(state, t, y, sample)  # no overflow: `errstate` takes its time
        with np.errstate(over="ignore", invalid="ignore"):  # the status names what is not finite
            return self._step(state, t, y, sample)

    def _step(
        self, state: UnknownInputState, t: float, y: Vector | None, sample: Sample
    ) -> tuple[UnknownInputState, Estimate]:
        u, why = state.u, ""
        if y is None:
            y, why = usable(sample.y, self.gains.p)
        y = None if y is None else centred(y, self.gains)
        if sample.u is not None and len(u) > 1:
            u = np.append(vector(sample.u, len(u) - 1, "u"), 1.0)
        if state.y is None or state.w is None:
            return self._first(state, t, y, u, why)
        h = t - state.t_measured
        interval, u_integral = self._interval(state, h, t), None
        if y is None or state.u_integral is not None:
            u_integral = _input_integral(state, t)
        mean = state.u if u_integral is None else u_integral / h
        known = np.concatenate((state.w, state.y, state.y if y is None else y, mean))
        w, x, d = self._estimates(interval, h, known)
        if y is None:
            estimate = Estimate(t, x=x, d=d * np.nan, status=why)
            return state._replace(t=t, x=x, u=u, u_integral=u_integral), estimate
        slope, status = None, interval.status
        if self._damped:
            slope = damped_slope(state, h, y)
            d = d + self.gains.N @ slope[2]
        small = self._has_usual_gains
        small &= math.hypot(*w.tolist(), *x.tolist(), *d.tolist()) < MODERATE
        if not small:
            status = status_of([status] if status != "ok" else [], x, d)
        if u is not state.u or not state.moderate:
            small &= math.hypot(*u.tolist()) < MODERATE
        # y from `known`: the sample's own array is the caller's
        start = len(w) + len(y)
        y = known[start : start + len(y)]
        # in the order of the fields: names would cost a tenth of the step
        following = UnknownInputState(t, t, x, w, y, u, None, slope, interval, True, small)
        return following, Estimate(t, x=x, d=d, status=status)

    def _estimates(
        self, interval: Interval, h: float, known: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """(w+, x, d) from [w; y_prev; y; U]; with `damped`, d without N Y'."""
        k, q = self._sizes
        if interval.step is None:
            w, estimate = self._free.estimates(h, known)
        else:
            estimate = interval.step.dot(known)
            w, estimate = estimate[:k], estimate[k:]
        return w, estimate[:-q], estimate[-q:]

    def run(self, state: UnknownInputState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples; with `batch`, of the record smoothed as a whole."""
        if self.takes_whole_records:
            samples = smoothed_record([copied(row) for row in samples], self._noise_std)
        return super().run(state, samples)

    def _first(
        self, state: UnknownInputState, t: float, y: Vector | None, u: Vector, why: str
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

    def _measurement(self, y: ArrayLike | None) -> Vector | None:
        """The array itself if its length alone shows that every entry is usable."""
        if type(y) is np.ndarray and y.dtype.char == "d" and y.shape == (self.gains.p,):
            return y if math.hypot(*y.tolist()) < MODERATE else None
        return None

    def _interval(self, state: UnknownInputState, h: float, t: float) -> Interval:
        """The interval of length h that ends at t: usually the one before, once more.

        Decided by the state alone, so that a stream gives the same numbers whatever ran before.
        """
        before, size = state.interval, max(abs(t), abs(state.t))
        if before is None or abs(h - before.length) > 2 * math.ulp(size):
            return self._first_interval(h, size)
        if before.step is not None:
            return before
        step = cached_step(self._steps, h, self._stacked) if before.is_resolved else None
        return before._replace(length=h, step=step)

    def _stacked(self, h: float) -> Vector:
        """The matrix of a step of length h."""
        return stacked(self.gains, h, self._damped)

    @cached_property
    def _sizes(self) -> tuple[int, int]:
        return self.gains.k, self.gains.q

    @cached_property
    def _free(self) -> FreeStep:
        return FreeStep(self.gains, self._damped)

    @cached_property
    def _has_usual_gains(self) -> bool:
        numbers = [np.abs(g).max() for g in vars(self.gains).values() if np.ndim(g) and np.size(g)]
        return bool(max(numbers) < _USUAL)

    @cached_property
    def _fastest(self) -> float:
        F = self.gains.F
        return float(np.abs(np.linalg.eigvals(F)).max()) if F.size else 0.0

    def _first_interval(self, h: float, size: float) -> Interval:
        """The first interval of length h, at times of the given size."""
        reasons = []
        is_resolved = 4 * math.ulp(size) <= _RESOLVED * h
        if not is_resolved:
            reasons.append(
                f"time stamps resolve {2 * math.ulp(size):.2g} for sampling time {h:.9g}"
            )
        if h * self._fastest > STEP_LIMIT:
            limit = STEP_LIMIT / self._fastest
            reasons.append(f"sampling time {h:.9g} above {limit:.6g} = 2/|f|")
        return Interval(h, None, "; ".join(reasons) or "ok", is_resolved)
