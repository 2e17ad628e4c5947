"""Exact trajectories of a plant with jumps, inputs, disturbances and noise.

Nothing is integrated by steps: between two instants the state moves by a block exponential of
plant, held inputs and signal generators, so that the record is the solution to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.arrays import Array, Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.column_names import JUMP, SIGNALS, TIME, TRUTH
from obsdesign.data.jump_times import jump_times
from obsdesign.data.signals import DISTURBANCES, Signals, signals
from obsdesign.entries import positive
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.runtime.columns import named_columns

# exponent by which an unstable mode may grow in a default simulation
_GROWN = 6.0
_MOST_ROWS = 1e7
_SAME_INSTANT = 1e-9  # time stamps closer than this part of a step are one instant


@dataclass(frozen=True)
class Simulation:
    """A simulated run, one row per instant; x is the state after the row's jump.

    columns: t, y1.., u1.., w1.., jump, then the truth x1.., d1.. (ignored by observers).
    events: times and weights of unknown impulses, (t, weight1, ...).
    """

    columns: dict[str, Array]
    events: Matrix

    @property
    def t(self) -> Matrix:
        """Time stamps, (rows,)."""
        return self.columns[TIME]

    def block(self, letter: str) -> Matrix:
        """Columns y, u, w, x or d as one array (rows, number)."""
        names = [name for name in self.columns if name[0] == letter and name[1:].isdigit()]
        return np.column_stack(
            [self.columns[name] for name in names] or [np.zeros((len(self.t), 0))]
        )


def simulate(
    plant: Plant,
    *,
    until: float | None = None,
    step: float | None = None,
    initial: ArrayLike | None = None,
    dwell: str | float | Sequence[float] = "random",
    disturbance: str = "random",
    rng: np.random.Generator | None = None,
    announced: bool = False,
) -> Simulation:
    """Simulate a plant from t = 0, by matrix exponentials from row to row: exact up to rounding.

    until, step: end and spacing of the rows, in the plant's time unit (default: ten dwell times,
    without jumps 200 periods or ten time constants of the slowest mode; the sampling period, else a
    round number near until/500). initial: x(0), (n,), default ones. dwell: `shortest`, `random`
    (admissible), one dwell time, or a sequence of them, repeated in turn. disturbance: `zero` (the
    middle of every bound, no noise), `extreme` (a corner, held), `random` or `sine`. rng: a numpy
    Generator (default: seed 0). announced: the record has the times of impulses of unknown weight
    too, which every kind but `impulsive_input` needs.

    InputError for options that do not fit the plant, and where the state overflows.
    """
    if disturbance not in DISTURBANCES:
        raise InputError(
            f"disturbance must be one of {', '.join(DISTURBANCES)}; got {disturbance!r}."
        )
    rng = np.random.default_rng(0) if rng is None else rng
    x = _initial(plant.n, initial)
    until = default_until(plant, dwell) if until is None else positive(until, "until")
    jumps = jump_times(plant, dwell, until, rng)
    # measured at jumps only: rows between them only where a step is given
    between = step is not None or plant.output.measured != "at_jumps"
    step = _default_step(plant, until) if step is None else positive(step, "step")
    instants = _instants(plant, jumps, until, step, between)
    source = signals(plant, disturbance, len(instants.times), rng)
    with np.errstate(over="ignore", invalid="ignore"):
        record = _trajectory(x, instants, source, announced)
    _require_finite(record)
    return record


def _require_finite(record: Simulation) -> None:
    finite = np.isfinite(record.block("x")).all(axis=1)
    if not finite.all():
        raise InputError(
            f"the state overflows at t = {record.t[np.argmin(finite)]:g}: the plant is unstable "
            "for these jumps; give a smaller --until."
        )


def _initial(n: int, initial: ArrayLike | None) -> Matrix:
    x = np.ones(n) if initial is None else np.asarray(initial, dtype=np.float64)
    if x.shape != (n,) or not np.isfinite(x).all():
        raise InputError(f"initial must have {n} finite entries, one per state; got {x.tolist()}.")
    return x


def default_until(plant: Plant, dwell: str | float | Sequence[float]) -> float:
    """Ten dwell times where there are jumps, else 200 samples or what the slowest mode takes."""
    if isinstance(dwell, int | float) and plant.jump is not None:
        return 10.0 * float(dwell)
    if plant.jump is None or plant.jump.dwell_time is None:
        return _settled(plant)
    low, high = plant.jump.dwell_time
    typical = low if dwell == "shortest" else (low + high) / 2 if math.isfinite(high) else 2 * low
    return 10.0 * (typical or 1.0)


def _settled(plant: Plant) -> float:
    """200 sampling periods, or ten times the slowest mode's; less where x would grow far."""
    modes = np.linalg.eigvals(plant.flow.A)
    fastest, period = float(np.abs(modes).max()), plant.output.sample_spacing
    if fastest == 0 or not math.isfinite(fastest):
        return 200 * period or 10.0
    slowest = float(np.abs(modes[np.abs(modes) > 1e-6 * fastest]).min())
    until = 200 * period or min(10 / slowest, 1000 / fastest)
    growth = float(modes.real.max())
    if growth * until > _GROWN:
        until = max(_GROWN / growth, 50 * period)
    return float(f"{until:.2g}")


