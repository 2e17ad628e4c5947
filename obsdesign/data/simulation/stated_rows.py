"""Rows of a simulation that a file states: times, events, inputs, samples that are there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.column_names import JUMP, MODE, TIME, numbered
from obsdesign.data.csv_lines import OWN_TITLES, all_titles, column_numbers, read_columns
from obsdesign.data.simulation.discrete_times import require_steps
from obsdesign.data.simulation.rows import Instants
from obsdesign.data.simulation.signals import Signals
from obsdesign.data.simulation.stays import ModeTimes
from obsdesign.errors import InputError
from obsdesign.problem.plant import Plant
from obsdesign.problem.problem import Problem

_Columns = Mapping[str, list[str]]


@dataclass(frozen=True)
class StatedRows:
    """What a file states of the rows of a simulation; what is None is drawn.

    instants: times, events, which outputs are read (every one where the file has no column of it),
    changes of mode. u (rows, m): the last value is held over empty cells; w (rows, l), d (rows, q).
    """

    instants: Instants
    u: Matrix | None
    w: Matrix | None
    d: Matrix | None

    @staticmethod
    def from_file(
        path: str, problem: Problem, titles: Mapping[str, str] = OWN_TITLES
    ) -> StatedRows:
        """The rows of a CSV file with column t and those of all events and modes.

        titles: column by another title of it. InputError where it cannot be read, lacks such a
        column, or its times do not increase.
        """
        plant = problem.plant
        columns = read_columns(path, all_titles(problem.names.columns, titles))
        times = _required(columns, (TIME,), path)[:, 0]
        _check_times(times, plant, path)
        happens, w = _events(columns, plant, path)
        instants = Instants(
            times, happens, _is_read(columns, plant, happens, path),
            _modes(columns, plant, times, path), start=float(times[0]),
        )  # fmt: skip
        flow = plant.flow
        u, d = (
            _optional(columns, numbered(letter, 0 if matrix is None else matrix.shape[1]), path)
            for letter, matrix in (("u", flow.B), ("d", flow.D))
        )
        return StatedRows(instants, None if u is None else _held(u, path), w, d)

    def signals(self, drawn: Signals) -> Signals:
        """Signals with the inputs of the file in place of those drawn."""
        given = {name: getattr(self, name) for name in ("u", "w")}
        signals = replace(drawn, **{name: x for name, x in given.items() if x is not None})
        return signals if self.d is None else signals.with_unknown_input(self.d)


def _check_times(times: Matrix, plant: Plant, path: str) -> None:
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise InputError(f"{path}: t must be finite and increase from row to row.")
    for h in np.diff(times) if plant.flow.dt is not None else ():
        require_steps(float(h), float(plant.flow.dt or 0.0), f"{path}: the time between rows")


def _events(columns: _Columns, plant: Plant, path: str) -> tuple[NDArray[np.bool_], Matrix | None]:
    """Which events happen (rows, events), and their known inputs (rows, l), where they are."""
    rows = len(columns[TIME])
    if not plant.events:
        return np.zeros((rows, 0), bool), None
    if not plant.has_tables:
        jumps = _required(columns, (JUMP,), path)
        w = _optional(columns, numbered("w", plant.events[0].inputs), path)
        return np.asarray(np.nan_to_num(jumps) != 0), None if w is None else np.nan_to_num(w)
    own = [_required(columns, event.columns, path) for event in plant.events]
    happens = np.column_stack([np.isfinite(values).any(axis=1) for values in own])
    inputs = [values for event, values in zip(plant.events, own, strict=True) if event.inputs]
    for k, event in enumerate(plant.events):
        if not event.inputs:
            happens[:, k] = np.nan_to_num(own[k][:, 0]) != 0
    return happens, np.nan_to_num(np.hstack(inputs)) if inputs else None


def _is_read(
    columns: _Columns, plant: Plant, happens: NDArray[np.bool_], path: str
) -> NDArray[np.bool_]:
    """Which outputs are read at each row, (rows, p): where their cell is not empty."""
    names = [event.name for event in plant.events]
    read = []
    for sensor in plant.sensors:
        for title in sensor.columns:
            there = np.ones(len(happens), bool)
            if title in columns:
                there = np.isfinite(_required(columns, (title,), path)[:, 0])
            if sensor.event is not None:
                there &= happens[:, names.index(sensor.event)]
            read.append(there)
    return np.column_stack(read)


def _modes(columns: _Columns, plant: Plant, times: Matrix, path: str) -> ModeTimes | None:
    """Changes of mode, where the plant has modes; an empty cell keeps the mode."""
    if not plant.modes:
        return None
    if MODE not in columns or not columns[MODE] or not columns[MODE][0]:
        raise InputError(f"{path}: column 'mode' is required, with a mode in the first row.")
    names = [mode.name for mode in plant.modes]
    changes = [(k, name) for k, name in enumerate(columns[MODE]) if name]
    for k, name in changes:
        if name not in names:
            raise InputError(f"{path} line {k + 2}: mode must be one of {', '.join(names)}.")
    places = [names.index(name) for _, name in changes]
    kept = [i for i in range(1, len(changes)) if places[i] != places[i - 1]]
    at = np.array([times[changes[i][0]] for i in kept])
    return ModeTimes(places[0], at, tuple(places[i] for i in kept))


def _held(u: Matrix, path: str) -> Matrix:
    """Inputs with the last value in place of an empty cell."""
    if not np.isfinite(u[0]).all():
        raise InputError(f"{path}: inputs u are required in the first row.")
    last = np.maximum.accumulate(np.where(np.isfinite(u), np.arange(len(u))[:, None], 0), axis=0)
    return np.take_along_axis(u, last, axis=0)


def _optional(columns: _Columns, titles: Sequence[str], path: str) -> Matrix | None:
    """Columns as numbers (rows, k), NaN for empty cells; None where the file has none of them."""
    return _required(columns, titles, path) if any(x in columns for x in titles) else None


def _required(columns: _Columns, titles: Sequence[str], path: str) -> Matrix:
    """The same; InputError where one is missing or no number, or the file has no rows."""
    for title in titles:
        if title not in columns:
            raise InputError(
                f"{path}: column {title!r} is required; the header has {', '.join(columns)}."
            )
        if not columns[title]:
            raise InputError(f"{path}: at least one row is required; there is only a header.")
    return np.array([column_numbers(columns, title, path) for title in titles]).T
