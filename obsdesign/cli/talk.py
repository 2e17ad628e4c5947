"""Messages by verbosity: `obsdesign --quiet COMMAND` and `obsdesign --verbose COMMAND`.

Quiet leaves errors, exit codes, files, and what --json or standard output holds.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

# of verdicts, on a terminal
COLOURS = {"proved": "green", "refuted": "red", "undecided": "yellow", "does_not_apply": "dim"}
# seconds without a message
_WHILE = 2.0


def on_stderr(line: str) -> None:
    """Write a line to standard error; where that cannot be written it is lost, and all others.

    An exit code says what became of a command, not of its messages.
    """
    try:
        click.echo(line, err=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def is_quiet() -> bool:
    """Was --quiet given?"""
    return _given("quiet")


def is_verbose() -> bool:
    """Was --verbose given?"""
    return _given("verbose")


def say(text: str) -> None:
    """A line for a person on standard output."""
    if not is_quiet():
        click.echo(text)


def warn(text: str) -> None:
    """A line for a person on standard error."""
    if not is_quiet():
        on_stderr(f"obsdesign: {text}")


@contextmanager
def progress_message(doing: str) -> Iterator[None]:
    """Show on a terminal what a block does and for how long, once it takes over `_WHILE` s."""
    if not _wants_progress():
        yield
        return
    started = time.monotonic()
    displays: list[Progress] = []

    def show() -> None:
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        display = Progress(*columns, console=Console(stderr=True), transient=True)
        task = display.add_task(doing)
        display.tasks[task].start_time = display.get_time() - (time.monotonic() - started)
        display.start()
        displays.append(display)

    timer = Timer(_WHILE, show)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        for display in displays:
            display.stop()


def _wants_progress() -> bool:
    """Is standard error a terminal that wants more than plain lines?"""
    has_terminal = sys.stderr is not None and sys.stderr.isatty()  # None where it is closed
    return has_terminal and not is_quiet() and "NO_COLOR" not in os.environ


def output_console() -> Console:
    """A console of rich on standard output; BrokenPipeError once its reader has left.

    Its own answer is exit code 1, which means refuted here.
    """
    from rich.console import Console  # slow to import, and --json does without

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    return Output(highlight=False)


@contextmanager
def progress_bar(doing: str) -> Iterator[Callable[[int, int], None]]:
    """A bar for (done, total) on a terminal that wants one; nothing elsewhere."""
    if not _wants_progress():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _given(name: str) -> bool:
    context = click.get_current_context(silent=True)
    return bool(context and context.find_root().params.get(name))
