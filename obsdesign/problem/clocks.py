"""Events and sensors of a problem file: named jumps and outputs, each on a clock of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

from lmi.arithmetic.arrays import Matrix, Value
from obsdesign.column_names import signal_columns
from obsdesign.entries import is_number, positive, real, shown
from obsdesign.errors import InputError
from obsdesign.problem.blocks import set_fields
from obsdesign.problem.names import MODE_NAMES, NAME_SCHEMA, check_name
from obsdesign.problem.noise import noise_numbers
from obsdesign.problem.output import IRREGULAR, Output
from obsdesign.problem.plant import Jump
from obsdesign.problem.schema import NONNEGATIVE, Fragment, file_entry, one_of, ref, whole_number
from obsdesign.problem.time_ranges import time_range

Every = float | tuple[float, float]
CONTINUOUS = "continuous"
TRIGGER: Fragment = {
    "type": "object",
    "title": "a table { surface = [...], state = [...] }",
    "required": ["surface", "state"],
    "properties": {"surface": ref("vector"), "state": ref("vector")},
    "additionalProperties": False,
}
SEES = ("before", "after")


@dataclass(frozen=True, eq=False, kw_only=True)
class Event(Jump):
    """A jump by a name of its own, some time after the last one of that name.

    name: of its column in data; every: that time as a number, or (shortest, longest), None where it
    is not stated; dwell_time follows from it; report_delay: longest time until it is known;
    time_error: it happens within that time of its stamp, before or after it, and `every` is of the
    stamps; input_bound: largest |w| of each known input, for claims about widths alone; modes:
    names of those in which alone it happens, None for any. Otherwise as `Jump`.
    """

    name: str = file_entry(NAME_SCHEMA, "Name of the event, and of its column in data.")
    every: Every | None = file_entry(
        ref("every"), "Time since the last event of this name: a number, or [shortest, longest].",
        default=None,
    )  # fmt: skip
    report_delay: float = file_entry(
        NONNEGATIVE, "Longest time until a row that reports it arrives; default 0.", default=0.0
    )
    time_error: float = file_entry(
        NONNEGATIVE, "It happens within this time of its stamp, before or after; default 0.",
        default=0.0,
    )  # fmt: skip
    modes: tuple[str, ...] | None = file_entry(
        MODE_NAMES, "Modes in which alone it happens; default any.", default=None
    )
    trigger: dict[str, Matrix] | None = file_entry(
        TRIGGER, "Refused: an event that the estimate triggers at surface x = const, in a state.",
        default=None,
    )  # fmt: skip
    dwell_time: tuple[float, float] | None = field(default=None, init=False)
    dwell_jitter: float = field(default=math.inf, init=False)
    G_radius: Matrix | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        check_name(self.name, "event")
        self.check_map()
        ends = _range(self.every, f"{self.entry}.every")
        every = ends[0] if ends is not None and is_number(self.every) else ends
        modes = None if self.modes is None else tuple(self.modes)
        set_fields(self, every=every, dwell_time=ends, dwell_jitter=math.inf, modes=modes)
        _check_delay(self)
        self._check_error()

    def _check_error(self) -> None:
        """InputError unless the error of stamps leaves time between two of them; a float then."""
        error = real(self.time_error, f"{self.entry}.time_error")
        if not 0 <= error < math.inf:
            raise InputError(f"{self.entry}.time_error must be a number >= 0; got {error!r}.")
        shortest = math.inf if self.dwell_time is None else self.dwell_time[0]
        if error and not 2 * error < shortest:
            raise InputError(
                f"{self.entry}.time_error must be below half the shortest time between two stamps, "
                f"{shortest / 2:g}; got {error:g}."
            )
        set_fields(self, time_error=error, stamp_error=error)

    @property
    def entry(self) -> str:
        """What messages call it."""
        return f"event.{self.name}"

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns in a data file: of its known inputs, or one that says that it happened."""
        return signal_columns(self.name, 1 if self.E is None else len(self.E[0]))


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensor(Output):
    """An output by a name of its own, and its clock; C and the noise as for `Output`.

    every: time between two samples as a number, a range (shortest, longest), or "continuous"; at:
    name of the event at which it is read, instead. jitter: largest distance of a sample from the
    grid k every; losses: most samples in a row that may be missing. sends_on_change (p,): it sends
    a sample as soon as the reading of an output has changed by so much since the last one, and
    after every[1] at the latest; None where it does not. sees: at an event it sees the state before
    or after. report_delay: longest time until a sample is known. time_error: refused above 0.
    """

    is_named: ClassVar[bool] = True
    name: str = file_entry(NAME_SCHEMA, "Name of the sensor, and of its column in data.")
    every: Every | str | None = file_entry(
        ref("sensor_every"),
        'Time between two samples: a number, [shortest, longest], or "continuous".',
        default=None,
    )
    jitter: float = file_entry(
        NONNEGATIVE, "Largest distance of a sample from the grid k every; default 0.", default=0.0
    )
    losses: int = file_entry(
        whole_number(0, 1_000_000),
        "Most samples in a row that may be missing; default 0.",
        default=0,
        whole=True,
    )
    sends_on_change: Matrix | None = file_entry(
        ref("per_output"),
        "It sends when its reading has changed by this since the last sample; requires "
        "every = [0, longest].",
        default=None,
    )
    at: str | None = file_entry(
        NAME_SCHEMA, "Name of the event at which it is read, instead of every.", default=None
    )
    report_delay: float = file_entry(
        NONNEGATIVE, "Longest time until a row with its sample arrives; default 0.", default=0.0
    )
    time_error: float = file_entry(
        NONNEGATIVE, "Refused above 0: state a larger noise_bound; default 0.", default=0.0
    )
    sees: str = file_entry(
        one_of(*SEES), "At an event it sees the state before or after; default before.",
        default="before",
    )  # fmt: skip
    measured: str = field(default=IRREGULAR, init=False)
    period: float | None = field(default=None, init=False)
    jump_measurement: str = field(default="before", init=False)
    C_radius: Matrix | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        check_name(self.name, "sensor")
        self.check_measurement()
        if self.sees not in SEES:
            raise InputError(f"{self.entry}.sees must be before or after; got {self.sees!r}.")
        if (self.every is None) == (self.at is None):
            got = "both" if self.at is not None else "neither"
            raise InputError(
                f"{self.entry}.every (a number, [shortest, longest] or {CONTINUOUS!r}) or "
                f"{self.entry}.at (an event) is required; got {got}."
            )
        set_fields(self, measured=self._measured(), jump_measurement=self.sees)
        _check_delay(self)
        self._check_stamps()
        if self.sends_on_change is not None:
            self._check_change(self.sends_on_change)

    def _measured(self) -> str:
        """The word of an [output] for its clock; InputError for a clock that cannot be met."""
        jitter, losses = real(self.jitter, f"{self.entry}.jitter"), self.losses
        if not is_number(self.every) and (jitter or losses):
            which = "jitter" if jitter else "losses"
            raise InputError(
                f"{self.entry}.{which} requires a number as {self.entry}.every; got "
                f"{shown(self.every if self.at is None else self.at)}."
            )
        if self.at is not None:
            return "at_jumps"
        if self.every == CONTINUOUS:
            return CONTINUOUS
        entry = f"{self.entry}.every"
        if not is_number(self.every):
            set_fields(self, every=_range(self.every, entry))
            return IRREGULAR
        period = positive(real(self.every, entry), entry)
        if not 0 <= jitter <= period / 2:
            raise InputError(
                f"{self.entry}.jitter must be from 0 to half of every, {period / 2:g}; got "
                f"{jitter:g}."
            )
        set_fields(self, every=period)
        if jitter or losses:
            return IRREGULAR
        set_fields(self, period=period)
        return "periodic"

    def _check_stamps(self) -> None:
        """InputError unless samples are taken at their stamps; the error then belongs to v."""
        error, entry = real(self.time_error, f"{self.entry}.time_error"), self.entry
        if error != 0.0:
            raise InputError(
                f"{entry}.time_error is not available: state a {entry}.noise_bound that is larger "
                f"by {error:g} times the largest rate of change of C x, and leave out samples "
                "stamped within that time of an event that changes C x."
            )

    def _check_change(self, values: Value) -> None:
        """InputError unless it may send at any time, at once, when a reading has changed."""
        entry = f"{self.entry}.sends_on_change"
        changes = noise_numbers(values, self.C, entry)
        for change in changes.tolist():
            positive(change, entry)
        if not isinstance(self.every, tuple) or self.every[0] > 0:
            got = shown(self.every if self.at is None else self.at)
            raise InputError(
                f"{entry} requires {self.entry}.every = [0, longest silence], since a change may "
                f"come at any time; got {got}."
            )
        if self.report_delay:
            raise InputError(
                f"{entry} requires a sensor without report_delay: its reading is bounded between "
                f"two samples only where they come at once; got {self.report_delay:g}."
            )
        set_fields(self, sends_on_change=changes)

    @property
    def entry(self) -> str:
        """What messages call it."""
        return f"sensor.{self.name}"

    def required_clock(self, fitting: Sequence[str]) -> str:
        """Sentence without its end: how its file says that it is measured in one of these ways."""
        written = {CONTINUOUS: f'every = "{CONTINUOUS}"', "at_jumps": 'at = "EVENT"'}
        ways = [written.get(way, "a number as every") for way in fitting]
        return f"{self.entry} must have {' or '.join(ways)}"

    @property
    def own_clock(self) -> str:
        """Its clock as its file has it."""
        return f"every = {shown(self.every)}" if self.at is None else f"at = {shown(self.at)}"

    @property
    def columns(self) -> tuple[str, ...]:
        """Its columns in a data file."""
        return signal_columns(self.name, len(self.C))

    @property
    def stated_times(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Entries that hold times of its clock, each with these."""
        every = self.every
        ends = every if isinstance(every, tuple) else () if isinstance(every, str) else (every,)
        times = tuple(end for end in ends if end is not None)
        return (("every", times), ("jitter", (self.jitter,)))

    def at_every_step(self, dt: float) -> Self:
        """The same sensor, read at every step of discrete time."""
        return replace(self, every=dt)

    @property
    def gap(self) -> float:
        """Longest time between two samples; 0 where every row has one, infinite if not bounded."""
        if isinstance(self.every, tuple):
            return self.every[1]
        if self.every is None or isinstance(self.every, str):
            return super().gap
        return self.every * (1 + self.losses) + 2 * self.jitter

    @property
    def event(self) -> str | None:
        """Name of the event at which alone it is read; None where it has a clock of its own."""
        return self.at


def _check_delay(block: Event | Sensor) -> None:
    """InputError unless its report delay is a number >= 0; a float from now on."""
    delay = real(block.report_delay, f"{block.entry}.report_delay")
    if not 0 <= delay < math.inf:
        raise InputError(f"{block.entry}.report_delay must be a number >= 0; got {delay!r}.")
    set_fields(block, report_delay=delay)


def _range(values: Value, entry: str) -> tuple[float, float] | None:
    """(shortest, longest) from a number or a pair."""
    if is_number(values):
        positive(real(values, entry), entry)
        return time_range((values, values), entry, "time")
    return time_range(values, entry, "time")
