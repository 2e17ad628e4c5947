"""Width maps of an interval observer with an event at uncertain times, G = I; upper bounds.

The state is kept as a body, a box, and a curve for each of the last events (`runtime`): its width
is at most that of the body and of the curves. An event at s, within delta of its stamp, adds
e^{A(t - s)} (gamma + c) to the state: about the middle m of its window the curve of gamma is
sum_i eta^i (-delta)^i / i! A^i e^{A(t - m)} gamma, i from 1 on; what c adds belongs to the body.
In the window the body flows on, for at most 2 delta, without samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import exact
from lmi.arithmetic.enclosure import Enclosure, expm, raised
from lmi.bounds.graph_tube import Least
from obsdesign.analysis.interval.clock_widths import ClockSystem
from obsdesign.analysis.interval.uncertain_widths import CELLS, UncertainSystem, product, times
from obsdesign.equations.boxes import image_box
from obsdesign.equations.interval.uncertain_jump import DEGREE, MOST_CURVES, UncertainJump

_AGES = 256  # of the shortest time between two stamps
_PART = 1 / 32  # of the time constants, at least
_MOST_CELLS = 4096
_DOUBLINGS = 60
_LARGEST_FLOW = 1e50  # beyond, the flow is taken to grow for ever


@dataclass(frozen=True)
class UncertainAdditiveSystem(UncertainSystem):
    """Width maps of the body; of samples with the curves as part of the noise."""

    def reason_against(self) -> str | None:
        """Reason why widths are not bounded, or None."""
        if reason := self.reason_against_clocks():
            return reason
        if self._largest_flow is None:
            return "the flow does not decay: a curve of an event's time would not become narrower"
        return None

    def sampled(self, sensor: int) -> Least:
        """What a sample of a sensor makes of the width of the body."""
        own = self.gains.outputs[sensor]
        half = 2 * exact(self.curves.outputs[own])
        # the strip and the corrected box of noise that is wider by the curves
        wider = ClockSystem(self.gains).sampled(sensor)
        L, C = exact(self.gains.L[:, own]), exact(self.gains.C[own])
        added = [half[0] * 0, abs(L) @ half]
        maps = [(N, k + extra) for (N, k), extra in zip(wider.maps[:2], added, strict=True)]
        for (N, k), c, extra in zip(wider.maps[2:], C, half, strict=True):
            share = np.array([extra / abs(x) if x != 0 else x * 0 for x in c], dtype=object)
            maps.append((N, k + share))
        return Least(tuple(maps))

    def happened(self, events: Sequence[int]) -> tuple[Least, ...]:
        """What a window, or exact events, make of the width of the body."""
        if self.place not in events:
            return super().happened(events)
        flow, delta = exact(self.window_flow), exact(np.array(self.delta))[()]
        c_lower, c_upper = image_box(*self.event.disturbance)
        c = exact(c_upper) - exact(c_lower)
        noise = (
            exact(self._c_spread) @ c + 2 * exact(self._remainder) + 2 * exact(self.curves.folded)
        )
        return (Least(((flow, 2 * delta * (flow @ self.f) + noise),)),)

    @cached_property
    def curves(self) -> CurveSizes:
        """Half ranges of the curves."""
        return CurveSizes.from_system(self)

    @cached_property
    def _c_spread(self) -> Matrix:
        """Upper bound of sum_i d^i / i! |A^i e^{A d}|, d from 0 to delta, i from 0 on, (n, n)."""
        A, n = self.gains.A, self.gains.n
        h = self.delta / CELLS
        step, short = expm(product(A, h)), expm(product(np.abs(A), h)).upper
        flow, largest = Enclosure.exactly(np.eye(n)), np.zeros((n, n))
        for k in range(CELLS):
            terms = _scaled_powers(A, flow, (k + 1) * h)
            total = raised(np.sum([x.magnitude for x in terms], axis=0), len(terms) + 2)
            largest = np.maximum(largest, times(total, short))
            flow = step @ flow
        return raised(largest + self._jump_maps.remainder[:, 2 * n :], 1)

    @cached_property
    def _remainder(self) -> Matrix:
        """What the polynomial of the added columns leaves, (n,)."""
        n = self.gains.n
        remainder = times(self._jump_maps.remainder[:, 2 * n :], np.abs(self.added))
        return raised(remainder.sum(axis=1), remainder.shape[1] + 1)

    @cached_property
    def _jump_maps(self) -> UncertainJump:
        """Of the longest window."""
        h = math.nextafter(2 * self.delta, math.inf)
        return UncertainJump.from_window(self.gains.A, np.eye(self.gains.n), h, 0.0)

    @cached_property
    def largest_flow(self) -> Matrix:
        """Upper bound of |e^{A s}| for all s >= 0 (n, n)."""
        assert self._largest_flow is not None
        return self._largest_flow

    @cached_property
    def _largest_flow(self) -> Matrix | None:
        """The same; None where no decay is found."""
        A = self.gains.A
        h = 0.5 / max(float(np.abs(A).sum(axis=1).max()), 1e-300)
        flow, largest = expm(product(A, h)), expm(product(np.abs(A), h)).upper
        for _ in range(_DOUBLINGS):
            size = flow.magnitude
            norm = float(size.sum(axis=1).max()) * (1 + 1e-12)
            if norm <= 0.5:  # the powers add up to at most this part of the largest entry
                return raised(largest + norm * float(largest.max()), 4)
            if not norm <= _LARGEST_FLOW:
                return None
            largest = np.maximum(largest, times(size, largest))
            flow = flow @ flow
        return None


@dataclass(frozen=True)
class CurveSizes:
    """Upper bounds of half the ranges of the curves of the last events, together.

    always (n,): at any time after a window; before (n,): just before a window; outputs (p,): of C x
    at any time after a window; folded (n,): of a curve that becomes part of the body.
    """

    always: Matrix
    before: Matrix
    outputs: Matrix
    folded: Matrix

    @classmethod
    def from_system(cls, system: UncertainAdditiveSystem) -> CurveSizes:
        """Those of a system whose flow decays."""
        n, C = system.gains.n, system.gains.C
        shortest = ClockSystem(system.gains).dwell(system.place)[0]
        ages, sizes = _sizes_by_age(system, np.vstack([np.eye(n), C]), shortest)

        def since(k: int) -> Matrix:
            """The largest of ages from k shortest times less the window on."""
            age = (k * shortest - 2 * system.delta) * (1 - 1e-12)
            first = max(int(np.searchsorted(ages, age, side="right")) - 1, 0)
            return np.asarray(sizes[first:].max(axis=0))

        kept = range(MOST_CURVES)
        live = raised(np.sum([since(k) for k in kept], axis=0), MOST_CURVES)
        before = raised(np.sum([since(k + 1) for k in kept], axis=0), MOST_CURVES)
        return cls(live[:n], before[:n], live[n:], since(MOST_CURVES)[:n])


def _sizes_by_age(
    system: UncertainAdditiveSystem, rows: Matrix, shortest: float
) -> tuple[Matrix, Matrix]:
    """First ages of cells, ascending from 0, and half ranges of rows times a curve in each.

    Cells are parts of the shortest time and of the flow's time constants; then each is as long as
    all before it, and the last one has no end. A window that ends at the age theta was 2 theta long
    at most, and coefficients are powers of its length.
    """
    A, norm = system.gains.A, float(np.abs(system.gains.A).sum(axis=1).max())
    h = shortest / _AGES
    if norm * h > _PART:
        h = _PART / norm
    cells = math.ceil(min((MOST_CURVES + 1) * shortest / h, _MOST_CELLS))
    added = Enclosure.exactly(system.added)
    terms = _scaled_powers(A, added, system.delta)[1:]
    Q = Enclosure(*(np.hstack([getattr(x, part) for x in terms]) for part in ("mid", "rad")))
    step, within = expm(product(A, h)), expm(product(np.abs(A), h)).upper
    exact_rows, exact_A, sizes = Enclosure.exactly(rows), Enclosure.exactly(A), []
    for _ in range(cells):
        slope = times(np.abs(rows), times(within, (exact_A @ Q).magnitude)) * (h * (1 + 1e-12))
        sizes.append(raised(((exact_rows @ Q).magnitude + slope).sum(axis=1), 2 * Q.mid.shape[1]))
        Q = step @ Q
    ages, step = [k * h for k in range(cells + 1)], expm(product(A, cells * h))
    for _ in range(_DOUBLINGS):
        sizes.append(_ever(system, rows, Q))
        ages.append(2 * ages[-1])
        Q, step = step @ Q, step @ step
    sizes.append(_ever(system, rows, Q))
    ends = np.array([*ages[1:], math.inf])
    share = np.minimum(ends / system.delta * (1 + 1e-12), 1.0)
    return np.array(ages), np.asarray(raised(share[:, None] * np.array(sizes), 1))


def _ever(system: UncertainAdditiveSystem, rows: Matrix, Q: Enclosure) -> Matrix:
    """Half ranges of rows times a curve Q at any time from now on."""
    flows = times(np.abs(rows), times(system.largest_flow, Q.magnitude))
    return np.asarray(raised(flows.sum(axis=1), 2 * Q.mid.shape[1]))


def _scaled_powers(A: Matrix, X: Enclosure, d: float) -> list[Enclosure]:
    """d^i / i! A^i X for i up to the degree of curves."""
    terms, once = [X], product(A, d)
    for i in range(1, DEGREE + 1):
        terms.append((once @ terms[-1]).scaled(1.0 / i, 2.0**-53 / i))
    return terms
