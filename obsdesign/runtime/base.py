"""Contract of all runtime observers: samples, estimates, the loop over a record."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.equations.gains import Gains
from obsdesign.runtime.bounds import Bounds, DeclaredBounds
from obsdesign.runtime.clocks.dwell_guard import DwellGuard
from obsdesign.runtime.columns import Batch, Columns, Event, collect
from obsdesign.runtime.state_marks import Inputs, MeasuredRow

Vector = Matrix
State = TypeVar("State")
# a state of whatever kind: it goes back to an observer of the design that made it
KindState = Any
# (t, y, u): a sample as a state keeps it
Row = tuple[float, MeasuredRow | None, Inputs | None]

# Numbers below it are multiplied, squared and added without any thought of overflow.
MODERATE = 1e100

# a NamedTuple from all its fields in their order: its own constructor, a function in Python, takes
# as long as the product of a step
by_position = tuple.__new__


class Announced(NamedTuple):
    """An event whose stamp comes later, and which may have happened before this row.

    event: its place; t: its time stamp; w (l,): known inputs of all events at that row.
    """

    event: int
    t: float
    w: ArrayLike | None = None


class Sample(NamedTuple):
    """One row of data at time t, in the plant's time unit.

    y (p,): measurements, None for a missing sample; u (m,): known input from t on (None keeps the
    last one, zero before any; the first sample states it at the time of `init` alone); w (l,):
    known jump input; jump: a jump happens at t, after the measurement (or before it, as the plant's
    `jump_measurement` has it). bounds: of b from t to the next row, of c at this jump, of v in this
    y; used by kinds with `declared_bounds` alone. events: of several, the places of those that
    happen; y, w are of all sensors and events, NaN without. received: when the row arrived, None at
    its time. mode: of a plant with modes, the name of the one from this row on, None for the same.
    ahead: events with uncertain times whose stamps come later (`runtime.announced`).
    """

    t: float
    y: ArrayLike | None = None
    u: ArrayLike | None = None
    w: ArrayLike | None = None
    jump: bool = False
    bounds: Bounds | None = None
    events: tuple[int, ...] = ()
    received: float | None = None
    mode: str | None = None
    ahead: tuple[Announced, ...] = ()


class Estimate(NamedTuple):
    """Estimate at time t after the sample at t and its jump; None for what the kind has not.

    x (n,): point estimate; lower, upper (n,): bounds of the state; d (q,): unknown input, its mean
    since the row before; events: detected impulses, or jumps and violations (interval bounds),
    which `Observer.event_cells` turns into rows of an event file. status: "ok", or why the
    guarantee does not hold. directions (2, r): lower and upper bounds of l'x for further rows l;
    lagged (2, n): bounds of the state some rows ago, NaN where there are none yet; d_bounds (2, q):
    of the unknown input.
    """

    t: float
    x: Vector | None = None
    lower: Vector | None = None
    upper: Vector | None = None
    d: Vector | None = None
    events: tuple[Event, ...] = ()
    status: str = "ok"
    directions: Matrix | None = None
    lagged: Matrix | None = None
    d_bounds: Matrix | None = None


# fields of an estimate behind its status, of kinds that have none of them
NOTHING_FURTHER = Estimate(0.0)[7:]


class Observer(Protocol):
    """A frozen set of parameters; `step` has no effect but its result.

    Every observer is either `Stepped` or `Delayed`.
    """

    kind: ClassVar[str]
    finds_events: ClassVar[bool]

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of an estimate file between t and status."""

    @property
    def reads(self) -> dict[str, int | bool]:
        """Numbers of y, u and w in a sample, and whether jumps are reported."""

    @property
    def declared_bounds(self) -> DeclaredBounds | None:
        """Bounds of b, c and v that rows may narrow; None where a kind does not use any."""

    @property
    def time_errors(self) -> Sequence[float]:
        """Errors of the time stamps of events, by their places; none where all are exact."""

    @property
    def event_names(self) -> tuple[str, ...]:
        """Columns of an event file; none where the kind has no events."""

    def event_cells(self, event: Event) -> Sequence[float | str]:
        """Cells of an event in an event file."""

    def start(self, t: float, initial: Sequence[float] | None) -> KindState:
        """State at time t from the numbers of the command line's --initial."""

    def step(self, state: KindState, sample: Sample) -> tuple[KindState, Estimate]:
        """The state and the estimate after one sample."""

    def run(self, state: KindState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates of a record, one per sample."""


class RecordRunner(ABC, Generic[State]):
    """Estimates of whole records, from how an observer takes one sample after another."""

    # the state at a time, before the first sample; arguments as the kind declares them
    init: Callable[..., State]

    @property
    def guards(self) -> Sequence[DwellGuard]:
        """Guards of dwell times as they begin, in the order of a state's."""
        return ()

    @property
    def capacities(self) -> Mapping[str, int]:
        """Most entries of those lists of a state that have a limit."""
        return {}

    @property
    def sizes(self) -> Mapping[str, int]:
        """Sizes of the axes of a state's arrays, by the letters of their annotations."""
        return {}

    @property
    def declared_bounds(self) -> DeclaredBounds | None:
        """Bounds of b, c and v that rows may narrow; None where a kind does not use any."""
        return None

    @property
    def time_errors(self) -> Sequence[float]:
        """Errors of the time stamps of events, by their places; none where all are exact."""
        return ()

    @abstractmethod
    def run(self, state: State, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples, one each."""

    def run_batch(
        self,
        t: ArrayLike,
        y: ArrayLike | None = None,
        u: ArrayLike | None = None,
        w: ArrayLike | None = None,
        jump: ArrayLike | None = None,
        *,
        bounds: Bounds | None = None,
        mode: Sequence[str | None] | None = None,
        **initial: ArrayLike | None,
    ) -> Batch:
        """Estimates of a whole record at once.

        bounds: of b, c and v, (rows, ...) each; mode: of each row, None where it is unchanged.
        initial: arguments of `init` for the time of the first row. ValueError for bounds that the
        kind does not use.
        """
        if bounds is not None and self.declared_bounds is None:
            raise ValueError("bounds of b, c and v are not used by this kind of observer.")
        record = Columns.from_arrays(t, y, u, w, jump, bounds=bounds, mode=mode)
        return self.batch(self.init(float(record.t[0]), **initial), record)

    def batch(self, state: State, record: Columns) -> Batch:
        """Estimates of the rows of a record from a state at its first row."""
        return collect(self.run(state, samples_of(record)))


class Stepped(RecordRunner[State]):
    """An observer with one estimate for every sample: a stream of them is a loop over `step`."""

    @property
    def takes_whole_records(self) -> bool:
        """Does `run` need all rows at once? Then a record cannot come in parts."""
        return False

    @abstractmethod
    def step(self, state: State, sample: Sample) -> tuple[State, Estimate]:
        """The state and the estimate after one sample."""

    def batch_step(self, state: State, record: Columns) -> tuple[State, Batch]:
        """The state and the estimates after the rows of a record: the numbers of `step`."""
        estimates = list[Estimate]()
        for sample in samples_of(record):
            state, estimate = self.step(state, sample)
            estimates.append(estimate)
        return state, collect(estimates)

    def run(self, state: State, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """Estimates for a stream of samples, one each, in constant memory."""
        for sample in samples:
            state, estimate = self.step(state, sample)
            yield estimate


class Deciding(Protocol):
    """A state with the rows that the last sample, or block of samples, settled."""

    @property
    def decided(self) -> tuple[Estimate, ...]:
        """These rows."""


DecidingState = TypeVar("DecidingState", bound=Deciding)


class Delayed(RecordRunner[DecidingState]):
    """An observer whose rows are decided some samples later; a state holds them as `decided`."""

    @abstractmethod
    def step(self, state: DecidingState, sample: Sample) -> tuple[DecidingState, Estimate]:
        """The state after one sample, and a prediction at its time."""

    @abstractmethod
    def block(self, state: DecidingState, samples: Sequence[Sample]) -> DecidingState:
        """The state after several samples; its `decided` holds the rows they settled."""

    @abstractmethod
    def finish(self, state: DecidingState) -> tuple[Estimate, ...]:
        """Rows that were not decided when the record ended."""

    def run(self, state: DecidingState, samples: Iterable[Sample]) -> Iterator[Estimate]:
        """One row per sample, each as soon as it is decided; the tail at the end."""
        for sample in samples:
            state, _ = self.step(state, sample)
            yield from state.decided
        yield from self.finish(state)


def instant(t: float) -> float:
    """A time as a float; ValueError unless it is finite."""
    now = float(t)
    if not math.isfinite(now):
        raise ValueError(f"time must be finite; got {now!r}.")
    return now


def later(sample: Sample, t: float, started: bool, *, may_repeat: bool = False) -> float:
    """The sample's time; ValueError unless it is finite and after t (at t, for the first one).

    A first sample after t states no known input: what that was since t would be open.
    may_repeat: rows may share a time.
    """
    now = instant(sample.t)
    if not (now > t or (now == t and (may_repeat or not started))):
        must = "not decrease" if may_repeat else "increase"
        raise ValueError(f"time must {must}; got {now!r} after {t!r}.")
    if sample.u is not None and np.size(sample.u) and now > t and not started:
        raise ValueError(
            f"the known input u must be stated from the time of init, {t!r}, on; got the first at "
            f"{now!r}. Without a measurement at init: Sample({t!r}, u=...)."
        )
    return now


def vector(values: ArrayLike, size: int, name: str) -> Vector:
    """A new float vector of the required size; ValueError names what arrived."""
    result = np.array(values, dtype=np.float64).reshape(-1)
    if result.shape != (size,):
        raise ValueError(f"{name} must have {size} entries; got {result.size}.")
    return result


def optional_measurement(y: ArrayLike | None, size: int) -> Vector | None:
    """The measurement, or None when it is missing (None, or not finite in any entry)."""
    if y is None:
        return None
    result = vector(y, size, "y")
    return result if np.isfinite(result).all() else None


def centred(y: Vector, gains: Gains) -> Vector:
    """Measurements less the middle of the noise's bounds, where a design has one; (..., p)."""
    return y if gains.noise_centre is None else y - gains.noise_centre


def centred_measurement(y: ArrayLike | None, gains: Gains) -> Vector | None:
    """The measurement less the middle of the noise's bounds, or None when it is missing."""
    result = optional_measurement(y, gains.p)
    return None if result is None else centred(result, gains)


def rows_of(
    t: ArrayLike,
    y: ArrayLike | None = None,
    u: ArrayLike | None = None,
    w: ArrayLike | None = None,
    jump: ArrayLike | None = None,
    *,
    mode: Sequence[str | None] | None = None,
) -> Iterator[Sample]:
    """Samples from arrays with one row per time; NaN in y marks a missing sample."""
    return samples_of(Columns.from_arrays(t, y, u, w, jump, mode=mode))


def samples_of(record: Columns) -> Iterator[Sample]:
    """Rows of a record as samples."""
    absent = [None] * len(record.t)
    blocks = (record.y, record.u, record.w, record.bounds, record.mode)
    y, u, w, bounds, mode = (absent if block is None else block for block in blocks)
    happens, events, at_their_time = record.happens, record.events, absent
    columns = (record.t.tolist(), y, u, w, happens, bounds, events, at_their_time, mode)
    for row in zip(*columns, repeat(()), strict=False):
        yield by_position(Sample, row)
