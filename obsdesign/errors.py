"""Exceptions for what a person can put right."""

from __future__ import annotations


class InputError(ValueError):
    """A file, option or array that cannot be read as asked.

    The text is one line: which entry, what was required, what arrived, the likely cause.
    """


class DoesNotApply(InputError):
    """A block or a way of measuring that the kind needs is missing from the problem.

    entry: what the kind needs otherwise, as "jump.H".
    """

    def __init__(self, text: str, entry: str = "") -> None:
        super().__init__(text)
        self.entry = entry
