"""The command line: parse, one call, print. Heavy imports stay inside the commands.

Exit codes: 0 proved or done, 1 refuted, 2 bad input or usage, 3 undecided, 4 `run --strict` with a
row that is not ok.
"""

from __future__ import annotations

import os
import sys

import click

from obsdesign.commands import data, pages, proving, sweeping
from obsdesign.errors import InputError


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="obsdesign")
@click.option(
    "-q", "--quiet", is_flag=True, help="Only errors, exit codes, and what was asked for."
)
@click.option("-v", "--verbose", is_flag=True, help="Also the numbers behind each claim.")
def cli(quiet: bool, verbose: bool) -> None:
    """Observers for impulsive, sampled and unknown-input linear systems."""
    if quiet and verbose:
        raise click.UsageError("--quiet and --verbose exclude each other.")


for command in (
    pages.demo, proving.check, proving.design, proving.verify, proving.search, data.simulate,
    data.run, data.plot, data.export, sweeping.sweep, pages.compare, pages.report, pages.schema,
    pages.completion,
):  # fmt: skip
    cli.add_command(command)


def main() -> None:
    """Entry point: turns every expected failure into one line on stderr and an exit code."""
    if asked := os.environ.get(pages.COMPLETE):
        from click.shell_completion import shell_complete

        sys.exit(shell_complete(cli, {}, "obsdesign", pages.COMPLETE, asked))
    if len(sys.argv) == 1:
        sys.argv.append("--help")
    try:
        # not cli.main(): it answers a closed pipe with exit code 1, which means refuted here
        with cli.make_context("obsdesign", sys.argv[1:]) as context:
            code = cli.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as leaving:
        code = leaving.exit_code
    except (InputError, click.ClickException) as error:
        text = error.format_message() if isinstance(error, click.ClickException) else str(error)
        click.echo(f"obsdesign: {' '.join(text.split())}", err=True)
        code = 2
    except (click.Abort, KeyboardInterrupt):
        code = 130
    except BrokenPipeError:  # the reader of our output left: nothing to complain about
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 141
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        click.echo(f"obsdesign: the output cannot be written: {error.strerror}.", err=True)
        code = 2
    sys.exit(code if isinstance(code, int) else 0)
