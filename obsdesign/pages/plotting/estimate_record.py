"""What a picture of an estimate is drawn from: three CSV files by column."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import EVENT, JUMP, MODE, RECEIVED, STATUS, TIME
from obsdesign.data.csv_lines import OWN_TITLES, column_numbers, read_columns
from obsdesign.errors import InputError
from obsdesign.pages.plotting.row_lines import RowLines
from obsdesign.problem.signal_names import SignalNames

# beyond, the drawing library overflows
_DRAWABLE = 1e100
# with more events than this part of the rows no lines mark them
_EVENTS_ONLY = 0.9
# columns of a record that are no samples, whatever the plant
_NO_SAMPLES = re.compile(rf"{TIME}|{JUMP}|{MODE}|{STATUS}|{EVENT}|{RECEIVED}|[xduw]\d+|.*_(lo|hi)")


@dataclass(frozen=True)
class ClockColumns:
    """Columns of data that say when something happens.

    events: by the name of an event; samples: of sensors that do not measure at every row, None
    where the plant is not known: columns with empty cells then; step: of discrete time, or 0.
    """

    events: Mapping[str, Sequence[str]] = field(default_factory=lambda: {JUMP: (JUMP,)})
    samples: Sequence[str] | None = None
    step: float = 0.0

    def sampled(self, data: Table) -> NDArray[np.bool_]:
        """In which rows of data there is such a sample."""
        titles = self.samples
        if titles is None:
            partial = [title for title, cells in data.columns.items() if "" in cells]
            titles = [title for title in partial if not _NO_SAMPLES.fullmatch(title)]
        return _happens(data, titles)


# of a plant with one kind of jump
ONE_JUMP = ClockColumns()


@dataclass(frozen=True)
class Table:
    """Columns of a CSV file as texts; none where no file is given."""

    path: str
    columns: Mapping[str, list[str]]

    @classmethod
    def from_file(cls, path: str | None, titles: Mapping[str, str] = OWN_TITLES) -> Table:
        """The table in a file, or an empty one; its rows in the order of time, if they have one.

        titles: column by another title of it.
        """
        return cls(str(path), {} if path is None else read_columns(path, titles))._sorted()

    def _sorted(self) -> Table:
        if TIME not in self or not len(times := self.numbers(TIME)) or (np.diff(times) >= 0).all():
            return self
        order = np.argsort(times, kind="stable").tolist()
        return Table(self.path, {x: [own[k] for k in order] for x, own in self.columns.items()})

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def numbers(self, name: str) -> Matrix:
        """A column as floats, NaN where a cell is empty; InputError where it is not of numbers."""
        if name not in self.columns:
            known = ", ".join(self.columns)
            raise InputError(f"{self.path}: column {name!r} is required; it has {known}.")
        return column_numbers(self.columns, name, self.path)

    def drawable(self, name: str) -> Matrix:
        """A column as floats, NaN where the drawing library would overflow."""
        values = self.numbers(name)
        small = np.isfinite(values) & (np.abs(np.nan_to_num(values)) < _DRAWABLE)
        return np.where(small, values, np.nan)

    def deviations(self, name: str) -> Matrix:
        """The standard deviations of a column, zero where they are not known."""
        return np.nan_to_num(self.numbers(f"{name}_std"))

    @property
    def states(self) -> list[str]:
        """x1, x2, ... (unknown inputs d1, ..., further directions l1, ...)."""
        names = []
        for letter in "xdl":
            i = 1
            while f"{letter}{i}" in self or f"{letter}{i}_lo" in self:
                names.append(f"{letter}{i}")
                i += 1
        return names

    @property
    def measurements(self) -> list[str]:
        """y1, y2, ..."""
        return [name for name in self.columns if name[0] == "y" and name[1:].isdigit()]

    @property
    def statuses(self) -> list[str]:
        """The column status; empty where there is none."""
        return self.columns.get("status", [])


@dataclass(frozen=True)
class EstimateRecord:
    """An estimate, the data with the truth, and impulses, as files hold them.

    other: the estimate of a second observer, on the same data; happened: times of each event;
    samples: times of samples of sensors that do not measure at every row; step: of discrete time,
    or 0; names: of states and outputs.
    """

    estimate: Table
    data: Table
    impulses: Table
    other: Table
    t: Matrix
    data_t: Matrix
    happened: Mapping[str, Matrix]
    samples: Matrix
    step: float = 0.0
    names: SignalNames = field(default_factory=SignalNames)

    @classmethod
    def from_files(
        cls, estimate: str, data: str | None, events: str | None, other: str | None = None,
        *, clocks: ClockColumns = ONE_JUMP, titles: Mapping[str, str] = OWN_TITLES,
    ) -> EstimateRecord:  # fmt: skip
        """InputError where a file cannot be read, or they are not of one plant.

        titles: column of the data by another title of it.
        """
        tables = (Table.from_file(estimate), Table.from_file(data, titles), Table.from_file(events))
        return cls.from_tables(*tables, Table.from_file(other), clocks=clocks)

    @classmethod
    def from_tables(
        cls, estimates: Table, truth: Table, impulses: Table, second: Table,
        *, clocks: ClockColumns = ONE_JUMP,
    ) -> EstimateRecord:  # fmt: skip
        """The same from the tables of such files; empty ones where there is no file."""
        t = estimates.numbers("t")
        if not estimates.states or not len(t):
            raise InputError(
                f"{estimates.path}: columns x1_lo, x1_hi or x1 and at least one row are required."
            )
        for table in (truth, second):
            _check_states(estimates, table)
        _check_bounds(estimates, second)
        times = truth.numbers("t") if truth.columns else np.zeros(0)
        happened = {name: times[_happens(truth, titles)] for name, titles in clocks.events.items()}
        samples = times[clocks.sampled(truth)]
        return cls(estimates, truth, impulses, second, t, times, happened, samples,
                   clocks.step)  # fmt: skip

    @property
    def jumps(self) -> Matrix:
        """Times of all events, in order."""
        return np.unique(np.concatenate([np.zeros(0), *self.happened.values()]))

    @property
    def stays(self) -> list[tuple[float, float, str]]:
        """(start, end, mode) of the data, in order; none where they have no modes."""
        if MODE not in self.data:
            return []
        names = self.data.columns[MODE]
        changes = [(t, name) for t, name in zip(self.data_t.tolist(), names, strict=True) if name]
        stays: list[tuple[float, float, str]] = []
        for t, name in changes:
            if stays and stays[-1][2] == name:
                continue
            if stays:
                stays[-1] = (stays[-1][0], t, stays[-1][2])
            stays.append((t, float(self.data_t[-1]), name))
        return stays

    @property
    def has_impulses(self) -> bool:
        """Is there an event file?"""
        return bool(self.impulses.columns)

    @property
    def instants(self) -> Matrix:
        """Times of all events and samples."""
        return np.concatenate([self.jumps, self.samples])

    @property
    def has_events_only(self) -> bool:
        """Is nearly every row an event?"""
        return float(np.isin(self.t, self.jumps).mean()) > _EVENTS_ONLY

    @property
    def steps(self) -> Matrix:
        """Times at which bounds and estimates step; in discrete time a sample is a row like any."""
        return self.jumps if self.step else self.instants

    def lines(self, t: Matrix) -> RowLines:
        """What a line through rows at times t, of one of the files, joins."""
        return RowLines(t, self.instants, self.step)

    @property
    def panels(self) -> list[str]:
        """Names of the panels, from the top down."""
        if not self.has_impulses:
            return self.estimate.states
        return [*self.data.measurements, *self.estimate.states, "weight"]


def _happens(data: Table, titles: Sequence[str]) -> NDArray[np.bool_]:
    """In which rows one of an event's columns says that it happens."""
    rows = len(data.columns.get(TIME, ()))
    happens = np.zeros(rows, bool)
    for title in titles:
        if title in data:
            values = data.numbers(title)
            happens |= values == 1 if title == JUMP else np.isfinite(values)
    return happens


def _check_bounds(estimate: Table, other: Table) -> None:
    """InputError unless both tables have bounds to be compared."""
    for table in (estimate, other) if other.columns else ():
        if "x1_lo" not in table:
            raise InputError(f"{table.path}: bounds x1_lo, x1_hi are required; it has none.")


def _check_states(estimate: Table, data: Table) -> None:
    """InputError if the states of another table are more or fewer than those of the estimate."""
    mine, theirs = (sum(name[0] == "x" for name in table.states) for table in (estimate, data))
    if theirs and mine != theirs:
        raise InputError(
            f"{data.path}: {mine} states are required, as in {estimate.path}; it has {theirs}. "
            "Is it the data of another plant?"
        )
