"""A sweep on disk: JSON lines, a header and one line per point.

The digest at the end of a line is that of the first line and this point together. A point of
another sweep, or one that was edited, does not match it.

While it grows, lines stand in the order in which they were finished; a complete file is put in the
order of its points, so that two runs of one sweep leave the same bytes, interrupted or not.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from lmi.arithmetic.arrays import Entries, NewEntries
from obsdesign import __version__
from obsdesign.document import digest
from obsdesign.entries import is_number
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.studies.sweep.axes import Axis
from obsdesign.studies.sweep.point import MOST_POINTS, Plan, SweepPoint

FORMAT = "obsdesign/sweep"
VERSION = 1


@dataclass(frozen=True)
class SweepHeader:
    """The first line: the entries that have to agree for a sweep to continue in a file."""

    name: str
    kind: str
    problem: str
    over: tuple[Axis, ...]
    quantity: str
    accuracy: float
    seconds: float | None
    version: str

    @staticmethod
    def from_plan(plan: Plan) -> SweepHeader:
        """The header of a plan, for this version of the package."""
        return SweepHeader(
            name=plan.body["name"],
            kind=plan.body["observer"]["kind"],
            problem=digest(dict(plan.body)),
            over=plan.axes,
            quantity=plan.what,
            accuracy=plan.accuracy,
            seconds=plan.seconds,
            version=__version__,
        )

    def to_dict(self) -> NewEntries:
        """The first line, JSON-ready."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "kind": self.kind,
            "problem": self.problem,
            "over": [axis.to_dict() for axis in self.over],
            "for": self.quantity,
            "accuracy": self.accuracy,
            "time": self.seconds,
            "obsdesign": self.version,
        }

    @staticmethod
    def from_dict(line: Entries) -> SweepHeader:
        """The header of a first line; entries that it lacks are empty."""
        return SweepHeader(
            name=line.get("name", ""),
            kind=line.get("kind", ""),
            problem=line.get("problem", ""),
            over=tuple(Axis(**axis) for axis in line["over"]),
            quantity=line.get("for", ""),
            accuracy=line.get("accuracy", math.nan),
            seconds=line.get("time"),
            version=line.get("obsdesign", ""),
        )

    def difference(self, other: SweepHeader) -> str:
        """The first entry in which `other` differs, with both values; "" if there is none."""
        if self.problem != other.problem:
            return "problem"
        if self.kind != other.kind:
            return f"observer kind: {self.kind} there, {other.kind} here"
        if self.over != other.over:
            old, new = (" ".join(map(str, header.over)) for header in (self, other))
            return f"--over: {old} there, {new} here"
        entries: tuple[tuple[str, object, object], ...] = (
            ("--for", self.quantity, other.quantity),
            ("--accuracy", self.accuracy, other.accuracy),
            ("--time", self.seconds, other.seconds),
            ("version of obsdesign", self.version, other.version),
        )
        for word, stored, planned in entries:
            if stored != planned:
                return f"{word}: {stored} there, {planned} here"
        return ""


@dataclass(frozen=True)
class SweepFile:
    """A sweep file: its first line, the points that are finished, the offset where they end."""

    header: SweepHeader
    points: Mapping[int, SweepPoint]
    end: int

    @property
    def count(self) -> int:
        """Number of points of the whole sweep."""
        return math.prod(axis.count for axis in self.header.over)


