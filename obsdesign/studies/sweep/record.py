"""A sweep on disk: JSON lines, the first says which sweep, each further one holds a point.

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
from typing import Any, BinaryIO

from obsdesign import __version__
from obsdesign.document import digest
from obsdesign.entries import is_number
from obsdesign.errors import InputError
from obsdesign.output_files import write_text
from obsdesign.studies.sweep.point import MOST_POINTS, Plan

FORMAT = "obsdesign/sweep"
VERSION = 1
# entry of the first line -> how a person calls it
_WORDS = {
    "problem": "problem",
    "kind": "observer kind",
    "over": "--over",
    "for": "--for",
    "accuracy": "--accuracy",
    "time": "--time",
    "obsdesign": "version of obsdesign",
}


def header(plan: Plan) -> dict[str, Any]:
    """The first line: what has to be the same for a sweep to go on in a file."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": plan.body["name"],
        "kind": plan.body["observer"]["kind"],
        "problem": digest(dict(plan.body)),
        "over": [axis.to_dict() for axis in plan.axes],
        "for": plan.what,
        "accuracy": plan.accuracy,
        "time": plan.seconds,
        "obsdesign": __version__,
    }


@dataclass(frozen=True)
class SweepFile:
    """What a sweep file holds: its first line, the points that are finished, where they end."""

    header: Mapping[str, Any]
    rows: Mapping[int, Mapping[str, Any]]
    end: int

    @property
    def count(self) -> int:
        """Points of the whole sweep."""
        return math.prod(axis["count"] for axis in self.header["over"])


class Record:
    """A sweep file that grows line by line; `finished` are the points it holds already.

    InputError when the file is of another sweep, or of none.
    """

    def __init__(self, path: str, plan: Plan) -> None:
        self._path, self._plan = path, plan
        self.rows: dict[int, Mapping[str, Any]] = {}
        self._first = (_line(header(plan)) + "\n").encode()
        self._file: BinaryIO | None = None
        self._end = 0
        text = _bytes(path)
        if not self._first.startswith(text):  # more than a first line that was not finished
            found = parse(text, path)
            _require_same(found.header, header(plan), path)
            self.rows |= found.rows
            self._end = found.end

    def append(self, row: Mapping[str, Any]) -> None:
        """Add the line of a point; it is in the file when this returns."""
        self.rows[int(row["point"])] = row
        file = self._file = self._file or self._opened()
        file.write((_line(_signed(header(self._plan), row)) + "\n").encode())
        file.flush()

    def __enter__(self) -> Record:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
        if kind is None and len(self.rows) == len(self._plan):
            head = header(self._plan)
            points = (_signed(head, self.rows[index]) for index in sorted(self.rows))
            write_text(self._path, "\n".join(map(_line, [head, *points])))

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
    found = SweepFile(head, {}, end)
    rows: dict[int, Mapping[str, Any]] = {}
    for number, line in enumerate(lines[1:], start=2):
        row = _object(line, path, number)
        index = row.get("point")
        if type(index) is not int or not 0 <= index < found.count or "at" not in row:
            raise InputError(f"{path} line {number}: a point of this sweep is required.")
        rows[index] = {key: value for key, value in row.items() if key != "digest"}
        if not _is_signed(head, row):
            raise InputError(
                f"{path} line {number}: digest does not match the point and the first line. Is it "
                "of another sweep, or was it edited? Remove the line to have it done again."
            )
    return SweepFile(head, rows, end)


def _signed(head: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    """The line of a point as it stands in the file of a sweep."""
    return {**row, "digest": digest({**row, "sweep": dict(head)})}


def _is_signed(head: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    try:
        return bool(_signed(head, row)["digest"] == row.get("digest"))
    except ValueError:  # NaN, or a text that is no Unicode: nothing that was written here
        return False


def _is_axis(value: Any) -> bool:
    if not isinstance(value, dict) or set(value) != {"key", "first", "last", "count"}:
        return False
    ends = (value.get("first"), value.get("last"))
    if not isinstance(value["key"], str):
        return False
    return all(map(is_number, ends)) and type(value.get("count")) is int and value["count"] > 0


def _object(line: bytes, path: str, number: int) -> dict[str, Any]:
    try:
        body = json.loads(line)
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict):
        raise InputError(f"{path} line {number}: one JSON object is required. Was it edited?")
    return body


def _require_same(found: Mapping[str, Any], wanted: Mapping[str, Any], path: str) -> None:
    for key, word in _WORDS.items():
        if found.get(key) != wanted[key]:
            before, now = _told(key, found.get(key)), _told(key, wanted[key])
            told = "" if key == "problem" else f": {before} there, {now} here"
            raise InputError(
                f"{path}: holds a sweep with another {word}{told}. Name another file with -o, or "
                "remove this one."
            )


def _told(key: str, value: Any) -> str:
    if key == "over" and isinstance(value, list):
        return " ".join(f"{a['key']}={a['first']:g}:{a['last']:g}:{a['count']}" for a in value)
    return str(value)


def _bytes(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None


def _line(body: Mapping[str, Any]) -> str:
    return json.dumps(body, ensure_ascii=False, allow_nan=False)
