"""Run a design over a data file or a pipe, in constant memory."""

from __future__ import annotations

import io
import math
import sys
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, combinations
from pathlib import Path
from typing import TextIO

from obsdesign.data.arrivals import Arrivals, Remark, Skip
from obsdesign.data.csv_lines import OWN_TITLES
from obsdesign.data.csv_text import batch_text, estimate_header, estimate_line, event_line
from obsdesign.data.late_run import (
    arrivals_of,
    final_then_provisional,
    provisional_lines,
    refuse_late_rows,
)
from obsdesign.data.layout import Layout
from obsdesign.data.left_out import LeftOut
from obsdesign.data.records import Block, discard, read_blocks, samples_in
from obsdesign.data.stream import Stream, results_of, starting_progress, stored_progress
from obsdesign.data.tally import Tally
from obsdesign.data.time_scale import TimeScale
from obsdesign.design_file import load_design
from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.output_files import refuse_overwriting, replacing, write_text
from obsdesign.runtime import from_design
from obsdesign.runtime.base import Estimate, Observer
from obsdesign.runtime.columns import Batch
from obsdesign.runtime.progress import Progress, WaitingRow
from obsdesign.runtime.status import VOID
from obsdesign.runtime.stored_state import state_text

_MOSTLY_VOID = 0.5  # of the rows, from which the data is hardly of this plant


def execute(
    design: str, data: str | None, output: str | None, initial: Sequence[float] | None,
    events: str | None, *, state: str | None = None, skip_bad: bool = False,
    provisional: str | None = None, titles: Mapping[str, str] = OWN_TITLES,
    remark: Remark = discard,
) -> Tally:  # fmt: skip
    """Write the estimates of a design for DATA to `output`; None is standard input or output.

    state: the file with the observer's progress; a run continues from it if it exists, and writes
    it at the end. skip_bad: a malformed line is a remark, not an error. provisional: file of the
    estimates of rows that an earlier row may still precede. titles: column by another title of it,
    beside the names in the design. remark: called with these, and at the
    end with claims that are not proved and signs that the data are of another plant.
    A data file is checked whole before anything is written; a pipe is answered row by row.
    """
    signed = load_design(design)
    observer = from_design(signed, design)
    targets = {"--events": events, "--provisional": provisional, "--state": state, "": output}
    _refuse_targets(observer, (design, data), targets)
    stored = None if state is None else stored_progress(state, signed, observer, initial)
    name, remarks, live = data or "standard input", list[str](), data is None
    layout = Layout.from_design(signed, observer).with_titles(titles)
    record = _Record(layout, observer, stored, initial, name, _has_error_bound(signed))
    refuse_late_rows(record.layout, observer, provisional, skip_bad=skip_bad)
    scale = TimeScale(signed.problem)
    left_out = record.left_out(record.checked(data, skip_bad=skip_bad))
    with (
        _source(data) as stream, _writer(output) as out, _log(events, observer) as log,
        provisional_lines(
            provisional, observer, stored, initial, mark=left_out.marked, live=live
        ) as watch,
    ):  # fmt: skip
        arrivals = arrivals_of(record.layout, stored, remark, is_stream=live, watch=watch)
        arrivals.note = left_out.note
        skip = left_out.skipping(remark) if skip_bad else None
        parts, rows = record.begun(stream, arrivals, skip=skip, remark=remarks.append)
        rows = scale.watched(left_out.watched(rows))
        results = parts.results(rows, live=live)
        if state is None:
            late = arrivals if record.layout.lag > 0 else None
            results = _to_the_end(parts, rows, late, only_final=bool(provisional), live=live)
        tally = _write(observer, results, out, log, left_out=left_out, live=live)
    ended = replace(parts.progress, left_out=left_out.counts, in_force=left_out.in_force,
                    first=left_out.first)  # fmt: skip
    _save(state, signed, ended, arrivals)
    signs = [*_void(name, tally, begins=stored is None), *scale.remarks(name)]
    for text in [*_unproved(design, signed), *remarks, *signs]:
        remark(text)
    return tally


@dataclass(frozen=True)
class _Record:
    """Rows of a record that an observer takes, from the start or from where it stands."""

    layout: Layout
    observer: Observer
    stored: Progress | None
    initial: Sequence[float] | None
    name: str
    has_error_bound: bool

    @property
    def progress(self) -> Progress:
        """Where the observer stands before the first line."""
        start = None if self.initial is None else tuple(map(float, self.initial))
        return Progress(None, initial=start) if self.stored is None else self.stored

    def left_out(self, after: float = math.inf) -> LeftOut:
        """Nothing yet, or a time behind which estimates are known to miss a row."""
        return LeftOut(
            self.layout, self.observer, self.progress, after, has_error_bound=self.has_error_bound
        )

    def checked(self, data: str | None, *, skip_bad: bool) -> float:
        """Time behind which bounds miss a row of a file; infinity where none is known, of a pipe.

        InputError, before anything is written, for a file that is no record.
        """
        left_out = self.left_out()
        if data is None:
            return left_out.after
        if Path(data).exists() and not (Path(data).is_file() or Path(data).is_dir()):
            raise InputError(
                f"{data}: a regular file is required, since it is read twice; leave DATA out and "
                "give the rows on standard input."
            )
        with _opened(data) as stream:
            arrivals = arrivals_of(self.layout, self.stored, discard)
            arrivals.note = left_out.note
            skip = left_out.skipping(discard) if skip_bad else None
            _, rows = self.begun(stream, arrivals, skip=skip, remark=discard)
            deque(left_out.watched(rows), maxlen=0)
        return left_out.after

    def begun(
        self, stream: TextIO, arrivals: Arrivals, *, skip: Skip | None, remark: Remark
    ) -> tuple[Stream, Iterator[Block]]:
        """The observer before the first final row, and all of these.

        InputError if the first one cannot be taken; the state is None where no row is final yet.
        """
        stored, initial = self.stored, self.initial
        blocks = read_blocks(
            stream, self.layout, self.name, after=-math.inf if stored is None else stored.t,
            remark=remark, skip=skip, arrivals=arrivals,
        )  # fmt: skip
        block = next(blocks, None)
        if block is not None:
            first = next(samples_in([block]))
            progress = starting_progress(self.observer, stored, first, initial)
            return Stream(self.observer, progress), chain([block], blocks)
        arrivals.require_first(self.name)
        if stored is None:
            self.observer.start(arrivals.waiting[0].t, initial)
        return Stream(self.observer, self.progress), iter(())


