"""Lines and cells of CSV files: text of bounded length, one row a line."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TextIO

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.entries import numbers_from_cells
from obsdesign.errors import InputError

# characters: hundreds of columns of numbers in full
_LONGEST_LINE = 2**20
# columns that have no other titles than their own
OWN_TITLES: Mapping[str, str] = MappingProxyType({})
_NOT_TEXT = "{}: UTF-8 text is required; it is not. Is it a binary file?"


def lines_of(stream: TextIO, name: str) -> Iterator[str]:
    """The lines of a stream; InputError for one too long to be a row."""
    try:
        while line := stream.readline(_LONGEST_LINE + 1):
            if len(line) > _LONGEST_LINE:
                raise InputError(
                    f"{name}: lines of at most {_LONGEST_LINE} characters are required; one is "
                    "longer. Is it a data file?"
                )
            yield line
    except UnicodeDecodeError:
        raise InputError(_NOT_TEXT.format(name)) from None


def cells_of(line: str, where: str, name: str) -> list[str]:
    """The cells of one line; an InputError is about this line alone."""
    if not line.isascii() and any("\ud800" <= x <= "\udfff" for x in line):
        raise InputError(_NOT_TEXT.format(name))  # bytes that a stream handed on as they were
    if "\0" in line:
        raise InputError(f"{name}: a text file is required; it holds a zero byte.")
    try:
        return next(csv.reader([line], strict=True), [])
    except csv.Error as error:
        raise InputError(f"{where}: not valid CSV: {error}.") from None


def all_titles(names: Mapping[str, str], further: Mapping[str, str]) -> Mapping[str, str]:
    """Column by title, from names of columns and titles further of these or of the columns."""
    return {**names, **{title: names.get(of, of) for title, of in further.items()}}


def columns_titled(header: Sequence[str], titles: Mapping[str, str]) -> list[str]:
    """The columns that the titles of a header stand for; titles: column by another title of it."""
    stripped = [title.strip() for title in header]
    if stripped:
        stripped[0] = stripped[0].removeprefix("\ufeff")  # the mark of UTF-8 by some programs
    return [titles.get(title, title) for title in stripped]


def column_numbers(columns: Mapping[str, list[str]], name: str, path: str) -> Matrix:
    """A column of a table as floats, NaN where a cell is empty; InputError for other texts."""
    try:
        return np.array(numbers_from_cells(columns[name]))
    except ValueError as error:
        raise InputError(f"{path}: column {name!r} must hold numbers; {error}.") from None


def read_columns(path: str, titles: Mapping[str, str] = OWN_TITLES) -> dict[str, list[str]]:
    """A whole CSV file by column, as text: what a picture is made of.

    titles: column by another title of it. InputError when it cannot be read, a column stands twice
    or its rows differ in length.
    """
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            rows = (
                (number, cells_of(line, f"{path} line {number}", path))
                for number, line in enumerate(lines_of(file, path), start=1)
            )
            header = next(rows, (1, []))[1]
            if not header:
                raise InputError(f"{path}: a header line is required; the file is empty.")
            columns = columns_titled(header, titles)
            table: dict[str, list[str]] = {column: [] for column in columns}
            if len(table) < len(columns):
                twice = next(column for column in columns if columns.count(column) > 1)
                raise InputError(f"{path}: column {twice!r} stands twice in the header.")
            for number, cells in rows:
                if cells and len(cells) != len(header):
                    raise InputError(
                        f"{path} line {number}: {len(header)} values are required, one per "
                        f"column; got {len(cells)}."
                    )
                for title, cell in zip(table, cells, strict=False):
                    table[title].append(cell.strip())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    return table
