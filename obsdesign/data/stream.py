"""An observer on a record that may come in parts: its progress between them."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import cast

from obsdesign.data.records import Block, samples_in
from obsdesign.document import Design
from obsdesign.errors import InputError
from obsdesign.input_files import read_text
from obsdesign.runtime.announced import with_events_ahead
from obsdesign.runtime.base import (
    Delayed,
    Estimate,
    KindState,
    Observer,
    Row,
    Sample,
    Stepped,
)
from obsdesign.runtime.columns import Batch, Columns
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.stored_state import progress_from_text

_READ_AHEAD = 1024  # rows of a file that an observer with a delay takes at once


class Stream:
    """An observer and its progress, which every estimate that is taken updates."""

    def __init__(self, observer: Observer, progress: Progress) -> None:
        self.observer, self.progress = observer, progress
        self._latest: KindState = progress.state

    def begin(self, t: float) -> None:
        """Begin at the time of the first row, unless rows came before."""
        if self.progress.state is None:
            state = self.observer.start(t, self.progress.initial)
            self.progress = replace(self.progress, state=state, initial=None)

    def estimates(self, samples: Iterator[Sample], *, live: bool = False) -> Iterator[Estimate]:
        """Estimates, one per row; from an observer with a delay those that are decided.

        live: answer row by row. Rows of a file are taken in blocks. The last block may be short: it
        is taken again with the rows of the next part, so that no number depends on where a record
        was cut.
        """
        if not isinstance(self.observer, Delayed):
            for sample in samples:
                state, estimate = self.observer.step(self.progress.state, sample)
                self.progress = replace(self.progress, state=state)
                yield estimate
            return
        size = 1 if live else _READ_AHEAD
        rows = itertools.chain((Sample(*row) for row in self.progress.waiting), samples)
        while block := list(itertools.islice(rows, size)):
            before, given = self.progress.state, self.progress.given
            self._latest = self.observer.block(before, block)
            decided = self._latest.decided
            if len(block) == size:
                after, left = replace(self._latest, decided=()), max(given - len(decided), 0)
                self.progress = replace(self.progress, state=after, waiting=(), given=left)
            else:
                # arrays, as `read_samples` makes them
                waiting = cast(tuple[Row, ...], tuple((row.t, row.y, row.u) for row in block))
                left = max(given, len(decided))
                self.progress = replace(self.progress, state=before, waiting=waiting, given=left)
            yield from decided[given:]

    def results(self, blocks: Iterator[Block], *, live: bool = False) -> Iterator[Estimate | Batch]:
        """Estimates of blocks: those of the rows of a block at once where each has its own."""
        observer: Observer = self.observer
        if not isinstance(observer, Stepped):
            yield from self.estimates(samples_in(blocks), live=live)
            return
        for block in blocks:
            before = self.progress.state
            state, result = (
                observer.batch_step(before, block) if isinstance(block, Columns)
                else observer.step(before, block)
            )  # fmt: skip
            self.progress = replace(self.progress, state=state)
            yield result

    def tail(self) -> Sequence[Estimate]:
        """Rows that an observer with a delay has not decided."""
        return self.observer.finish(self._latest) if isinstance(self.observer, Delayed) else ()


def results_of(parts: Stream, blocks: Iterator[Block], *, live: bool) -> Iterator[Estimate | Batch]:
    """Estimates of a whole record, with a delay each once it is decided."""
    observer = parts.observer
    if isinstance(observer, Stepped) and not observer.takes_whole_records:
        return parts.results(blocks, live=live)
    return estimates_of(observer, parts.progress.state, samples_in(blocks), live=live)


def estimates_of(
    observer: Observer, state: KindState, samples: Iterator[Sample], *, live: bool = False
) -> Iterator[Estimate]:
    """Estimates of a whole record, one per row; with a delay each once it is decided.

    live: answer row by row; a file may be read ahead.
    """
    if not isinstance(observer, Delayed):
        yield from observer.run(state, samples)
        return
    stream = Stream(observer, Progress(state))
    yield from stream.estimates(samples, live=live)
    yield from stream.tail()


def stored_progress(
    path: str, design: Design, observer: Observer, initial: Sequence[float] | None
) -> Progress | None:
    """Read the progress of the observer of a design; None if there is no such file.

    InputError when it cannot be read or continued, or when `initial` is given too.
    """
    refuse_whole_records(observer, "--state")
    if not os.path.lexists(path):
        return None
    text = read_text(path)
    if initial is not None:
        raise InputError(f"--initial is refused: the run goes on from the state in {path}.")
    progress = progress_from_text(text, design, observer, path)
    with _of_this_design():  # do the rows that wait fit the design? A step has no other effect
        state = progress.state
        late = with_events_ahead([row.sample for row in progress.late], observer.time_errors)
        for sample in late:
            state = observer.start(sample.t, progress.initial) if state is None else state
            state, _ = observer.step(state, sample)
    return progress


def refuse_whole_records(observer: Observer, why: str) -> None:
    """InputError for an observer that takes all rows of a record at once."""
    if isinstance(observer, Stepped) and observer.takes_whole_records:
        raise InputError(
            f"{why}: observer.differentiator 'batch' smooths a record as a whole; its parts "
            "cannot be run one after the other."
        )


def starting_progress(
    observer: Observer, progress: Progress | None, first: Sample, initial: Sequence[float] | None
) -> Progress:
    """The progress before the first sample; InputError where that sample cannot be taken."""
    if progress is None:
        return Progress(observer.start(first.t, initial))
    if progress.state is None:
        state = observer.start(first.t, progress.initial)
        return replace(progress, state=state, initial=None)  # as of a record in a single part
    with _of_this_design():  # do the sizes of what was stored fit the design?
        list(Stream(observer, progress).estimates(iter([first])))
    return progress


@contextmanager
def _of_this_design() -> Iterator[None]:
    """InputError for whatever goes wrong with stored numbers."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"--state: not a state of this design: {reason}") from None
