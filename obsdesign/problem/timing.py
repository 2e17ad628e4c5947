"""The [timing] block: what the clocks of events have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.entries import real
from obsdesign.errors import InputError
from obsdesign.problem.blocks import Block, set_fields
from obsdesign.problem.schema import NONNEGATIVE, file_entry


@dataclass(frozen=True, eq=False)
class Timing(Block):
    """spacing: least time between two events of different names, in the plant's time unit."""

    spacing: float = file_entry(
        NONNEGATIVE, "Least time between two events of different names; default 0.", default=0.0
    )

    def __post_init__(self) -> None:
        spacing = real(self.spacing, "timing.spacing")
        if not 0 <= spacing < math.inf:
            raise InputError(f"timing.spacing must be a number >= 0; got {spacing!r}.")
        set_fields(self, spacing=spacing)

    def check(
        self, events: int, dt: float | None, uncertain: Sequence[str], longest: Sequence[float]
    ) -> None:  # fmt: skip
        """InputError for a spacing that a plant with so many events has no use for, or cannot keep.

        dt: step of discrete time; uncertain: names of events whose time stamps have an error;
        longest: times of the events that must come, in every mode.
        """
        if not self.spacing:
            return
        if events < 2:
            raise InputError(
                "timing.spacing requires two events or more, since it is the time between those of "
                f"different names; got {events}."
            )
        if dt is not None or uncertain:
            entry = "flow.dt" if dt is not None else f"event.{uncertain[0]}.time_error"
            raise InputError(f"timing.spacing is not available with {entry}.")
        # another event between two of one name is that far from both
        if len(longest) > 1 and 2 * self.spacing > min(longest):
            raise InputError(
                f"timing.spacing must be at most half of the longest time of every event, "
                f"{min(longest) / 2:.9g}, since another event comes between two of a name; got "
                f"{self.spacing!r}."
            )