def _to_the_end(
    parts: Stream, rows: Iterator[Block], late: Arrivals | None, *, only_final: bool, live: bool
) -> Iterator[Estimate | Batch]:
    """Estimates of a record that ends with its rows; late: of rows that may come late."""
    if late is None:
        return results_of(parts, rows, live=live)
    waiting = None if only_final else late
    return final_then_provisional(parts, samples_in(rows), waiting, live=live)


def _save(path: str | None, design: Design, progress: Progress, arrivals: Arrivals) -> None:
    """Write a state file: the progress, and the rows that an earlier one may still precede."""
    if path is None:
        return
    late = tuple(WaitingRow.from_sample(sample) for sample in arrivals.waiting)
    ended = replace(progress, late=late, now=arrivals.buffer.now)
    write_text(path, state_text(design, ended))


def _write(
    observer: Observer,
    results: Iterator[Estimate | Batch],
    out: TextIO,
    log: TextIO | None,
    *,
    left_out: LeftOut,
    live: bool,
) -> Tally:
    """Every estimate as a line, and how many there are of which status."""
    tally = Tally()
    out.write(estimate_header(observer.names) + "\n")
    for result in results:
        if isinstance(result, Batch):
            batch = left_out.marked_rows(result)
            out.write(batch_text(batch))
            tally.add_rows(batch)
        else:
            estimate = left_out.marked(result)
            out.write(estimate_line(estimate) + "\n")
            tally.add(estimate.t, estimate.status)
        if log is not None:
            lines = (event_line(observer.event_cells(event)) for event in result.events)
            log.writelines(line + "\n" for line in lines)
        if live:
            out.flush()
    return tally


def _has_error_bound(design: Design) -> bool:
    """Does it claim how far an estimate is from the state?"""
    return any(claim.id in ("error_bound", "error_radius") for claim in design.claims)


def _unproved(path: str, design: Design) -> list[str]:
    """A remark if a claim of the design is not proved."""
    claims = [claim.id for claim in design.claims if claim.verdict != "proved"]
    if not claims:
        return []
    names = ", ".join(claims)
    return [f"{path}: {names} not proved: what rests on them is not guaranteed."]


def _void(name: str, tally: Tally, *, begins: bool) -> list[str]:
    """A remark if the data refute the bounds on most of the rows; begins: is it a new record?"""
    void = tally.rows_with(VOID)
    if not void > _MOSTLY_VOID * tally.rows:
        return []
    first = tally.kinds[VOID].first
    if begins and void == tally.rows - 1:
        cause = (
            f"the first row, t = {tally.start:.9g}, contradicts --initial, which holds there, "
            "before its sample and jump."
        )
    else:
        cause = (
            f"a row contradicts all before it, the last before t = {first:.9g}. Is its sample an "
            "outlier (leave the cell empty), are rows missing before it, or is it the data of "
            "another plant?"
        )
    return [f"{name}: the bounds are void on {void} of {tally.rows} rows: {cause}"]


def _refuse_targets(
    observer: Observer, read: tuple[str | None, ...], written: Mapping[str, str | None]
) -> None:
    """InputError if a file to be written is one that is read, is written twice, or has no rows.

    written: by option; the estimate file by "".
    """
    for target in written.values():
        refuse_overwriting(target, *read)
    for (option, target), (other, second) in combinations(written.items(), 2):
        if _same_file(target, second):
            what = "another file of this run" if other else "the estimate file"
            raise InputError(f"{option}: {target} is {what}; give another name.")
    if written["--events"] is not None and not observer.finds_events:
        raise InputError(f"--events: kind {observer.kind!r} has none to write.")


def _same_file(name: str | None, other: str | None) -> bool:
    """Two names of one file; a device may be written twice."""
    if name is None or other is None:
        return False
    path = Path(name).resolve()
    return path == Path(other).resolve() and (path.is_file() or not path.exists())


@contextmanager
def _log(path: str | None, observer: Observer) -> Iterator[TextIO | None]:
    """The file of events, with its header, or nothing."""
    if path is None:
        yield None
        return
    with replacing(path) as file:
        file.write(",".join(observer.event_names) + "\n")
        yield file


@contextmanager
def _source(path: str | None) -> Iterator[TextIO]:
    """A data file, or standard input."""
    if path is not None:
        with _opened(path) as stream:
            yield stream
        return
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(newline="", errors="surrogateescape")
    yield sys.stdin


@contextmanager
def _opened(path: str) -> Iterator[TextIO]:
    """Open a file that is not all UTF-8 text: a bad byte makes its own line invalid, no other."""
    try:
        stream = open(path, encoding="utf-8", newline="", errors="surrogateescape")  # noqa: SIM115
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
