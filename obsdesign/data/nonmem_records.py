"""Records of a plant from a NONMEM data set: one for each subject, and for each reset."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TypeVar

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.column_names import JUMP, TIME, numbered
from obsdesign.data.nonmem import NonmemRow, nonmem_rows
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant

Target = TypeVar("Target")


@dataclass(frozen=True)
class Targets:
    """Where DVID, and CMT of doses and infusions, go.

    samples, doses, rates: column by number; for a dose also all that its event writes. after:
    columns of sensors that see the state after an event; may_repeat: rows may share a time.
    """

    samples: Mapping[int, str]
    doses: Mapping[int, tuple[str, Mapping[str, float]]]
    rates: Mapping[int, str]
    after: frozenset[str] = frozenset()
    may_repeat: bool = True

    @classmethod
    def from_plant(cls, plant: Plant) -> Targets:
        """DVID counts outputs; CMT is the one state that a column of E or B acts on."""
        titles = [title for sensor in plant.sensors for title in sensor.columns]
        seen_after = [t for t, after in zip(titles, plant.sees_after, strict=True) if after]
        doses: dict[int, tuple[str, Mapping[str, float]]] = {}
        first = 0
        for event in plant.events:
            own = event.columns if plant.has_tables else numbered("w", event.inputs)
            own = own if event.inputs else ()
            jump = {} if plant.has_tables else {JUMP: 1.0}
            for title, state in zip(own, _states(event.E), strict=True):
                others = dict.fromkeys(own, 0.0) | jump
                doses.setdefault(state, (title, others))
            first += event.inputs
        inputs = numbered("u", 0 if plant.flow.B is None else plant.flow.B.shape[1])
        rates = dict(zip(_states(plant.flow.B), inputs, strict=True))
        return cls(
            dict(enumerate(titles, 1)), doses, rates, frozenset(seen_after),
            not plant.has_one_clock,
        )  # fmt: skip

    @classmethod
    def from_rows(cls, rows: Iterable[NonmemRow]) -> Targets:
        """Columns dv, dose, numbered by DVID and CMT where there are several, and u1, u2, ..."""
        listed = list(rows)
        kinds = [
            sorted({row.dvid or 1 for row in listed if row.evid == 0}),
            sorted({row.cmt or 1 for row in listed if row.is_dose and not row.rate}),
            sorted({row.cmt or 1 for row in listed if row.is_dose and row.rate}),
        ]
        names = [
            {k: name if len(own) == 1 else f"{name}{k}" for k in own}
            for name, own in zip(("dv", "dose"), kinds, strict=False)
        ]
        rates = dict(zip(kinds[2], numbered("u", len(kinds[2])), strict=True))
        return cls(names[0], {k: (title, {}) for k, title in names[1].items()}, rates)

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of a record behind t."""
        doses = [x for title, others in self.doses.values() for x in (*others, title)]
        inputs = sorted(self.rates.values(), key=lambda name: int(name[1:]))
        return tuple(dict.fromkeys((*self.samples.values(), *inputs, *doses)))


def _states(columns: Matrix | None) -> list[int]:
    """The one state, from 1, that each column acts on; a negative number where there are more."""
    listed = [] if columns is None else [np.flatnonzero(own) for own in columns.T]
    return [int(own[0]) + 1 if len(own) == 1 else -1 - k for k, own in enumerate(listed)]


@dataclass
class _Item:
    """What happens at a time: values by column; first: it stands before the lines of that time."""

    t: float
    values: Mapping[str, float]
    where: str
    first: bool = False
    is_dose: bool = False


@dataclass(frozen=True)
class _Infusion:
    """A rate from start to end, in a column of inputs."""

    start: float
    end: float
    title: str
    rate: float

    def lasts(self, t: float) -> bool:
        """Is the rate given from t on?"""
        return self.start <= t < self.end


@dataclass
class _Record:
    """What happens to a subject from a reset to the next."""

    subject: str
    items: list[_Item] = field(default_factory=list)
    infusions: list[_Infusion] = field(default_factory=list)
    latest: float = -math.inf

    def cut(self, t: float) -> None:
        """Drop additional doses, and ends of infusions, from the time of a reset on."""
        self.items = [item for item in self.items if not item.first or item.t < t]


def records_of(path: str, plant: Plant | None) -> list[tuple[str, dict[str, Array]]]:
    """(subject, columns) of every record of a data set; without a plant columns dv, dose, u1.

    InputError for a line that cannot be converted, or that the plant has no column for.
    """
    rows = list(nonmem_rows(path))
    if not rows:
        raise InputError(f"{path}: at least one line of data is required; there is only a header.")
    targets = Targets.from_rows(rows) if plant is None else Targets.from_plant(plant)
    return [(record.subject, _table(record, targets)) for record in _records(rows, targets)]


