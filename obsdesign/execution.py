"""Run a design over a data file or a pipe, in constant memory."""

from __future__ import annotations

import itertools
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TextIO

from obsdesign.document import refuse_overwriting, replacing, write_text
from obsdesign.errors import InputError
from obsdesign.records import (
    Layout,
    estimate_header,
    estimate_line,
    events_text,
    read_samples,
)
from obsdesign.runtime import load
from obsdesign.runtime.base import Estimate

# "dwell time 0.5 below 0.7" is counted as "dwell time below 0.7"
_NUMBER = re.compile(r"(?<=time )[-+.\de]+ ")

_READ_AHEAD = 1024  # rows of a file that an observer with a delay takes at once


def execute(
    design: str,
    data: str | None,
    output: str | None,
    initial: Sequence[float] | None,
    events: str | None,
) -> Counter[str]:
    """Estimates of a design for DATA (None: standard input) into `output` (None: standard output).

    Returns how many rows there were ("rows") and how many had which status. A data file is checked
    whole before anything is written; a pipe is answered row by row. InputError names what is wrong
    with which file.
    """
    observer: Any = load(design)
    for target in (output, events):
        refuse_overwriting(target, design, data)
    if events is not None and events == output:
        raise InputError(f"--events: {events} is the estimate file; give another name.")
    if events is not None and not observer.finds_events:
        raise InputError(f"--events: kind {observer.kind!r} finds no impulses.")
    layout = Layout(**observer.reads)
    found: list[Any] | None = None if events is None else []
    if data is None:
        with _writer(output) as out:
            counts = _loop(observer, sys.stdin, layout, "standard input", initial, out, found)
        return _told(counts, events, found, observer)
    with _opened(data) as stream:
        for sample in read_samples(stream, layout, data):
            observer.start(sample.t, initial)  # complain before anything is written
            break
        for _ in read_samples(stream, layout, data) if stream.seek(0) == 0 else ():
            pass
    with _opened(data) as stream, _writer(output) as out:
        counts = _loop(observer, stream, layout, data, initial, out, found)
    return _told(counts, events, found, observer)


def _told(
    counts: Counter[str], events: str | None, found: list[Any] | None, observer: Any
) -> Counter[str]:
    if events is not None and found is not None:
        write_text(events, events_text(found, observer.directions))
    return counts


def _loop(
    observer: Any,
    stream: TextIO,
    layout: Layout,
    name: str,
    initial: Any,
    out: TextIO,
    found: list[Any] | None,
) -> Counter[str]:
    """Rows in, rows out; an observer with a delay gives each row once it is decided."""
    counts: Counter[str] = Counter()
    state = None
    delayed = hasattr(observer, "finish")

    def put(rows: Iterable[Estimate]) -> None:
        for row in rows:
            out.write(estimate_line(row) + "\n")
            counts["rows"] += 1
            counts.update(_NUMBER.sub("", reason) for reason in row.status.split("; "))
            if found is not None:
                found.extend(row.events)

    samples = read_samples(stream, layout, name)
    # a pipe is answered row by row; a file may be read ahead
    many = _READ_AHEAD if delayed and stream is not sys.stdin else 1
    while block := list(itertools.islice(samples, many)):
        if state is None:
            state = observer.start(block[0].t, initial)
            out.write(estimate_header(observer.names) + "\n")
        if delayed:
            state = observer.block(state, block)
            put(state.decided)
        else:
            state, estimate = observer.step(state, block[0])
            put((estimate,))
        if stream is sys.stdin:
            out.flush()
    if delayed and state is not None:
        put(observer.finish(state))
    return counts


@contextmanager
def _opened(path: str) -> Iterator[TextIO]:
    try:
        stream = open(path, encoding="utf-8", newline="")  # noqa: SIM115 - closed below
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from None
    with stream:
        yield stream


@contextmanager
def _writer(path: str | None) -> Iterator[TextIO]:
    """Standard output, or a file that appears only when all of it is written."""
    if path is None:
        yield sys.stdout
        return
    with replacing(path) as file:
        yield file
