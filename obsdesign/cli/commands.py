"""The command line: parse, one call, print. Heavy imports stay inside the commands.

Exit codes: 0 proved or done, 1 refuted, 2 bad input or usage, 3 undecided, 4 `run --strict` with a
row that is not ok, 70 internal error, 130 interrupted, 141 output closed.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import traceback
import warnings

import click

from lmi.memory import OversizeError
from obsdesign.cli import data, exploring, exporting, pages, proving, sweeping
from obsdesign.cli.talk import on_stderr
from obsdesign.errors import InputError

INTERNAL_ERROR = 70
_LONGEST_LINE = 1000  # characters


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="obsdesign")
@click.option("-q", "--quiet", is_flag=True, help="Only errors, exit codes and requested output.")
@click.option("-v", "--verbose", is_flag=True, help="Also the numbers behind each claim.")
def cli(quiet: bool, verbose: bool) -> None:
    """Observers for impulsive, sampled and unknown-input linear systems."""
    if quiet and verbose:
        raise click.UsageError("--quiet and --verbose exclude each other.")


for command in (
    pages.demo, proving.check, proving.design, proving.verify, proving.search, data.simulate,
    data.run, data.plot, exporting.export, data.convert, data.noise, sweeping.sweep, pages.compare,
    pages.report, exploring.explore, pages.schema, pages.completion,
):  # fmt: skip
    cli.add_command(command)


def main() -> None:
    """Entry point: turns every failure into one line on stderr and an exit code."""
    _open_closed_streams()
    with warnings.catch_warnings():
        if not sys.warnoptions:  # floats may overflow: what becomes of them is judged
            warnings.simplefilter("ignore")
        sys.exit(_run())


def _run() -> int:
    """Run the command of `sys.argv`; its exit code."""
    if len(sys.argv) == 1:
        sys.argv.append("--help")
    verbose = False
    try:
        if request := os.environ.get(pages.COMPLETE):
            from click.shell_completion import shell_complete

            return shell_complete(cli, {}, "obsdesign", pages.COMPLETE, request)
        # not cli.main(): it answers a closed pipe with exit code 1, which means refuted here
        with cli.make_context("obsdesign", sys.argv[1:]) as context:
            verbose = bool(context.params.get("verbose"))
            code = cli.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as leaving:
        code = leaving.exit_code
    except (InputError, OversizeError, click.ClickException) as error:
        text = error.format_message() if isinstance(error, click.ClickException) else str(error)
        _complain(text)
        code = 2
    except (click.Abort, KeyboardInterrupt):
        code = 130
    except BrokenPipeError:  # the reader of our output left: nothing to complain about
        _discard_output()
        code = 141
    except OSError as error:
        _discard_output()
        _complain(f"the output cannot be written: {error.strerror or error}.")
        code = 2
    except Exception as error:
        if _was_interrupted(error):
            return 130
        if verbose:
            traceback.print_exc()
        reason = f"{type(error).__name__} {error}".strip()
        reason = reason[: _LONGEST_LINE // 2]
        _complain(f"internal error: {reason}, please report, --verbose for the trace")
        code = INTERNAL_ERROR
    return code if isinstance(code, int) else 0


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether an error is what a library made of Ctrl-C in one of its callbacks."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _complain(text: str) -> None:
    line = " ".join(text.split())
    line = line if len(line) <= _LONGEST_LINE else line[:_LONGEST_LINE] + "..."
    on_stderr(f"obsdesign: {line}")


def _discard_output() -> None:
    """Send what is still buffered nowhere: the interpreter flushes once more when it ends."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_closed_streams() -> None:
    """Give standard streams that the caller closed their numbers back, or files would get them.

    Standard input is then empty; exit code 2 without a standard output.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stdin is None:
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        _complain("standard output is closed; send it to /dev/null if it is not wanted.")
        sys.exit(2)
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may hold any bytes
        sys.stdout.reconfigure(errors="backslashreplace")