class SweepWriter:
    """A sweep file that grows line by line; `points` are those it holds.

    InputError when the file is of another sweep, or of none.
    """

    def __init__(self, path: str, plan: Plan) -> None:
        self._path, self._plan, self._header = path, plan, SweepHeader.from_plan(plan)
        self.points: dict[int, SweepPoint] = {}
        self._first = (_line(self._header.to_dict()) + "\n").encode()
        self._file: BinaryIO | None = None
        self._end = 0
        text = _bytes(path)
        if not self._first.startswith(text):  # more than a first line that was not finished
            stored = parse(text, path)
            _require_same(stored.header, self._header, path)
            self.points |= stored.points
            self._end = stored.end

    def append(self, point: SweepPoint) -> None:
        """Add the line of a point; it is in the file when this returns."""
        self.points[point.index] = point
        file = self._file = self._file or self._opened()
        file.write((self._signed_line(point) + "\n").encode())
        file.flush()

    def __enter__(self) -> SweepWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
        if kind is None and len(self.points) == len(self._plan):
            lines = [self._signed_line(self.points[index]) for index in sorted(self.points)]
            write_text(self._path, "\n".join([_line(self._header.to_dict()), *lines]))

    def _signed_line(self, point: SweepPoint) -> str:
        return _line(_signed(self._header.to_dict(), point.to_dict()))

    def _opened(self) -> BinaryIO:
        """The file behind its last finished line; made when there is a point to write."""
        try:
            file = open(self._path, "r+b" if Path(self._path).exists() else "wb")  # noqa: SIM115
            file.truncate(self._end)
            file.seek(self._end)
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written: {error.strerror}.") from None
        if not self._end:
            file.write(self._first)
        return file


def read_sweep(path: str) -> SweepFile:
    """A sweep file, complete or not; InputError when it is none."""
    if not Path(path).exists():
        raise InputError(f"{path}: cannot be read: No such file or directory.")
    return parse(_bytes(path), path)


def parse(text: bytes, path: str) -> SweepFile:
    """The lines of a sweep file; a last line that was not finished counts as not written."""
    end = text.rfind(b"\n") + 1
    lines = text[:end].splitlines()
    head = _object(lines[0], path, 1) if lines else {}
    if head.get("format") != FORMAT or head.get("version") != VERSION:
        raise InputError(
            f"{path}: a sweep file is required; its first line is not {{\"format\": "
            f"{FORMAT!r}, \"version\": {VERSION}, ...}}. Name another file with -o."
        )  # fmt: skip
    if not isinstance(head.get("over"), list) or not all(map(_is_axis, head["over"])):
        raise InputError(f"{path} line 1: over must be a list of axes. Was it edited?")
    if not 1 <= len(head["over"]) <= 2 or math.prod(a["count"] for a in head["over"]) > MOST_POINTS:
        raise InputError(f"{path} line 1: over must be one or two axes, with few enough points.")
    header = SweepHeader.from_dict(head)
    count = SweepFile(header, {}, end).count
    points: dict[int, SweepPoint] = {}
    for number, line in enumerate(lines[1:], start=2):
        row = _object(line, path, number)
        index = row.get("point")
        if type(index) is not int or not 0 <= index < count or "at" not in row:
            raise InputError(f"{path} line {number}: a point of this sweep is required.")
        if not _is_signed(head, row):
            raise InputError(
                f"{path} line {number}: digest does not match the point and the first line. Is it "
                "of another sweep, or was it edited? Remove the line to have it done again."
            )
        points[index] = SweepPoint.from_dict(row)
    return SweepFile(header, points, end)


def _signed(head: Entries, row: Entries) -> NewEntries:
    """The line of a point as it stands in the file of a sweep."""
    return {**row, "digest": digest({**row, "sweep": dict(head)})}


def _is_signed(head: Entries, row: Entries) -> bool:
    try:
        return bool(_signed(head, row)["digest"] == row.get("digest"))
    except ValueError:  # NaN, or a text that is no Unicode: nothing that was written here
        return False


def _is_axis(value: object) -> bool:
    if not isinstance(value, dict) or set(value) != {"key", "first", "last", "count"}:
        return False
    ends = (value.get("first"), value.get("last"))
    if not isinstance(value["key"], str):
        return False
    return all(map(is_number, ends)) and type(value.get("count")) is int and value["count"] > 0


def _object(line: bytes, path: str, number: int) -> NewEntries:
    try:
        body = json.loads(line)
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        raise InputError(f"{path} line {number}: one JSON object is required. Was it edited?")
    return body


def _require_same(stored: SweepHeader, planned: SweepHeader, path: str) -> None:
    if text := stored.difference(planned):
        raise InputError(
            f"{path}: holds a sweep with another {text}. Name another file with -o, or remove this "
            "one."
        )


def _bytes(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None


def _line(body: Entries) -> str:
    return json.dumps(body, ensure_ascii=False, allow_nan=False)
