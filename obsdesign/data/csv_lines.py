"""Lines and cells of CSV files: text of bounded length, one row a line."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import TextIO

from obsdesign.errors import InputError

# characters: hundreds of columns of numbers in full
_LONGEST_LINE = 2**20
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


def read_columns(path: str) -> dict[str, list[str]]:
    """A whole CSV file by column, as text: what a picture is made of.

    InputError when it cannot be read or its rows differ in length.
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
            table: dict[str, list[str]] = {title.strip(): [] for title in header}
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
