"""How much the program says: `obsdesign --quiet COMMAND` and `obsdesign --verbose COMMAND`.

Quiet leaves errors, exit codes, files, and what --json or standard output was asked for.
"""

from __future__ import annotations

import click


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
        click.echo(f"obsdesign: {text}", err=True)


def _given(name: str) -> bool:
    context = click.get_current_context(silent=True)
    return bool(context and context.find_root().params.get(name))