def _default_step(plant: Plant, until: float) -> float:
    if plant.output.measured == "periodic" and plant.output.period:
        return float(plant.output.period)
    wanted = until / 500
    scale = 10.0 ** math.floor(math.log10(wanted))
    return float(
        scale * min((1.0, 2.0, 5.0, 10.0), key=lambda nice: abs(math.log(nice * scale / wanted)))
    )


@dataclass(frozen=True)
class _Instants:
    """Times of all rows; which of them are jumps, and which have a measurement."""

    times: Matrix
    is_jump: NDArray[np.bool_]
    is_measured: NDArray[np.bool_]


def _instants(plant: Plant, jumps: Matrix, until: float, step: float, between: bool) -> _Instants:
    """All rows; InputError where two of them fall together."""
    grid = _grid(step, until) if between else np.zeros(0)
    if plant.output.measured == "periodic" and plant.output.period:
        samples = _grid(float(plant.output.period), until)
        grid = np.sort(np.concatenate([_away(grid, samples, _SAME_INSTANT * step), samples]))
    # a jump instant takes the place of the grid row that it coincides with
    grid = _away(grid, jumps, _SAME_INSTANT * step)
    times = np.concatenate([grid, jumps])
    order = np.argsort(times)
    is_jump = np.concatenate([np.zeros(len(grid), bool), np.ones(len(jumps), bool)])[order]
    times = times[order]
    if not (np.diff(times) > 0).all():
        raise InputError(
            f"until = {until:g} and step = {step:g} leave rows closer than 1e-12 apart; choose a "
            "smaller unit of time."
        )
    return _Instants(times, is_jump, _measured(plant, times, is_jump))


def _grid(step: float, until: float) -> Matrix:
    if until / step > _MOST_ROWS:
        raise InputError(
            f"step = {step:g} makes {until / step:.4g} rows until {until:g}; "
            f"{_MOST_ROWS:g} is the limit."
        )
    rows = int(until / step * (1 + 1e-12)) + 1
    return np.asarray(np.round(step * np.arange(rows), 12), dtype=np.float64)


def _away(grid: Matrix, instants: Matrix, least: float) -> Matrix:
    """Return the grid without its points at these instants, in order."""
    ends = np.concatenate([[-math.inf], instants, [math.inf]])
    places = np.searchsorted(ends, grid)
    distance = np.minimum(np.abs(grid - ends[places - 1]), np.abs(ends[places] - grid))
    kept: Matrix = grid[distance > least]
    return kept


def _measured(plant: Plant, times: Matrix, is_jump: NDArray[np.bool_]) -> NDArray[np.bool_]:
    if plant.output.measured == "at_jumps":
        return is_jump
    measured = np.ones(len(times), bool)
    if plant.output.measured == "periodic" and plant.output.period:
        count = times / plant.output.period
        measured = np.abs(count - np.round(count)) < 1e-6
    return measured & ~(is_jump & (plant.output.jump_measurement == "none"))


def _trajectory(x: Matrix, instants: _Instants, source: Signals, announced: bool) -> Simulation:
    """Step from row to row; matrices are shared between equal steps."""
    plant, n = source.plant, len(x)
    C = plant.output.C
    truth, outputs, events = [], [], []
    cache: dict[float, Matrix] = {}
    now = 0.0
    for k, t in enumerate(instants.times.tolist()):
        h = t - now
        if h > 0:
            if h not in cache:
                cache[h] = expm(source.generator * h)[:n]
            x = cache[h] @ source.extended(x, k, now)
        before = x
        if instants.is_jump[k]:
            assert plant.jump is not None
            x = plant.jump.G @ x + source.jump(k)
            if plant.jump.H is not None:
                events.append([t, *source.weights[k]])
        after = plant.output.jump_measurement == "after"
        is_measured = bool(instants.is_measured[k])
        outputs.append(source.measurement(C @ (x if after else before), k, t, is_measured))
        truth.append(x)
        now = t
    y = np.array(outputs).reshape(len(instants.times), len(C))
    states = np.array(truth).reshape(-1, n)
    table = _columns(instants, y, states, source, reports=_reports_jumps(plant, announced))
    return Simulation(table, np.array(events).reshape(len(events), 1 + source.weights.shape[1]))


def _reports_jumps(plant: Plant, announced: bool) -> bool:
    """Does a record have the jumps? Impulses of unknown weight alone only if announced."""
    jump = plant.jump
    if jump is None:
        return False
    return announced or jump.H is None or not np.array_equal(jump.G, np.eye(plant.n))


def _columns(
    instants: _Instants, y: Matrix, truth: Matrix, source: Signals, *, reports: bool
) -> dict[str, Array]:
    """Columns of a record; reports: has it one that says where jumps are?"""
    columns: dict[str, Array] = {TIME: instants.times}
    w = np.where(instants.is_jump[:, None], source.w, np.nan)
    for letter, values in zip(SIGNALS, (y, source.u, w), strict=True):
        columns |= named_columns(letter, values)
    if reports:
        columns[JUMP] = instants.is_jump.astype(np.int64)
    for letter, values in zip(TRUTH, (truth, source.unknown(instants.times)), strict=True):
        columns |= named_columns(letter, values)
    return columns
