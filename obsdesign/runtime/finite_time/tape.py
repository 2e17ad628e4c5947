"""Residuals of a sliding window in one growing array: a new sample moves nothing.

A window is a view of the last m entries. It is never written again, so that states keep theirs;
an entry behind it is given away once, and whoever comes second copies.
"""

from __future__ import annotations

from itertools import count

import numpy as np

from obsdesign.runtime.base import Vector

_LEAST_ROOM = 512  # entries to write before the window is copied again


class Tape:
    """Room behind a window; `after` is all there is to do with it."""

    __slots__ = ("_claims", "_data")

    def __init__(self, window: Vector, step: int) -> None:
        """The window's entries are copied to the beginning; `step` more come at a time."""
        self._data = np.empty(2 * len(window) + max(_LEAST_ROOM, step))
        self._data[: len(window)] = window
        self._claims = count(len(window), step)

    def after(self, end: int, fresh: Vector, size: int) -> Vector | None:
        """The last `size` entries once `fresh` stands at `end`, if nobody has been there.

        None where somebody has, or where there is no room: counting is atomic, also among threads.
        """
        if next(self._claims) != end:
            return None
        new, data = end + len(fresh), self._data
        if new > len(data):
            return None
        data[end:new] = fresh
        return data[new - size : new]
