"""From when on a box of the state counts, stated or proved from the plant.

A stated box counts at every instant, as long as known inputs keep the bounds that are stated with
it; after one beyond them, once the bounds of the observer are inside it again. A proved box: every
solution of |x|' <= W |x| + f, |x+| <= N |x| + h comes to a tube, and stays in it: from then on the
box of the tube holds, and effects of parameters are bounded. Until then the same comparison system
bounds |x|, beside the bounds of the observer, whatever they were at the start, or after an input
beyond its bound.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import Enclosure, expm, raised, stack
from obsdesign.runtime.base import vector
from obsdesign.runtime.boxes import initial_bounds
from obsdesign.runtime.step_cache import shared_step


class SizeStep(NamedTuple):
    """A step of h between time stamps of at most `time`, with the known input u (m,)."""

    h: float
    time: float
    u: Matrix


class Bounds(NamedTuple):
    """lower <= x <= upper (n,), as an observer has them."""

    lower: Matrix
    upper: Matrix


@dataclass(frozen=True)
class StatedBox:
    """lower <= x <= upper (n,), as a problem file says."""

    lower: Matrix
    upper: Matrix

    def at_start(self, lower: ArrayLike, upper: ArrayLike) -> Matrix | None:
        """None: the box counts."""
        return None

    def ends(self, late: str | None, large: Sequence[str]) -> bool:
        """Does the box not count in a row with inputs beyond their bounds (`large`)?"""
        return bool(large)

    def after_row(
        self, largest: Matrix | None, step: SizeStep, results: Sequence[Bounds], w: ArrayLike | None
    ) -> Matrix | None:
        """None once the bounds after a row are inside the box, until then no bound of |x|."""
        last = results[-1]
        is_inside = (self.lower <= last.lower).all() and (last.upper <= self.upper).all()
        return None if is_inside else np.full(len(self.lower), np.inf)


@dataclass(frozen=True)
class Growth:
    """|x|' or |x+| is at most state |x| + disturbance + inputs |u|."""

    state: Matrix
    disturbance: Matrix
    inputs: Matrix

    def added(self, u: Matrix) -> Matrix:
        """Disturbance and inputs, (n,)."""
        return raised(self.disturbance + self.inputs @ np.abs(u), len(u) + 1)


@dataclass(frozen=True)
class StateTube:
    """The comparison system of a design whose box was proved; jump: None without jumps.

    tube (n,): |x| <= tube just after a jump, or at any time without jumps, is never left; upper
    (n,): |x| <= upper as long as the box counts.
    """

    flow: Growth
    jump: Growth | None
    tube: Matrix
    upper: Matrix

    def at_start(self, lower: ArrayLike, upper: ArrayLike) -> Matrix | None:
        """Bound of |x| (n,), None where the box holds already: never before a jump that is due."""
        largest = _largest_in(*initial_bounds(len(self.tube), lower, upper))
        return None if self.jump is None and self._holds(largest) else largest

    def ends(self, late: str | None, large: Sequence[str]) -> bool:
        """Does the box not count in a row at a wrong dwell time, or with inputs too large?"""
        return late is not None or bool(large)

    def after_row(
        self, largest: Matrix | None, step: SizeStep, results: Sequence[Bounds], w: ArrayLike | None
    ) -> Matrix | None:
        """Bound of |x| (n,) after a row, None once the box holds.

        largest: before it, None where the box held up to it; results: of the step, and of the jump
        if there is one, with its input w.
        """
        first, *later = results
        largest = self.after(self.upper if largest is None else largest, step)
        largest = np.fmin(largest, _largest_in(first.lower, first.upper))
        if later and self.jump is not None:
            known = np.zeros(self.jump.inputs.shape[1])
            known = known if w is None else vector(w, len(known), "w")
            largest = self.after_jump(largest, known)
            largest = np.fmin(largest, _largest_in(later[-1].lower, later[-1].upper))
        may_hold = later or self.jump is None
        return None if may_hold and self._holds(largest) else largest

    def after(self, largest: Matrix, step: SizeStep) -> Matrix:
        """Bound of |x| (n,) after a step."""
        flow, once = shared_step(self._steps, step.h, step.time, self._built)
        terms = 4 * len(largest) + len(step.u) + 8
        added = self.flow.added(step.u)
        with np.errstate(over="ignore", invalid="ignore"):
            grown = raised(flow @ largest + once @ added, terms)
        return np.where(np.isnan(grown), np.inf, grown)

    def after_jump(self, largest: Matrix, w: Matrix) -> Matrix:
        """Bound of |x| (n,) after a jump with the known input w (l,)."""
        assert self.jump is not None
        terms = 4 * len(largest) + len(w) + 8
        with np.errstate(over="ignore", invalid="ignore"):
            return raised(self.jump.state @ largest + self.jump.added(w), terms)

    def _holds(self, largest: Matrix) -> bool:
        return bool((largest <= self.tube).all())

    def _built(self, h: float, h_error: float) -> tuple[Matrix, Matrix]:
        n = len(self.tube)
        identity, zero = (Enclosure.exactly(X) for X in (np.eye(n), np.zeros((n, n))))
        W = Enclosure.exactly(self.flow.state).scaled(h, h_error)
        whole = expm(stack([[W, identity], [zero, zero]]))
        once = Enclosure(whole.mid[:n, n:], whole.rad[:n, n:]).scaled(h, h_error)
        flow = np.maximum((whole.mid + whole.rad)[:n, :n], 0.0)
        return raised(flow, 1), np.maximum(once.upper, 0.0)

    @cached_property
    def _steps(self) -> OrderedDict[tuple[float, int], tuple[Matrix, Matrix]]:
        return OrderedDict()


def _largest_in(lower: Matrix, upper: Matrix) -> Matrix:
    """Largest |x| (n,) of a box."""
    return np.maximum(np.abs(lower), np.abs(upper))
