"""Interval observer at run time: bounds that hold for samples, jumps and rounding.

Observers (6) and (11) of Degue, Efimov, Richard (NOLCOS 2016) are written for a continuous y.
Here y arrives as samples, and holding the last one would break the enclosure. Between two
samples we use what the plant lets y do (a slope scheme): the path of the centre is known
exactly, and the distance of any path to it is bounded by a comparison system.

State: a centre m and a radius r >= 0 with |x - m| <= r. Over a step h without jump, with the
measurement y = C x(0) + v taken at its start,

    x_c' = A x_c + B u + b_mid                     x_c(0) = m       the centre of the prediction
    rho' = Mz(A) rho + b_rad                       rho(0) = r       |x - x_c| <= rho
    sig' = |C A| rho + |C| b_rad                   sig(0) = 0       |C(x - x_c) - its value at 0|
    q'   = W q + |L| (V + sig) + b_rad             q(0) = r         |x - m+| <= q

    m+ = x_c(h) + K (y - C m),   K = int_0^h e^{(A - L C) s} ds L,

because L C x = L(y + C(x_c - m)) + L(-v + something in [-sig, sig]). With the measurement at the
end of the step instead, sig(h) - sig takes the place of sig and y - C x_c(h) that of y - C m.
Without any, A predicts alone: m+ = x_c(h), r+ = rho(h). For h -> 0 this is the paper's observer.
All of it is linear in (m, y, u, 1) and (r, 1): one matrix per step size, cached.

Rounding: the matrices are enclosed (`lmi.enclosure`); what they may be off by, and the rounding
of the step itself, go into the radius.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.enclosure import UNIT, raised
from obsdesign.errors import InputError
from obsdesign.runtime.base import (
    Batch,
    DwellGuard,
    Estimate,
    Sample,
    Vector,
    collect,
    later,
    optional_measurement,
    require_gains,
    rows_of,
    run,
    vector,
)
from obsdesign.runtime.interval_steps import StepMap, jump_maps, midpoint, step_maps
from obsdesign.runtime.step_cache import cached_step


@dataclass(frozen=True, slots=True)
class IntervalState:
    """Everything the next step needs: |x - centre| <= radius just after time t."""

    t: float
    centre: Vector
    radius: Vector
    u: Vector
    y: Vector | None
    guard: DwellGuard
    started: bool


@dataclass(frozen=True)
class IntervalObserver:
    """Executes a design of kind `interval`, forms `cooperative` and `split`."""

    gains: Mapping[str, Any]
    kind: ClassVar[str] = "interval"
    finds_events: ClassVar[bool] = False
    _steps: OrderedDict[tuple[float, int], dict[str, StepMap]] = field(
        default_factory=OrderedDict, repr=False, compare=False
    )

    @classmethod
    def from_gains(cls, gains: Mapping[str, Any]) -> IntervalObserver:
        """The observer of a design's `gains`; ValueError if they do not fit each other."""
        require_gains(gains, ("D0", "D1"), ("Gp", "Gn"))
        return cls(gains)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.gains["A"])

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the estimate after t: x1_lo, x1_hi, ..."""
        return tuple(f"x{i + 1}_{end}" for i in range(self.n) for end in ("lo", "hi"))

    @property
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
        inputs = np.zeros(self.reads["u"])
        guard = DwellGuard.of(self.gains)
        return IntervalState(float(t), centre, radius, inputs, None, guard, started=False)

    def step(self, state: IntervalState, sample: Sample) -> tuple[IntervalState, Estimate]:
        """Move to the time of the sample, use it, and jump if it says so.

        ValueError if time does not increase (the first sample may share the initial time).
        """
        t = later(sample.t, state.t, state.started)
        y = optional_measurement(sample.y, len(self.gains["C"]))
        when = self.gains["jump_measurement"]
        seen_before_jump = y if not sample.jump or when == "before" else None
        centre, radius = self._flow(state, t, seen_before_jump)
        objections = self._plausible(seen_before_jump, centre, radius)
        guard, late = state.guard.after(t, sample.jump)
        objections += [late] if late else []
        if y is None and not (sample.jump and when == "none"):
            objections.append("missing sample")
        usable = y
        if sample.jump:
            centre, radius = self._jump(centre, radius, y, sample.w)
            usable = y if when == "after" else None
        centre, radius, lost = _finite_or_everything(centre, radius)
        u = state.u if sample.u is None else vector(sample.u, len(state.u), "u")
        following = replace(
            state, t=t, centre=centre, radius=radius, u=u, y=usable, guard=guard, started=True
        )
        status = "; ".join(objections + lost) or "ok"
        lower, upper = np.nextafter(centre - radius, -np.inf), np.nextafter(centre + radius, np.inf)
        return following, Estimate(t, lower=lower, upper=upper, status=status)

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
        """The whole record at once: a loop over `step` from bounds of x at its first row."""
        times = np.asarray(t, dtype=np.float64)
        state = self.init(float(times[0]), lower=lower, upper=upper)
        return collect(self.run(state, rows_of(times, y, u, w, jump)))

    def _flow(self, state: IntervalState, t: float, y_end: Vector | None) -> tuple[Vector, Vector]:
        if t == state.t:
            return state.centre, state.radius
        maps = self._maps(t - state.t, max(abs(t), abs(state.t)))
        if state.y is not None:
            return maps["start"].apply(state.centre, state.radius, state.y, state.u)
        if y_end is not None:
            return maps["end"].apply(state.centre, state.radius, y_end, state.u)
        return maps["none"].apply(state.centre, state.radius, None, state.u)

    def _maps(self, h: float, size: float) -> dict[str, StepMap]:
        """Step matrices for a step of about h between time stamps of magnitude `size`."""
        return cached_step(self._steps, h, size, lambda *step: step_maps(self.gains, *step))

    def _jump(
        self, centre: Vector, radius: Vector, y: Vector | None, w: ArrayLike | None
    ) -> tuple[Vector, Vector]:
        if "G" not in self.gains:
            raise ValueError("this plant has no jumps ([jump] is absent), but a sample says jump.")
        inputs = int(self.reads["w"])
        known = np.zeros(inputs) if w is None else vector(w, inputs, "w")
        corrected = y is not None and self.gains["jump_measurement"] != "none"
        return self._jumps[corrected].apply(centre, radius, y, known)

    @cached_property
    def _jumps(self) -> dict[bool, StepMap]:
        return jump_maps(self.gains)

    def _plausible(self, y: Vector | None, centre: Vector, radius: Vector) -> list[str]:
        """A measurement that no state inside the bounds can give refutes them."""
        if y is None:
            return []
        C, V = self.gains["C"], self.gains["noise_bound"]
        reach = raised(np.abs(C) @ (radius + UNIT * 8 * len(C.T) * np.abs(centre)) + V, len(C.T))
        outside = np.abs(y - C @ centre) > reach + 4 * UNIT * np.abs(y)
        return [f"y{i + 1} outside its bounds" for i in np.flatnonzero(outside)]


def _finite_or_everything(centre: Vector, radius: Vector) -> tuple[Vector, Vector, list[str]]:
    """Overflow leaves the only sound bounds: none."""
    if np.isfinite(centre).all() and np.isfinite(radius).all():
        return centre, radius, []
    return np.zeros_like(centre), np.full_like(radius, np.inf), ["bounds overflowed"]
