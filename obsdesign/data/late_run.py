"""A run on rows that arrive late: their order, what is final, what is provisional."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from obsdesign.data.arrivals import SILENCE, Arrivals, Remark
from obsdesign.data.csv_text import estimate_header, estimate_line
from obsdesign.data.first_row import FirstRow
from obsdesign.data.layout import Layout
from obsdesign.data.stream import Stream, refuse_whole_records
from obsdesign.errors import InputError
from obsdesign.output_files import replacing
from obsdesign.runtime.base import Estimate, KindState, Observer, Sample
from obsdesign.runtime.late_rows import Arrival, LateRows
from obsdesign.runtime.progress import Progress
from obsdesign.runtime.replay import Revisions, provisional


def refuse_late_rows(
    layout: Layout, observer: Observer, target: str | None, *, skip_bad: bool
) -> None:
    """InputError for rows that may be late where the observer takes all at once, or none may be.

    Also where lines may be skipped although their silence counts. target: file of provisional
    estimates, None without one.
    """
    if skip_bad and layout.clocks is not None and layout.clocks.silence_counts:
        raise InputError(f"--skip-bad is not available: {SILENCE}.")
    if layout.lag > 0:
        refuse_whole_records(observer, "report_delay")
    elif target is not None:
        raise InputError(
            "--provisional: report_delay of an event or a sensor is required, or time_error of an "
            "event; the plant of the design has none."
        )


def arrivals_of(
    layout: Layout, stored: Progress | None, remark: Remark, *, is_stream: bool = False,
    watch: Callable[[Arrival], None] | None = None,
) -> Arrivals:  # fmt: skip
    """The order of rows that may be late, with those that wait since the last part."""
    is_first = stored is None
    stored = Progress(None) if stored is None else stored
    first = layout.first_row if stored.state is None else FirstRow()
    waiting = [row.sample for row in stored.late]
    buffer = LateRows(
        layout.lag, may_repeat=layout.may_repeat, samples=waiting, now=max(stored.now, stored.t),
        before=stored.t, dt=layout.dt, errors=() if layout.clocks is None else layout.clocks.errors,
        sees_after=() if layout.clocks is None else layout.clocks.sees_after,
    )  # fmt: skip
    silence_counts = layout.clocks is not None and layout.clocks.silence_counts
    return Arrivals(buffer, remark, is_stream, watch, is_first, silence_counts, first=first)


def final_then_provisional(
    parts: Stream, rows: Iterator[Sample], arrivals: Arrivals | None, *, live: bool
) -> Iterator[Estimate]:
    """Estimates of final rows; then of rows that are not, as provisional, where they are given."""
    yield from parts.estimates(rows, live=live)
    waiting = () if arrivals is None else arrivals.waiting
    if waiting:
        parts.begin(waiting[0].t)
        yield from map(provisional, parts.estimates(iter(waiting), live=live))
        yield from map(provisional, parts.tail())


@contextmanager
def provisional_lines(
    path: str | None, observer: Observer, stored: Progress | None,
    initial: Sequence[float] | None, *, mark: Callable[[Estimate], Estimate], live: bool,
) -> Iterator[Callable[[Arrival], None] | None]:  # fmt: skip
    """Writes an arrival's provisional estimates to a file; None without one.

    mark: adds to a status what rows that were left out mean for it.
    """
    if path is None:
        yield None
        return
    revisions = Revisions(observer, _state_at_rows(observer, stored, initial))
    with replacing(path) as file:
        file.write(estimate_header(observer.names) + "\n")

        def write(arrival: Arrival) -> None:
            estimates = map(mark, revisions.revised(arrival).provisional)
            file.writelines(estimate_line(each) + "\n" for each in estimates)
            if live:
                file.flush()

        yield write


def _state_at_rows(
    observer: Observer, stored: Progress | None, initial: Sequence[float] | None
) -> KindState | Callable[[float], KindState]:
    """The state before the first row of the buffer, or how it begins where no row is final yet."""
    if stored is None:
        return lambda t: observer.start(t, initial)
    if stored.state is None:
        return lambda t: observer.start(t, stored.initial)
    state: KindState = stored.state
    for row in stored.waiting:
        state, _ = observer.step(state, Sample(*row))
    return state
