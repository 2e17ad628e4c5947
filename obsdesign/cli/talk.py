"""Messages by verbosity: `obsdesign --quiet COMMAND` and `obsdesign --verbose COMMAND`.

Quiet leaves errors, exit codes, files, and what --json or standard output holds.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console

# of verdicts, on a terminal
COLOURS = {"proved": "green", "refuted": "red", "undecided": "yellow", "does_not_apply": "dim"}
# seconds of processor time without a message, and seconds between two checks
_WHILE, _CHECK_SECONDS = 2.0, 0.25


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
    """Print one line on standard error if the block takes longer than `_WHILE` seconds."""
    done, start = Event(), time.process_time()

    def watch() -> None:
        while not done.wait(_CHECK_SECONDS):
            if time.process_time() - start > _WHILE:
                on_stderr(f"obsdesign: still {doing} after {_WHILE:g} s")
                return

    if not is_quiet():  # checked here: the other thread has no context
        Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        done.set()


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
    if is_quiet() or "NO_COLOR" in os.environ or not sys.stderr.isatty():
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
