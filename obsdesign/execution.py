"""Run a design over a data file or a pipe, in constant memory."""

from __future__ import annotations

import itertools
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, TextIO

from obsdesign.errors import InputError
from obsdesign.output_files import refuse_overwriting, replacing
from obsdesign.records import Layout, estimate_header, estimate_line, event_line, read_samples
from obsdesign.runtime import load
from obsdesign.runtime.base import Estimate, Sample

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
        raise InputError(f"--events: kind {observer.kind!r} has none to write.")
    layout = Layout(**observer.reads)
    if data is None:
        with _writer(output) as out, _log(events, observer) as log:
            return _loop(observer, sys.stdin, layout, "standard input", initial, out, log)
    with _opened(data) as stream:
        for sample in read_samples(stream, layout, data):
            observer.start(sample.t, initial)  # complain before anything is written
            break
        for _ in read_samples(stream, layout, data) if stream.seek(0) == 0 else ():
            pass
    with _opened(data) as stream, _writer(output) as out, _log(events, observer) as log:
        return _loop(observer, stream, layout, data, initial, out, log)


def _loop(
    observer: Any,
    stream: TextIO,
    layout: Layout,
    name: str,
    initial: Any,
    out: TextIO,
    log: TextIO | None,
) -> Counter[str]:
    counts: Counter[str] = Counter()
    samples = read_samples(stream, layout, name)
    first = next(samples)  # there is one, or they complain
    state = observer.start(first.t, initial)
    out.write(estimate_header(observer.names) + "\n")
    live = stream is sys.stdin
    for estimate in estimates_of(observer, state, chain([first], samples), live=live):
        out.write(estimate_line(estimate) + "\n")
        if log is not None:
            log.writelines(event_line(event) + "\n" for event in estimate.events)
        if live:
            out.flush()
        counts["rows"] += 1
        counts.update(_NUMBER.sub("", reason) for reason in estimate.status.split("; "))
    return counts


def estimates_of(
    observer: Any, state: Any, samples: Iterator[Sample], *, live: bool = False
) -> Iterator[Estimate]:
    """One for every row; an observer with a delay gives each once it is decided.

    live: answer row by row; a file may be read ahead.
    """
    if not hasattr(observer, "finish"):
        yield from observer.run(state, samples)
        return
    while block := list(itertools.islice(samples, 1 if live else _READ_AHEAD)):
        state = observer.block(state, block)
        yield from state.decided
    yield from observer.finish(state)


@contextmanager
def _log(path: str | None, observer: Any) -> Iterator[TextIO | None]:
    """The file of events, with its header, or nothing."""
    if path is None:
        yield None
        return
    with replacing(path) as file:
        file.write(",".join(observer.event_names) + "\n")
        yield file


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
