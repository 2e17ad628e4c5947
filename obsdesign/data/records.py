"""Data files (CSV), read a row or a block of rows at a time.

They have the columns of a `Layout`; others are ignored. A row without any y is a missing sample; an
output without an entry beside others is NaN, and every kind decides what the others are worth to
it. An empty bound is the declared one. Every complaint names the file, the line and the column.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice
from typing import TextIO

import numpy as np

from obsdesign.column_names import RECEIVED
from obsdesign.data.arrivals import Arrivals, BadLine, Remark, Skip, require_first
from obsdesign.data.csv_lines import lines_of
from obsdesign.data.layout import Layout
from obsdesign.data.record_header import Header
from obsdesign.errors import InputError
from obsdesign.runtime.base import Sample, samples_of
from obsdesign.runtime.columns import Columns

# a row, or several together
Block = Sample | Columns

_ROWS_TOGETHER = 1024


def discard(text: str) -> None:
    """Discard a remark."""


def read_samples(
    stream: TextIO,
    layout: Layout,
    name: str,
    *,
    remark: Remark = discard,
    skip: Skip | None = None,
) -> Iterator[Sample]:
    """Samples of a whole CSV file, as `read_blocks` has them."""
    return samples_in(read_blocks(stream, layout, name, remark=remark, skip=skip))


def samples_in(blocks: Iterable[Block]) -> Iterator[Sample]:
    """The rows of blocks."""
    for block in blocks:
        if isinstance(block, Columns):
            for sample in samples_of(block):
                is_missing = sample.y is not None and np.isnan(sample.y).all()
                yield sample._replace(y=None) if is_missing else sample
        else:
            yield block


def read_blocks(
    stream: TextIO,
    layout: Layout,
    name: str,
    *,
    after: float = -math.inf,
    remark: Remark = discard,
    skip: Skip | None = None,
    arrivals: Arrivals | None = None,
) -> Iterator[Block]:
    """Rows of a CSV file or pipe, checked; one row is one line.

    after: a time before the first row; remark: called with columns that the plant has no use for;
    skip: called with every line that is no row, instead of an error. Where rows may be late, they
    come in the order of time: all of them, or with `arrivals` those that are final. Rows of a file
    come together where they are numbers alone, those of a stream (`arrivals.is_stream`) each.

    InputError: no header, missing or doubled columns, text where a number belongs, times that do
    not increase, rows of the wrong length.
    """
    lines = enumerate(lines_of(stream, name), start=1)
    header = Header.from_line(next(lines, (1, ""))[1], layout, name)
    if skip is not None and header.bounds is not None:
        header = replace(header, bounds=header.bounds.where_lines_are_skipped(name, remark))
    header.remark_on_unused(remark)
    begins = after == -math.inf if arrivals is None else arrivals.is_first
    if not header.may_be_late:
        together = 1 if arrivals is not None and arrivals.is_stream else _ROWS_TOGETHER
        for block in _blocks(lines, header, after, skip, begins=begins, together=together):
            yield block if isinstance(block, Columns) else block[1]
        return
    rows = (row for row in _blocks(lines, header, -math.inf, skip, begins=begins, together=1)
            if not isinstance(row, Columns))  # fmt: skip
    if arrivals is None:
        samples = sorted((sample for _, sample in rows), key=lambda sample: sample.t)
        require_first(samples[0], layout.first_row, name)
        yield from samples
    else:
        yield from arrivals.in_order(rows, name, skip, has_received=RECEIVED in header.places)


def _blocks(
    lines: Iterator[tuple[int, str]],
    header: Header,
    after: float,
    skip: Skip | None,
    *,
    begins: bool,
    together: int,
) -> Iterator[Columns | tuple[int, Sample]]:
    """Rows behind a header as they stand there: blocks, or samples with numbers of their lines.

    begins: is it the first part of a record? together: lines of a block; 1 for none. InputError
    without any row, but for a later part in which all are skipped.
    """
    plain = header.plain if together > 1 else None
    previous, rows, skipped = after, 0, 0
    while several := list(islice(lines, together)):
        block = None if plain is None else plain.record([line for _, line in several], previous)
        if block is not None:
            previous, rows = float(block.t[-1]), rows + len(block.t)
            yield block
            continue
        for number, line in several:
            is_first = begins and not rows
            try:
                sample = header.row(number, line, previous, is_first=is_first)
            except InputError as error:
                if skip is None:
                    raise
                skip(BadLine(str(error), number, header.time(line), is_first))
                skipped += 1
                continue
            if sample is not None:
                previous, rows = -math.inf if header.may_be_late else sample.t, rows + 1
                yield number, sample
    if not rows and (begins or not skipped):
        raise InputError(
            f"{header.name}: at least one row of data is required; there is only a header."
        )
