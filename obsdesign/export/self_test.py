"""The self-test of exported code: rows of a record as initialisers of C, and its tolerances."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.export.execution import Execution, Row
from obsdesign.export.record import Record
from obsdesign.export.source import Export, literals

# what compilers may add to the difference of this record: fused products, other orders
_FACTOR = 8.0
# parts of the largest number by which binary64 may differ
_ROUNDING = 2.0**-44


def self_test_words(export: Export, record: Record) -> NewEntries:
    """What the template of the self-test needs beside the words of the source."""
    ours = answers(export, record)
    size = np.abs(record.ends).max(axis=0) + 1.0
    # time stamps of the runtime have errors, which widen its bounds; lengths of steps have none
    wider, narrower = (
        np.maximum(off, 0.0).max(axis=0) for off in (record.ends - ours, ours - record.ends)
    )
    names = ("lower", "upper") if export.program.has_bounds else ("first",)
    return {
        "test_rows": [
            _row(export, row, ends, is_ok)
            for row, ends, is_ok in zip(record.rows, record.ends, record.is_ok, strict=True)
        ],
        "wider": [f"{value:.3g}" for value in _FACTOR * wider + _ROUNDING * size],
        "narrower": [f"{value:.3g}" for value in _FACTOR * narrower + _ROUNDING * size],
        "initial_numbers": [
            (name, literals(export, values.tolist()))
            for name, values in zip(names, record.initial, strict=True)
        ],
    }


def answers(export: Export, record: Record) -> Matrix:
    """What the program answers to the rows of a record, (rows, ends)."""
    execution = Execution(export.program)
    state, ends = execution.start(*record.initial), []
    for row in record.rows:
        state, answer = execution.step(state, row)
        ends.append(answer.astype(np.float64))
    return np.array(ends)


def _row(export: Export, row: Row, ends: Matrix, is_ok: bool) -> str:
    program = export.program
    sizes = program.sizes
    length = program.timing.lengths[row.step - 1] if row.step else 0.0
    y = np.zeros(sizes.p) if row.y is None else row.y
    parts = [literals(export, [length])[0], _list(literals(export, y.tolist()))]
    if sizes.m:
        u = np.zeros(sizes.m) if row.u is None else row.u
        parts.append(_list(literals(export, u.tolist())))
    if program.jumps and sizes.l:
        w = np.zeros(sizes.l) if row.w is None else row.w
        parts.append(_list(literals(export, w.tolist())))
    parts.append(_word(row.y is not None))
    if program.jumps:
        parts.append(_word(row.jump))
    stated = _list([f"{value!r}" for value in ends.tolist()])
    return f"{_list(parts)}, {stated}, {_word(is_ok)}"


def _list(parts: list[str]) -> str:
    return "{ " + ", ".join(parts) + " }"


def _word(value: bool) -> str:
    return "true" if value else "false"
