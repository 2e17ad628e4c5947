"""Interval observer at run time: bounds that hold for samples, jumps and rounding.

Observers (6), (9) and (11) of Degue, Efimov, Richard (NOLCOS 2016) are written for a continuous y.
Here y arrives as samples, and holding the last one would break the enclosure. Between two
samples we use what the plant lets y do (a slope scheme): the path of the centre is known
exactly, and the distance of any path to it is bounded by a comparison system.

State: a centre m and a radius r >= 0 with |z - m| <= r, x = S z (S = I where there are no other
coordinates). Over a step h without jump, with the measurement y = C z(0) + v taken at its start,

    z_c' = A z_c + B u + b_mid                     z_c(0) = m       the centre of the prediction
    rho' = Mz(A) rho + b_rad                       rho(0) = r       |z - z_c| <= rho
    sig' = |C A| rho + |C| b_rad                   sig(0) = 0       |C(z - z_c) - its value at 0|
    q'   = W q + |L| (V + sig) + b_rad             q(0) = r         |z - m+| <= q

    m+ = z_c(h) + K (y - C m),   K = int_0^h e^{(A - L C) s} ds L,

because L C z = L(y + C(z_c - m)) + L(-v + something in [-sig, sig]). With the measurement at the
end of the step instead, sig(h) - sig takes the place of sig and y - C z_c(h) that of y - C m.
Without any, A predicts alone: m+ = z_c(h), r+ = rho(h). For h -> 0 this is the paper's observer.

With `measured = periodic` a sample is an event like a jump: A predicts, then z+ = z + L(y - C z),
r+ = |I - L C| r + |L| V; what is reported is also cut with |C x - y| <= V and the prediction.
What is claimed of the width is about samples a period apart, and |I - L C| need not contract by
itself. So of a sample off the period (early, or at a jump) and of its absence the better is kept,
as a box: r+ is then at most the prediction's, and every later radius at most what it would be
without that sample, since radii obey r+ = R r + g with R >= 0.

All of it is linear in (m, y, u, 1) and (r, 1): one matrix per step size, cached
(`interval_steps`, `interval_kernel`). Matrices are enclosed; what they may be off by, and the
rounding of the step itself, go into the radius.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import frexp, inf
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import absolute, maximum, ndarray
from numpy.typing import ArrayLike

from obsdesign.errors import InputError
from obsdesign.runtime.base import (
    RELATIVE_TIME_TOLERANCE,
    Batch,
    DwellGuard,
    Estimate,
    Sample,
    Vector,
    first_time,
    later,
    optional_measurement,
    require_gains,
    run,
    vector,
)
from obsdesign.runtime.interval_kernel import Kernel, kernel
from obsdesign.runtime.interval_model import Model, midpoint, model
from obsdesign.runtime.interval_record import Columns, Stretch, stretch
from obsdesign.runtime.interval_steps import (
    BoxMap,
    flow_maps,
    free_map,
    identity_map,
    jump_maps,
    sampled,
)
from obsdesign.runtime.step_cache import cached_step, rounded_step


class IntervalState(NamedTuple):
    """Everything the next step needs, just after time t.

    box: (2n,), radius and centre in the observer's coordinates; u: input that holds; y: measurement
    that the next step may start from; sampled: time of the last one used; lost: since when, and
    why, the bounds are refuted; phase: time of the last sample that was a period after another
    one, or began anew (periodic samples only), NaN before the first.
    """

    t: float
    box: Vector
    u: Vector
    y: Vector | None
    guard: DwellGuard
    started: bool
    sampled: float
    lost: str = ""
    phase: float = math.nan


@dataclass(frozen=True)
class IntervalObserver:
    """Executes a design of kind `interval`."""

    gains: Mapping[str, Any]
    kind: ClassVar[str] = "interval"
    finds_events: ClassVar[bool] = True
    event_names: ClassVar[tuple[str, ...]] = ("t", "event")
    _steps: OrderedDict[tuple[float, int], Mapping[str, Kernel]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )
    _recent: dict[tuple[float, int], dict[str, Any]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> IntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        two = gains.get("form") == "two_coordinates"
        squares = ("D0", "D1", *(name for name in ("S", "S2", "T") if name in gains))
        require_gains(gains, squares, () if two else ("Gp", "Gn"))
        return cls(gains)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.gains["A"])

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, x1_hi, ..."""
        return tuple(f"x{i + 1}_{end}" for i in range(self.n) for end in ("lo", "hi"))

    @cached_property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        u, w = (self.gains[x].shape[1] if x in self.gains else 0 for x in ("B", "E"))
        return {"y": len(self.gains["C"]), "u": u, "w": w, "jump": "G" in self.gains}

    def start(self, t: float, initial: Sequence[float] | None) -> IntervalState:
        """State from x1_lo, x1_hi, x2_lo, ...; InputError if they are not bounds."""
        if initial is None or len(initial) != 2 * self.n:
            arrived = "nothing" if initial is None else f"{len(initial)} numbers"
            raise InputError(
                f"--initial must be the {2 * self.n} numbers {','.join(self.names)}; got {arrived}."
            )
        try:
            return self.init(t, lower=initial[0::2], upper=initial[1::2])
        except ValueError as error:
            raise InputError(f"--initial: {error}") from None

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """State at time t from bounds of x(t), before the first sample and its jump.

        ValueError if a lower bound exceeds its upper one or a bound is not finite.
        """
        guard = DwellGuard.of(self.gains)
        inputs = np.zeros(int(self.reads["u"]))
        now = float(t)
        return IntervalState(now, self._box(lower, upper), inputs, None, guard, False, now)

    def reset(self, state: IntervalState, *, lower: ArrayLike, upper: ArrayLike) -> IntervalState:
        """The same instant with new bounds of x(t): ends what a refuted state says of itself.

        Inputs and the time of the last jump are kept. ValueError as for `init`.
        """
        return state._replace(box=self._box(lower, upper), lost="")

    def _box(self, lower: ArrayLike, upper: ArrayLike) -> Vector:
        low, high = vector(lower, self.n, "lower"), vector(upper, self.n, "upper")
        for i in np.flatnonzero(~(np.isfinite(low) & np.isfinite(high))):
            raise ValueError(
                f"initial bounds of x{i + 1} must be finite numbers; got {low[i]:g}, {high[i]:g}."
            )
        for i in np.flatnonzero(low > high):
            raise ValueError(
                f"initial bounds of x{i + 1}: lower {low[i]:g} exceeds upper {high[i]:g}."
            )
        centre, radius = midpoint(low, high)
        return self._model.from_plant(centre, radius)

    def step(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        if self._short and (usual := self._usual(state, sample)) is not None:
            return usual
        t = later(sample.t, state.t, state.started)
        y = optional_measurement(sample.y, self._p)
        seen = y if not sample.jump or self._when == "before" else None
        kernels = self._kernels(t - state.t, max(abs(t), abs(state.t)))
        chosen = kernels[self._mode(state, seen, t)]
        with np.errstate(over="ignore", invalid="ignore"):
            out = chosen.rows.dot(chosen.vector(state.box, state.y, seen, state.u))
            objections = [] if seen is None else self._implausible(out)
            off = y is not None and self._off_period(state, t)
            if off and seen is not None:
                plain = kernels["none"]
                free = plain.rows.dot(plain.vector(state.box, None, None, state.u))
                chosen, out = self._better(chosen, out, free)
            if sample.jump:
                chosen, out = self._jump(kernels, out, state, y, sample.w, off)
        guard, late = state.guard.after(t, sample.jump)
        if late:
            objections.append(late)
        objections += self._missing(state, sample, y, t)
        box, bounds, fatal = self._results(chosen, out)
        objections += fatal
        lost = state.lost or _refuting(t, objections)
        if state.lost:
            objections.append(state.lost)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        usable = y if not sample.jump or self._when == "after" else None
        following = IntervalState(
            t, box, u, usable, guard, True, state.sampled if y is None else t, lost,
            state.phase if y is None or off else t,
        )  # fmt: skip
        status = "; ".join(objections) if objections else "ok"
        events = tuple((t, text) for text in (["jump"] if sample.jump else []) + objections)
        return following, Estimate(t, None, *bounds, events=events, status=status)

    def _usual(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate] | None:
        """The step of a sample that is in time, with nothing to object; None for any other.

        One output and no inputs: written out, since most of its time is spent calling.
        """
        t, y, _, _, jump = sample
        if jump or state.lost or type(y) is not ndarray or y.shape != _ONE_OUTPUT:
            return None
        found = self._recent.get((t - state.t, frexp(t)[1]))
        if found is None or not t > state.t >= 0.0:
            return None
        apart = t - state.phase
        if not self._earliest <= apart <= self._latest and not self._in_time(state, t):
            return None
        rows, blank, (box, y_end, known, sizes, checks, one, two) = found["usual"]
        v = blank.copy()
        v[box] = state.box
        v[y_end] = y
        absolute(v[known], v[sizes])
        out = rows.dot(v)
        below, above, size = out[checks].tolist()
        # what is not finite gives NaN here: every comparison with it fails
        if not (below >= 0.0 and above >= 0.0 and size < inf):
            return None
        guard = state.guard
        if guard.last_jump is not None and guard.after(t, False)[1]:
            return None
        ends, n = maximum(out[one], out[two]), self._n
        following = IntervalState(t, out[box], state.u, v[y_end], guard, True, t, "", t)
        return following, Estimate(t, None, ends[:n], -ends[n:])

    def run(self, state: IntervalState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples."""
        return run(self, state, samples)

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        lower: ArrayLike,
        upper: ArrayLike,
    ) -> Batch:
        """The whole record at once, from bounds of x at its first row.

        Stretches of equal steps are done together, all other rows by `step`: the bounds agree with
        those of `step` up to rounding, and hold as well.
        """
        state = self.init(first_time(np.ravel(t)), lower=lower, upper=upper)
        record = Columns.of(t, y, u, w, jump)
        times = record.t
        lows, highs = np.empty((len(times), self.n)), np.empty((len(times), self.n))
        status = ["ok"] * len(times)
        ends = record.stretches()
        row = 0
        while row < len(times):
            state, found = self._stretch(state, record, row, int(ends[row]))
            if found is not None:
                done = slice(row, row + len(found.lower))
                lows[done], highs[done] = found.lower, found.upper
                row = done.stop
            if row < len(times):
                state, estimate = self.step(state, record.sample(row))
                lows[row], highs[row] = estimate.lower, estimate.upper
                status[row] = estimate.status
                row += 1
        return Batch(times, None, lows, highs, None, tuple(status))

    def _stretch(
        self, state: IntervalState, record: Columns, row: int, end: int
    ) -> tuple[IntervalState, Stretch | None]:
        """Do rows from `row` on together, as far as they are ordinary samples in time."""
        times = record.t
        end = min(end, row + _MOST_ROWS)
        if state.guard.last_jump is not None:
            latest = state.guard.last_jump + state.guard.longest
            end = min(end, int(np.searchsorted(times, latest)))
        mode = "start" if self._period is None else "sampled"
        fits = state.started and not state.lost and (mode == "sampled" or state.y is not None)
        if end - row < _FEWEST_ROWS or not fits:
            return state, None
        h = float(times[row] - state.t)
        slack = 4 * math.ulp(float(times[row]))
        if mode == "start" and max(h, float(times[row] - state.sampled)) > self._latest + slack:
            return state, None
        if mode == "sampled" and not (
            self._earliest - slack <= h <= self._latest + slack
            and self._in_time(state, float(times[row]))
        ):
            return state, None
        length, half, _ = rounded_step(h, float(times[row]))
        steps = np.diff(times[row:end], prepend=state.t)
        end = row + int(np.argmax(np.append(np.abs(steps - length) > half, True)))
        if end - row < _FEWEST_ROWS:
            return state, None
        chosen = self._kernels(h, float(times[row]))[mode]
        after, inputs = record.y[row:end], record.held(state.u, row, end)
        first = np.zeros(self._p) if state.y is None else state.y
        found = stretch(chosen, state.box, np.vstack([first, after[:-1]]), after, inputs[:-1])
        done = len(found.lower)
        if done == 0:
            return state, None
        now = float(times[row + done - 1])
        following = IntervalState(
            now, found.box, inputs[done], after[done - 1], state.guard, True, now, "", now
        )
        return following, found

    def fleet_kernel(self, h: float, size: float, has_sample: bool) -> Kernel:
        """The kernel of a step with a measurement at its end, for `interval_fleet`."""
        mode = "sampled" if self._period is not None else "start" if has_sample else "end"
        found: Kernel = self._kernels(h, abs(size))[mode]
        return found

    # --- maps ---------------------------------------------------------------------------------

    @cached_property
    def _model(self) -> Model:
        return model(self.gains)

    @cached_property
    def _p(self) -> int:
        return len(self.gains["C"])

    @cached_property
    def _when(self) -> str:
        return str(self.gains["jump_measurement"])

    @cached_property
    def _period(self) -> float | None:
        return float(self.gains["period"]) if "period" in self.gains else None

    @cached_property
    def _latest(self) -> float:
        """How long after a sample the next one is in time; the longest step of a continuous y."""
        longest = self._period or float(self.gains.get("step_limit", math.inf))
        return longest * (1 + RELATIVE_TIME_TOLERANCE)

    @cached_property
    def _earliest(self) -> float:
        """How soon after a sample the next one is a period later."""
        return (self._period or 0.0) * (1 - RELATIVE_TIME_TOLERANCE)

    @cached_property
    def _short(self) -> bool:
        """Can `_usual` do most of the steps?"""
        return self._period is not None and self._p == 1 and not self.reads["u"]

    @cached_property
    def _n(self) -> int:
        return self.n

    def _mode(self, state: IntervalState, seen: Vector | None, t: float) -> str:
        if self._period is not None:
            return "none" if seen is None else "sampled"
        if t == state.t:
            return "none"
        if state.y is not None:
            return "start"
        return "none" if seen is None else "end"

    def _kernels(self, h: float, size: float) -> dict[str, Any]:
        """Kernels for a step of about h between time stamps of magnitude `size`."""
        key = (h, math.frexp(size)[1])
        found = self._recent.get(key)
        if found is None:
            if len(self._recent) >= _RECENT:
                self._recent.clear()
            kernels = cached_step(self._steps, h, size, self._built)
            found = dict[str, Any](kernels)
            if self._short:
                chosen = found["sampled"]
                found["usual"] = (chosen.rows, chosen.blank, chosen.parts())
            self._recent[key] = found
        return found

    def _built(self, h: float, h_error: float) -> Mapping[str, Kernel]:
        plant = self._model
        if h == 0.0:
            maps = {"none": identity_map(plant)}
        elif self._period is None:
            maps = flow_maps(plant, h, h_error)
        else:
            maps = {"none": free_map(plant, h, h_error)}
        if self._period is not None:
            maps["sampled"] = sampled(plant, maps["none"])
        return {name: self._kernel(name, maps) for name in maps}

    def _kernel(self, name: str, maps: Mapping[str, BoxMap]) -> Kernel:
        predicted = maps["start" if name == "start" else "none"]
        return kernel(self._model, maps[name], predicted, self.gains["C"], name == "sampled")

    @cached_property
    def _jumps(self) -> dict[bool, Kernel]:
        maps = jump_maps(self._model, self.gains)
        return {
            corrected: kernel(self._model, step, step, self.gains["C"], False)
            for corrected, step in maps.items()
        }

    @cached_property
    def _update(self) -> Kernel:
        """A sample by itself, no time passing."""
        found: Kernel = self._kernels(0.0, 0.0)["sampled"]
        return found

    # --- jumps and objections -----------------------------------------------------------------

    def _jump(
        self,
        kernels: Mapping[str, Kernel],
        out: Vector,
        state: IntervalState,
        y: Vector | None,
        w: ArrayLike | None,
        off: bool,
    ) -> tuple[Kernel, Vector]:
        """The result after a jump, from the one just before it.

        With samples as events: the sample and the jump, one after the other, then cut with the
        jump corrected by M. off: the sample is off the period.
        """
        if "G" not in self.gains:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        inputs = int(self.reads["w"])
        known = np.zeros(inputs) if w is None else vector(w, inputs, "w")
        use = y is not None and self._when != "none"

        def jumped(box: Vector, measured: bool) -> tuple[Kernel, Vector]:
            k = self._jumps[measured]
            return k, k.rows.dot(k.vector(box, None, y if measured else None, known))

        n2 = 2 * self.n
        if self._period is None:
            return jumped(out[:n2], use)
        k, after = jumped(out[:n2], False)
        if not use:
            return k, after
        if self._when == "after":
            k, free = self._update, after
            after = k.rows.dot(k.vector(free[:n2], None, y, state.u))
            if off:
                k, after = self._better(k, after, free)
        if np.any(self.gains["M"]):
            plain = kernels["none"]
            before = plain.rows.dot(plain.vector(state.box, state.y, None, state.u))
            _, other = jumped(before[:n2], True)
            box = _common(after[:n2], other[:n2], self.n)
            k = self._kernels(0.0, 0.0)["none"]
            after = k.rows.dot(k.vector(box, None, None, state.u))
        return k, after

    def _better(self, chosen: Kernel, used: Vector, free: Vector) -> tuple[Kernel, Vector]:
        """The result of what two share: one that uses a sample, and one without it.

        What is reported is cut with all that the sample says, as far as that leaves something.
        """
        n, n2 = self.n, 2 * self.n
        k = self._kernels(0.0, 0.0)["none"]
        box = _common(free[:n2], used[:n2], n)
        out: Vector = k.rows.dot(k.vector(box, None, None, np.zeros(int(self.reads["u"]))))
        lower, upper = chosen.bounds(used)
        ends = np.maximum(out[-n2:], np.concatenate([lower, -upper]))
        if (ends[:n] <= -ends[n:]).all():
            out[-n2:] = ends
        return k, out

    def _implausible(self, out: Vector) -> list[str]:
        """A measurement that no state inside the bounds can give refutes them."""
        n, p = self.n, self._p
        room = out[2 * n : 2 * n + 2 * p].tolist()
        if min(room) >= 0:
            return []
        return [f"y{i + 1} outside its bounds" for i in range(p) if min(room[i], room[p + i]) < 0]

    def _missing(
        self, state: IntervalState, sample: Sample, y: Vector | None, t: float
    ) -> list[str]:
        if self._period is None:
            needed = y is None and not (sample.jump and self._when == "none")
            found = ["missing sample"] if needed else []
            step = t - state.t
            unseen = state.y is None and y is None and not needed and step > 0
            if state.started and unseen and np.any(self.gains["L"]):
                found.append("no sample at either end of the step: no width is guaranteed")
            if state.started and step > self._latest + 4 * math.ulp(t):
                limit = self.gains["step_limit"]
                found.append(f"step {step:.9g} above {limit:.9g}: no width is guaranteed")
            return found
        if y is None and not sample.jump:
            return ["missing sample"]
        if state.started and self._is_late(state, t):
            if state.sampled != state.phase == state.phase:  # others came, off the period
                after = f"{self._period:.9g} after the one at {state.phase:.9g}"
                return [f"no sample {after}: no width is guaranteed"]
            apart = t - state.sampled
            return [f"time {apart:.9g} since the last sample, above {self._period:.9g}"]
        return []

    def _in_time(self, state: IntervalState, t: float) -> bool:
        """A whole number of periods since the last sample on the period, and not late."""
        assert self._period is not None
        apart = t - state.phase
        if not apart > 0:
            return False
        off = abs(apart - max(round(apart / self._period), 1) * self._period)
        near = off <= self._latest - self._period + 4 * math.ulp(t)
        return near and not self._is_late(state, t)

    def _off_period(self, state: IntervalState, t: float) -> bool:
        """Is a sample at t early, so that what is claimed of the width does not count it?"""
        if self._period is None or math.isnan(state.phase):
            return False
        return not self._in_time(state, t) and not self._is_late(state, t)

    def _is_late(self, state: IntervalState, t: float) -> bool:
        """More than a period since the last sample; two, where a jump took the place of one."""
        assert self._period is not None
        slack = 4 * math.ulp(t)  # what a difference of two time stamps is off by
        last = state.sampled if math.isnan(state.phase) else state.phase
        apart = t - last
        if apart <= self._latest + slack:
            return False
        jump = state.guard.last_jump
        if self._when != "none" or jump is None:
            return True
        waited = jump - last
        on_sample = abs(waited - self._period) <= self._latest - self._period + slack
        return not (on_sample and t - jump <= self._latest + slack)

    def _results(
        self, chosen: Kernel, out: Vector
    ) -> tuple[Vector, tuple[Vector, Vector], list[str]]:
        """Box, bounds and what is wrong with them. Overflow leaves the only sound bounds: none."""
        n = self.n
        if not math.isfinite(out[2 * n + 2 * self._p]):
            nothing = np.full(n, np.inf)
            return (
                np.concatenate([nothing, np.zeros(n)]),
                (-nothing, nothing),
                ["bounds overflowed"],
            )
        lower, upper = chosen.bounds(out)
        box = out[: 2 * n]
        if chosen.candidates > 1 and (lower > upper).any():
            whole = replace(chosen, candidates=1).bounds(out)
            return box, (whole[0][:n], whole[1][:n]), ["bounds crossed"]
        return box, (lower, upper), []


_ONE_OUTPUT = (1,)
# step lengths as they come, before rounding: a few dozen differences of decimal time stamps
_RECENT = 1024
# rows of a stretch that are done together
_FEWEST_ROWS, _MOST_ROWS = 16, 4096


def _refuting(t: float, objections: list[str]) -> str:
    """What is said of all rows after one that refutes the bounds."""
    found = [text for text in objections if "outside" in text or "crossed" in text]
    return f"void since time {t:.9g} ({found[0]})" if found else ""


def _common(one: Vector, other: Vector, n: int) -> Vector:
    """A box around what two boxes [r; m] share, or the first if they share nothing."""
    with np.errstate(invalid="ignore"):
        lower = np.maximum(one[n:] - one[:n], other[n:] - other[:n])
        upper = np.minimum(one[n:] + one[:n], other[n:] + other[:n])
        lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
        if not (lower <= upper).all() or not np.isfinite(upper - lower).all():
            return one
    centre, radius = midpoint(lower, upper)
    return np.concatenate([np.minimum(radius, np.inf), centre])
