"""Exceptions for what a person can put right."""

from __future__ import annotations


class InputError(ValueError):
    """A file, option or array that cannot be read.

    The text is one line: which entry, what was required, what arrived, the likely cause.
    """


class DoesNotApply(InputError):
    """The kind does not serve this plant: an entry that it needs is missing, or one is refused.

    entry: the one that the kind needs, as "jump.H"; empty where no single entry would do.
    """

    def __init__(self, text: str, entry: str = "") -> None:
        super().__init__(text)
        self.entry = entry
