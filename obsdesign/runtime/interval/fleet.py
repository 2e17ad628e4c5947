"""Many plants of one kind at once: the interval observer of each, side by side.

All plants share a design and their sampling times; states, measurements and bounds are columns, one
per plant. Rounding is bounded for the largest entry of every row, so that one vector serves all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lmi.arithmetic.enclosure import UNIT, raised
from obsdesign.runtime.interval.kernel import Kernel
from obsdesign.runtime.interval.observer import IntervalObserver

Matrix = NDArray[np.float64]


class FleetState(NamedTuple):
    """centre, radius: (n, plants) in the observer's coordinates; y: (p, plants), last sample."""

    t: float
    centre: Matrix
    radius: Matrix
    y: Matrix | None


class FleetEstimate(NamedTuple):
    """lower, upper: (n, plants) bounds of x at t; plausible: (plants,), False where they are void.

    They are void where no state inside them can give the measurement, or where they overflowed.
    """

    t: float
    lower: Matrix
    upper: Matrix
    plausible: NDArray[np.bool_]


@dataclass(frozen=True)
class Fleet:
    """Executes one design for many plants without inputs, between jumps.

    observer: of a design without known inputs. ValueError for one that has any. With periodic
    samples every one is used: a width is guaranteed for steps of a period only.
    """

    observer: IntervalObserver

    def __post_init__(self) -> None:
        if self.observer.reads["u"]:
            raise ValueError("a fleet has no known inputs; this design has.")

    def init(self, t: float = 0.0, *, lower: ArrayLike, upper: ArrayLike) -> FleetState:
        """State at time t from bounds of every plant's x(t), (n, plants) each."""
        low, high = (np.asarray(ends, dtype=np.float64) for ends in (lower, upper))
        boxes = [
            self.observer.init(t, lower=a, upper=b).box for a, b in zip(low.T, high.T, strict=True)
        ]
        n, box = self.observer.n, np.array(boxes).T
        return FleetState(float(t), box[n:].copy(), box[:n].copy(), None)

    def step(self, state: FleetState, t: float, y: ArrayLike) -> tuple[FleetState, FleetEstimate]:
        """Move all plants to time t, where y, (p, plants), was measured. ValueError unless t grows.

        Measurements must be finite: a plant that misses one needs an observer of its own.
        """
        seen = np.array(y, dtype=np.float64)
        if not t > state.t:
            raise ValueError(f"time must increase; got {t!r} after {state.t!r}.")
        with np.errstate(over="ignore", invalid="ignore"):
            return self._step(state, t, seen)

    def _step(self, state: FleetState, t: float, seen: Matrix) -> tuple[FleetState, FleetEstimate]:
        chosen = self.observer.fleet_kernel(
            t - state.t, max(abs(t), abs(state.t)), state.y is not None
        )
        n, p = chosen.n, chosen.p
        rows, middle = chosen.rows, chosen.middle
        start = np.zeros_like(seen) if state.y is None else state.y
        X = rows[n : 2 * n, n:middle]
        before = state.y is not None and bool(X[:, n : n + p].any())
        centre = X[:, :n] @ state.centre + X[:, n + p : n + 2 * p] @ seen + X[:, -1:]
        if before:
            centre += X[:, n : n + p] @ start
        known = np.concatenate(
            [_largest(state.centre), _largest(start), _largest(seen), np.ones(1)]
        )
        extra = raised(rows[:n, middle:] @ known, 4 * middle)
        radius = rows[:n, :n] @ state.radius
        radius += extra[:, None]
        radius *= 1.0 + 8 * n * UNIT
        room = self._room(chosen, state, seen, start, known)
        lower, upper = self._bounds(centre, radius)
        plausible = (room >= 0) & np.isfinite(upper - lower).all(axis=0)
        return FleetState(t, centre, radius, seen), FleetEstimate(t, lower, upper, plausible)

    def _room(
        self, chosen: Kernel, state: FleetState, seen: Matrix, start: Matrix, known: Matrix
    ) -> NDArray[np.float64]:
        """What is left between the measurement and what the predicted boxes allow, least of p."""
        n, p, middle = chosen.n, chosen.p, chosen.middle
        checks = chosen.rows[2 * n : 2 * n + p]
        middles = checks[:, n : 2 * n] @ state.centre
        middles += checks[:, 2 * n + p : 2 * n + 2 * p] @ seen
        if checks[:, 2 * n : 2 * n + p].any():
            middles += checks[:, 2 * n : 2 * n + p] @ start
        middles += checks[:, middle - 1, None]
        reach = checks[:, :n] @ state.radius
        reach += raised(checks[:, middle:] @ known, 4 * middle)[:, None]
        room: Matrix = (reach - np.abs(middles)).min(axis=0)
        return room

    def _bounds(self, centre: Matrix, radius: Matrix) -> tuple[Matrix, Matrix]:
        """Of x = S z, rounded outward by widening the radius."""
        S = self.observer.gains.get("S")
        if S is not None:
            spread = raised(np.abs(S) @ (radius + 8 * len(S) * UNIT * np.abs(centre)), 4 * len(S))
            centre, radius = S @ centre, spread
        widened = radius + 4 * UNIT * (np.abs(centre) + radius)
        return centre - widened, centre + widened


def _largest(values: Matrix) -> Matrix:
    """Largest absolute value of each row."""
    largest: Matrix = np.maximum(values.max(axis=1), -values.min(axis=1))
    return largest
