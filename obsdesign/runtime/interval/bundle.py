"""Several interval observers of one plant: the state is in the intersection of their bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.runtime.base import Estimate, Sample
from obsdesign.runtime.bound_observer import BoundObserver
from obsdesign.runtime.interval.observer import IntervalObserver
from obsdesign.runtime.interval.state import JUMP, BoundsFault, IntervalState

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
                if not np.array_equal(getattr(first, name), getattr(other.gains, name)):
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
        return tuple(each.init(t, lower=lower, upper=upper) for each in self.observers)

    def reset(
        self, state: tuple[IntervalState, ...], *, lower: ArrayLike, upper: ArrayLike
    ) -> tuple[IntervalState, ...]:
        """The same instant with new bounds of x(t), for all of them."""
        pairs = zip(self.observers, state, strict=True)
        return tuple(observer.reset(each, lower=lower, upper=upper) for observer, each in pairs)

    def step(
        self, state: tuple[IntervalState, ...], sample: Sample
    ) -> tuple[tuple[IntervalState, ...], Estimate]:
        """One step of all. The status is `ok` if all are, else their objections, each once."""
        pairs = zip(self.observers, state, strict=True)
        results = [observer.step(each, sample) for observer, each in pairs]
        following, estimates = zip(*results, strict=True)
        lower = np.max([estimate.lower for estimate in estimates], axis=0)
        upper = np.min([estimate.upper for estimate in estimates], axis=0)
        events = tuple(dict.fromkeys(event for each in estimates for event in each.events))
        objections = [text for _, text in events if text != JUMP]
        if (lower > upper).any():
            lower, upper = estimates[0].lower, estimates[0].upper
            objections.append(BoundsFault.CROSSED.value)
        status = "; ".join(dict.fromkeys(objections)) or "ok"
        return following, Estimate(estimates[0].t, None, lower, upper, events=events, status=status)
