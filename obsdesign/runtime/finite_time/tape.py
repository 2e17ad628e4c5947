"""Residuals of a sliding window in one growing array: a new sample copies nothing.

A window is a view of the last m entries, which are never written again: every state keeps its own.
A free slot is claimed once; a second claimant gets a copy.
"""

from __future__ import annotations

from itertools import count

import numpy as np

from lmi.arithmetic.arrays import Matrix

_LEAST_ROOM = 512  # entries to write before the window is copied again


class Tape:
    """A window with room behind it for further entries."""

    __slots__ = ("_claims", "_data")

    def __init__(self, window: Matrix, step: int) -> None:
        """Copy the window's entries to the beginning; further ones come `step` at a time."""
        self._data = np.empty(2 * len(window) + max(_LEAST_ROOM, step))
        self._data[: len(window)] = window
        self._claims = count(len(window), step)

    def extended(self, end: int, fresh: Matrix, size: int) -> Matrix | None:
        """The last `size` entries with `fresh` at `end`; None where that slot is not free.

        Counting is atomic, also among threads. None also where there is no room.
        """
        if next(self._claims) != end:
            return None
        new, data = end + len(fresh), self._data
        if new > len(data):
            return None
        data[end:new] = fresh
        return data[new - size : new]


def extend(tape: Tape | None, end: int, window: Matrix, fresh: Matrix) -> tuple[Matrix, Tape, int]:
    """(the window moved on by `fresh`, its tape, where it ends there)."""
    size = len(window)
    following = None if tape is None else tape.extended(end, fresh, size)
    if tape is None or following is None:
        tape, end = Tape(window, len(fresh)), size
        following = tape.extended(end, fresh, size)
    assert following is not None  # a new tape has room
    return following, tape, end + len(fresh)