def _records(rows: Sequence[NonmemRow], targets: Targets) -> Iterator[_Record]:
    """Records of consecutive lines of a subject."""
    record: _Record | None = None
    for row in rows:
        if record is None or row.subject != record.subject or row.is_reset:
            if record is not None:
                if row.subject == record.subject:
                    behind = math.nextafter(record.latest, math.inf)
                    record.cut(row.t if row.t >= record.latest else behind)
                yield record
            record = _Record(row.subject)
        if row.t < record.latest:
            raise InputError(
                f"{row.where}: TIME must not decrease for a subject; got {row.t:g} after "
                f"{record.latest:g}. A reset (EVID = 3 or 4) begins a new record."
            )
        record.latest = row.t
        _add(record, row, targets)
    if record is not None:
        yield record


def _add(record: _Record, row: NonmemRow, targets: Targets) -> None:
    """What a line says."""
    if not row.is_dose:
        sampled = {}
        if row.evid == 0:
            title = _target(targets.samples, row.dvid, row.where, "DVID", "outputs")
            sampled = {} if row.dv is None else {title: row.dv}
        record.items.append(_Item(row.t, sampled, row.where))
        return
    for k in range(row.addl + 1):
        t = round(row.t + k * row.ii, 12) if k else row.t
        if row.rate:
            title = _target(targets.rates, row.cmt, row.where, "CMT", "inputs u of infusions")
            end = round(t + row.amt / row.rate, 12)
            record.infusions.append(_Infusion(t, end, title, row.rate))
            record.items.append(_Item(t, {}, row.where, first=k > 0))
            record.items.append(_Item(end, {}, row.where, first=True))
        else:
            title, others = _target(targets.doses, row.cmt, row.where, "CMT", "inputs of events")
            values = {**others, title: row.amt}
            record.items.append(_Item(t, values, row.where, first=k > 0, is_dose=True))


def _target(
    known: Mapping[int, Target], number: int | None, where: str, title: str, what: str
) -> Target:
    """The target of a number; the only one where there is no number."""
    if number is None and len(known) == 1:
        return next(iter(known.values()))
    if number is None or number not in known:
        listed = ", ".join(str(k) for k in sorted(known) if k > 0) or "none"
        got = "none" if number is None else number
        raise InputError(
            f"{where}: {title} must be one of the plant's {what} ({listed}); got {got}."
        )
    return known[number]


def _table(record: _Record, targets: Targets) -> dict[str, Array]:
    """Columns of a record."""
    rows = _merged(record, targets)
    times = [t for t, _ in rows]
    table: dict[str, Array] = {TIME: np.array(times)}
    for name in targets.columns:
        table[name] = np.array([values.get(name, math.nan) for _, values in rows])
    for name in targets.rates.values():
        own = [x for x in record.infusions if x.title == name]
        table[name] = np.array([math.fsum(x.rate for x in own if x.lasts(t)) for t in times])
    if JUMP in table:
        table[JUMP] = np.nan_to_num(table[JUMP]).astype(np.int64)
    return table


def _merged(record: _Record, targets: Targets) -> list[tuple[float, Mapping[str, float]]]:
    """(t, values) of rows: samples of one time share a row, with the first dose behind them."""
    rows: list[tuple[float, Mapping[str, float]]] = []
    t, has_dose = math.nan, False
    for item in sorted(record.items, key=lambda item: (item.t, not item.first)):
        if item.t == t:
            values = rows[-1][1]
            clashes = bool(item.values) and (has_dose or not values.keys().isdisjoint(item.values))
            if item.is_dose and not targets.after.isdisjoint(values):
                clashes = True
            if not clashes:
                rows[-1] = (t, {**values, **item.values})
                has_dose = has_dose or item.is_dose
                continue
            if not targets.may_repeat:
                raise InputError(
                    f"{item.where}: one row at t = {t:g} is required, since the plant has one "
                    "clock; this line needs a second one, behind a dose."
                )
        rows.append((item.t, item.values))
        t, has_dose = item.t, item.is_dose
    return rows


def file_names(output: str, subjects: Sequence[str]) -> list[str]:
    """A file for each record: `output`, with the subject in its name where there are several."""
    if len(subjects) == 1:
        return [output]
    path = Path(output)
    names: list[str] = []
    for subject in subjects:
        word = "".join(c if c.isalnum() or c in "-." else "_" for c in subject) or "record"
        words = (word if k == 1 else f"{word}_{k}" for k in count(1))
        tries = (str(path.with_name(f"{path.stem}_{own}{path.suffix}")) for own in words)
        names.append(next(name for name in tries if name not in names))
    return names
