"""Exceptions for what a person can put right."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """A file, option or array that is refused; a ValueError.

    The text is one line: which entry, what was required, what arrived, the likely cause.
    """


class DoesNotApply(InputError):
    """The kind does not serve this plant: an entry that it needs is missing, or one is refused.

    entry: the one that the kind needs, as "jump.H"; empty where no single entry would do.
    """

    def __init__(self, text: str, entry: str = "") -> None:
        super().__init__(text)
        self.entry = entry


@contextmanager
def naming(place: str | os.PathLike[str], refusal: type[ValueError] = InputError) -> Iterator[None]:
    """Let refusals of the block begin with the file or entry they are about.

    refusal: what counts as one; any other ValueError is a fault of ours and stays one.
    """
    try:
        yield
    except refusal as error:
        raise InputError(f"{place}: {error}") from None
