"""Unknown-input observer at run time: one stacked product per sample.

    w+   = Ad w + Bw (Gu U + H Yc),  Yc = (y + y_prev)/2, U = mean of [u; 1]     (29), (30)
    x    = X w+ + Xy y                                       at the time of the sample, (31)
    d    = Q Wc + R Yc + S U + N Y'                          mean over the interval, (33)

with Ad = (I - hF/2)^-1 (I + hF/2), Bw = h (I - hF/2)^-1, Wc = (w + w+)/2. Y' is the difference
quotient (y - y_prev)/h (`cell`) or its damped recursion (`damped`); (34) needs no recursion, see
`equations.block_pulse`. With `batch`, `run` smooths the whole record to its noise first, and `step`
takes samples as they come; with `fixed_lag` see `runtime.fixed_lag`.

A step covers the time since the last sample that was there, of any length: of two equal ones in a
row the second is one product, any other is a solution of (30).
Source: P. Ahn (2002), (29)-(34).

What one step of the unknown-input observer is made of: state, matrix, differentiator.
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

from obsdesign.equations.unknown_input import matrices as equations
from obsdesign.equations.unknown_input.smoothing import smoothed
from obsdesign.runtime.base import (
    MODERATE,
    Batch,
    Estimate,
    Sample,
    Stepped,
    Vector,
    centred,
    collect,
    first_time,
    later,
    optional_measurement,
    rows_of,
    status_of,
    vector,
)
from obsdesign.runtime.point_observer import PointObserver
from obsdesign.runtime.step_cache import cached_step

# of measurements: differences and products of larger ones overflow
_LARGEST = 1e150


class UnknownInputState(NamedTuple):
    """Everything the next step needs.

    t: time of the last row; t_seen, w, y: time, reduced state and output at the last measurement
    (y None: none yet, w then a guess or None); u: [u; 1] held since t; used: integral of it since
    t_seen; slope: (h, mean of y, y') of the last interval, for `damped`; last: its length, the
    matrix of such steps (None until a second one follows) and what there is to say of them;
    moderate: w, x and d are below `MODERATE`.
    """

    t: float
    t_seen: float
    x: Vector
    w: Vector | None
    y: Vector | None
    u: Vector
    used: Vector | None
    slope: tuple[float, Vector, Vector] | None = None
    last: tuple[float, Vector | None, str] | None = None
    started: bool = True
    moderate: bool = False


def stacked(g: Mapping[str, Any], h: float, damped: bool) -> Vector:
    """[w; y_prev; y; U] -> [w+; x; d] for an interval of length h; with damped, d without N Y'."""
    F, p = g["F"], len(g["C"])
    eye, half = np.eye(len(F)), h / 2 * F
    driven = np.hstack([eye + half, h / 2 * g["H"], h / 2 * g["H"], h * g["Gu"]])
    w = np.linalg.solve(eye - half, driven)
    x = g["X"] @ w
    x[:, len(F) + p : len(F) + 2 * p] += g["Xy"]
    w_mean = w / 2
    w_mean[:, : len(F)] += eye / 2
    slope = np.zeros_like(g["N"]) if damped else g["N"] / h
    d = g["Q"] @ w_mean
    d += np.hstack([np.zeros(g["Q"].shape), g["R"] / 2 - slope, g["R"] / 2 + slope, g["S"]])
    return np.vstack([w, x, d])


class FreeStep:
    """A step of any length without its matrix: one solution of (I - hF/2) w+ = ..., no cache."""

    def __init__(self, g: Mapping[str, Any], damped: bool) -> None:
        F, H, N, (n, k) = g["F"], g["H"], g["N"], g["X"].shape
        self.k, self.q, self.eye, self.half = k, len(N), np.eye(k), F / 2
        slope = np.zeros_like(N) if damped else N
        # [w; y_prev; y; U] -> the driven part of w', that of [x; d] beside w+, and N (y - y_prev)
        self.known = np.block(
            [
                [F / 2, H / 2, H / 2, g["Gu"]],
                [
                    np.zeros((n, k)),
                    np.zeros((n, len(g["C"]))),
                    g["Xy"],
                    np.zeros((n, g["S"].shape[1])),
                ],
                [g["Q"] / 2, g["R"] / 2, g["R"] / 2, g["S"]],
                [np.zeros((len(N), k)), -slope, slope, np.zeros(g["S"].shape)],
            ]
        )
        self.end = np.vstack([g["X"], g["Q"] / 2])

    def of(self, h: float, known: Vector) -> tuple[Vector, Vector]:
        """(w+, [x; d]) as `stacked` gives them in one."""
        k, q, driven = self.k, self.q, self.known.dot(known)
        w = known[:k] + h * driven[:k]
        if k:
            w = np.linalg.solve(self.eye - h * self.half, w)
        found = driven[k:-q] + self.end.dot(w)
        found[-q:] += driven[-q:] / h
        return w, found


def damped_slope(state: UnknownInputState, h: float, y: Vector) -> tuple[float, Vector, Vector]:
    """(h, mean of y, y') with the pole at -DAMPING; intervals of any length."""
    assert state.y is not None
    mean = (y + state.y) / 2
    if state.slope is None:
        return h, mean, (y - state.y) / h
    before, mean_before, slope = state.slope
    r = equations.DAMPING
    return h, mean, (1 + r) * (mean - mean_before) / ((h + before) / 2) - r * slope


def usable(y: ArrayLike | None, size: int) -> tuple[Vector | None, str]:
    """(the measurement or None, why it is not used)."""
    found = optional_measurement(y, size)
    if found is None:
        return None, "missing sample"
    if not np.abs(found).max() < _LARGEST:
        return None, f"measurement beyond {_LARGEST:g}"
    return found, ""


def kept(sample: Sample) -> Sample:
    """A sample that outlives the caller's arrays."""
    y, u = (None if values is None else np.array(values) for values in (sample.y, sample.u))
    return sample._replace(y=y, u=u)


def smoothed_record(samples: Sequence[Sample], deviation: Vector) -> list[Sample]:
    """The samples with each output smoothed to its noise; missing ones stay missing."""
    rows = [usable(sample.y, len(deviation))[0] for sample in samples]
    there = [k for k, y in enumerate(rows) if y is not None]
    if not there:
        return list(samples)
    t = np.array([float(samples[k].t) for k in there])
    if not np.all(np.diff(t) > 0):
        raise ValueError("time must increase in a record that is smoothed.")
    values = smoothed(t, np.array([rows[k] for k in there]), deviation)
    result = list(samples)
    for k, y in zip(there, values, strict=True):
        result[k] = samples[k]._replace(y=y)
    return result


# time stamps must tell a step to this part of its length
_RESOLVED = 0.01
# gains, and lengths of a step and their inverses, with which moderate numbers cannot overflow
_USUAL = 1e30
_COARSE = "time stamps resolve"


@dataclass(frozen=True)
class UnknownInputObserver(PointObserver[UnknownInputState], Stepped[UnknownInputState]):
    """Executes a design of kind `unknown_input`."""

    gains: Mapping[str, Any]
    _k: int  # n - q
    _p: int
    _q: int
    _damped: bool
    kind: ClassVar[str] = "unknown_input"
    finds_events: ClassVar[bool] = False
    _steps: OrderedDict[float, Vector] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> UnknownInputObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        for name in ("A", "C", "D"):
            if np.ndim(gains.get(name, 0)) != 2:
                raise ValueError(f"gains.{name} must be a matrix.")
        (n, q), p = np.shape(gains["D"]), len(gains["C"])
        m = np.shape(gains["B"])[1] if "B" in gains else 0
        complete = dict(gains)
        for name, shape in equations.shapes(n, p, q, m).items():
            value = gains.get(name, np.zeros(shape) if 0 in shape else None)
            if not isinstance(value, np.ndarray) or value.shape != shape:
                found = "nothing" if value is None else f"shape {np.shape(value)}"
                raise ValueError(f"gains.{name} must have shape {shape}; got {found}.")
            complete[name] = value
        chosen = complete.get("differentiator")
        if chosen not in equations.DIFFERENTIATORS:
            words = ", ".join(equations.DIFFERENTIATORS)
            raise ValueError(f"gains.differentiator must be one of {words}.")
        if chosen in equations.SMOOTHING and np.shape(gains.get("noise_std", 0)) != (p,):
            raise ValueError(f"gains.noise_std must have shape ({p},).")
        return cls(complete, n - q, p, q, chosen == "damped")

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t."""
        n, q = self.gains["D"].shape
        return (*(f"x{i + 1}" for i in range(n)), *(f"d{i + 1}" for i in range(q)))

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        inputs = self.gains["Gu"].shape[1] if self.gains["Gu"].size else self.gains["S"].shape[1]
        return {"y": len(self.gains["C"]), "u": inputs - 1, "w": 0, "jump": False}

    @property
    def takes_whole_records(self) -> bool:
        """Does `run` need all rows at once?"""
        return bool(self.gains["differentiator"] == "batch")

    def init(self, t: float = 0.0, *, x: ArrayLike | None = None) -> UnknownInputState:
        """State at time t, before the first sample.

        x: a guess of x(t), of which T x is kept; zeros give the paper's w(0) = 0. None: the w(0)
        of least norm that agrees with the first sample.
        """
        guess = vector(np.zeros(self.n) if x is None else x, self.n, "x")
        with np.errstate(over="ignore", invalid="ignore"):
            w = None if x is None else self.gains["T"] @ guess
        inputs = np.zeros(int(self.reads["u"]) + 1)
        inputs[-1] = 1.0
        t = float(t)
        return UnknownInputState(t, t, guess, w, None, inputs, None, started=False)

    def step(self, state: UnknownInputState, sample: Sample) -> tuple[UnknownInputState, Estimate]:
        """Move to the time of the sample and use it.

        ValueError if time does not increase (the first sample may share the initial time), or if
        the sample says jump.
        """
        if sample.jump:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        t = later(sample.t, state.t, state.started)
        y = self._measurement(sample.y)
        if y is not None and state.moderate and 1.0 / _USUAL < t - state.t_seen < _USUAL:
            return self._step(state, t, y, sample)  # no overflow: `errstate` takes its time
        with np.errstate(over="ignore", invalid="ignore"):  # the status names what is not finite
            return self._step(state, t, y, sample)

    def _step(
        self, state: UnknownInputState, t: float, y: Vector | None, sample: Sample
    ) -> tuple[UnknownInputState, Estimate]:
        u, why = state.u, ""
        if y is None:
            y, why = usable(sample.y, self._p)
        y = None if y is None else centred(y, self.gains)
        if sample.u is not None and len(u) > 1:
            u = np.append(vector(sample.u, len(u) - 1, "u"), 1.0)
        if state.y is None or state.w is None:
            return self._first(state, t, y, u, why)
        used = state.used
        if y is None or used is not None:
            used = state.u * (t - state.t) + (0.0 if used is None else used)
        h = t - state.t_seen
        last, size = state.last, max(abs(t), abs(state.t))
        if last is None or last[1] is None or abs(h - last[0]) > 2 * math.ulp(size):
            last = self._next_step(last, h, size)  # usually they are all alike
        mean = state.u if used is None else used / h
        k, p, q = self._k, self._p, self._q
        known = np.concatenate((state.w, state.y, state.y if y is None else y, mean))
        if last[1] is None:
            w, found = self._free.of(h, known)
        else:
            found = last[1].dot(known)
            w, found = found[:k], found[k:]
        x, d = found[:-q], found[-q:]
        if y is None:
            following = state._replace(t=t, x=x, u=u, used=used)
            return following, Estimate(t, x=x, d=d * np.nan, status=why)
        slope, status = None, last[2]
        if self._damped:
            slope = damped_slope(state, h, y)
            d = d + self.gains["N"] @ slope[2]
        # y from `known`: the sample's own array is the caller's
        y = known[k + p : k + 2 * p]
        moderate = self._has_usual_gains
        moderate &= math.hypot(*w.tolist(), *x.tolist(), *d.tolist()) < MODERATE
        if not moderate:
            status = status_of([status] if status != "ok" else [], x, d)
        if u is not state.u or not state.moderate:
            moderate &= math.hypot(*u.tolist()) < MODERATE
        following = UnknownInputState(t, t, x, w, y, u, None, slope, last, True, moderate)
        return following, Estimate(t, x=x, d=d, status=status)

    def run(self, state: UnknownInputState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples; with `batch`, of the record smoothed as a whole."""
        if self.takes_whole_records:
            samples = smoothed_record([kept(row) for row in samples], self.gains["noise_std"])
        return super().run(state, samples)

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        *,
        x: ArrayLike | None = None,
    ) -> Batch:
        """The whole record at once: a loop over `step`, from a guess of x or the first sample."""
        times = np.asarray(t, dtype=np.float64)
        state = self.init(first_time(times), x=x)
        return collect(self.run(state, rows_of(times, y, u)))

    def _first(
        self, state: UnknownInputState, t: float, y: Vector | None, u: Vector, why: str
    ) -> tuple[UnknownInputState, Estimate]:
        """No interval yet, so nothing is known of d; before any measurement, x is the guess."""
        nothing = np.full(self.gains["D"].shape[1], np.nan)
        if y is None:
            following = state._replace(t=t, u=u, started=True)
            return following, Estimate(t, x=state.x, d=nothing, status=why)
        w = self.gains["first"] @ y if state.w is None else state.w
        x = self.gains["X"] @ w + self.gains["Xy"] @ y
        # a copy: the sample's own array is the caller's
        following = UnknownInputState(t, t, x, w, y.copy(), u, None)
        return following, Estimate(t, x=x, d=nothing, status=status_of([], x))

    def _measurement(self, y: ArrayLike | None) -> Vector | None:
        """An array as it is if its length says that `usable` need not look at every entry."""
        if type(y) is np.ndarray and y.dtype.char == "d" and y.shape == (self._p,):
            return y if math.hypot(*y.tolist()) < MODERATE else None
        return None

    def _next_step(
        self, before: tuple[float, Vector | None, str] | None, h: float, size: float
    ) -> tuple[float, Vector | None, str]:
        """(length, its matrix once a second step of that length follows, what is to be said).

        Decided by the state alone, so that a stream gives the same numbers whatever ran before.
        """
        if before is None or abs(h - before[0]) > 2 * math.ulp(size):
            return h, None, self._status(h, size)
        if before[2].startswith(_COARSE):
            return h, None, before[2]
        return h, cached_step(self._steps, h, self._stacked), before[2]

    def _stacked(self, h: float) -> Vector:
        """The matrix of a step of length h."""
        return stacked(self.gains, h, self._damped)

    @cached_property
    def _free(self) -> FreeStep:
        return FreeStep(self.gains, self._damped)

    @cached_property
    def _has_usual_gains(self) -> bool:
        numbers = [
            np.abs(g).max() for g in self.gains.values() if isinstance(g, np.ndarray) and g.size
        ]
        return bool(max(numbers) < _USUAL)

    @cached_property
    def _fastest(self) -> float:
        F = self.gains["F"]
        return float(np.abs(np.linalg.eigvals(F)).max()) if F.size else 0.0

    def _status(self, h: float, size: float) -> str:
        told = []
        if 4 * math.ulp(size) > _RESOLVED * h:
            told.append(f"{_COARSE} {2 * math.ulp(size):.2g} for sampling time {h:.9g}")
        if h * self._fastest > equations.STEP_LIMIT:
            limit = equations.STEP_LIMIT / self._fastest
            told.append(f"sampling time {h:.9g} above {limit:.6g} = 2/|f|")
        return "; ".join(told) or "ok"
