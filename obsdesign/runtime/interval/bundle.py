"""Several interval observers of one plant: the state is in what all their bounds share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.bound_observer import BoundObserver
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.state import IntervalState

_PLANT = ("A", "B", "C", "G", "E", "flow_lower", "flow_upper", "jump_lower", "jump_upper",
          "noise_bound", "noise_centre", "jump_measurement")  # fmt: skip


@dataclass(frozen=True)
class IntervalBundle(BoundObserver[tuple[IntervalState, ...]]):
    """Runs observers side by side and reports the intersection of their bounds.

    observers: at least one, all of designs for the same plant (ValueError otherwise). A guarantee
    about the width that one of them has, the bundle has.
    """

    observers: tuple[IntervalObserver, ...]

    def __post_init__(self) -> None:
        if not self.observers:
            raise ValueError("a bundle needs at least one observer.")
        first = self.observers[0].gains
        for other in self.observers[1:]:
            for name in _PLANT:
                mine, theirs = (np.asarray(x.get(name)) for x in (first, other.gains))
                if not np.array_equal(mine, theirs):
                    raise ValueError(
                        f"observers of a bundle must be for one plant; {name} differs."
                    )

    @property
    def n(self) -> int:
        """Number of states."""
        return self.observers[0].n

    @property
    def reads(self) -> dict[str, int | bool]:
        """How many y, u, w a sample has, and whether jumps are reported."""
        return self.observers[0].reads

    def init(
        self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike
    ) -> tuple[IntervalState, ...]:
        """States at time t from bounds of x(t); ValueError as for one observer."""
        return tuple(one.init(t, lower=lower, upper=upper) for one in self.observers)

    def reset(
        self, state: tuple[IntervalState, ...], *, lower: ArrayLike, upper: ArrayLike
    ) -> tuple[IntervalState, ...]:
        """The same instant with new bounds of x(t), for all of them."""
        pairs = zip(self.observers, state, strict=True)
        return tuple(one.reset(each, lower=lower, upper=upper) for one, each in pairs)

    def step(
        self, state: tuple[IntervalState, ...], sample: Sample
    ) -> tuple[tuple[IntervalState, ...], Estimate]:
        """One step of all. The status is `ok` if all are, else what they object to, each once."""
        pairs = zip(self.observers, state, strict=True)
        following, found = zip(*(one.step(each, sample) for one, each in pairs), strict=True)
        lower = np.max([estimate.lower for estimate in found], axis=0)
        upper = np.min([estimate.upper for estimate in found], axis=0)
        said = [text for one in found for text in one.status.split("; ") if text != "ok"]
        if (lower > upper).any():
            lower, upper = found[0].lower, found[0].upper
            said.append("bounds crossed")
        events = tuple(dict.fromkeys(event for one in found for event in one.events))
        status = "; ".join(dict.fromkeys(said)) or "ok"
        return following, Estimate(found[0].t, None, lower, upper, events=events, status=status)
