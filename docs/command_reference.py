"""The page of all commands and options, made from the program itself.

python -m docs.command_reference > docs/commands.md
"""

from __future__ import annotations

import click

from obsdesign.cli.commands import cli

HEAD = """# Commands

Exit codes: 0 proved or done, 1 refuted (the witness is printed), 2 bad input or usage (one line
on stderr), 3 undecided (with what a longer `--time` might do, where a budget ended it), 4 a row
that is not `ok` (`run --strict`), 70 an internal error (one line on stderr). `--json` prints
exactly one JSON object on stdout. `NO_COLOR` is respected, and progress is shown on a terminal
only. Made by `python -m docs.command_reference`.
"""


def page() -> str:
    """Markdown of every command, in the order of the help."""
    with _context(cli, "obsdesign", None) as context:
        parts = [HEAD, _block(cli.get_help(context))]
        for name in cli.list_commands(context):
            command = cli.get_command(context, name)
            assert command is not None
            with _context(command, name, context) as inner:
                parts.append(f"\n## `obsdesign {name}`\n\n{_block(command.get_help(inner))}")
    return "\n".join(parts).rstrip() + "\n"


def _context(command: click.Command, name: str, parent: click.Context | None) -> click.Context:
    """As a call would make it, with the command's own settings."""
    return command.make_context(name, [], parent=parent, resilient_parsing=True)


def _block(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines()) + "\n"


if __name__ == "__main__":
    print(page(), end="")
