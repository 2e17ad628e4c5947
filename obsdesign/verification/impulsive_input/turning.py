"""Two features of an impulse as a plane curve that turns one way, by less than pi or 2 pi."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.balls import Ball, Exact, ball, exact, rational
from lmi.arithmetic.polynomials import times
from lmi.prove import exponential_sign as signs
from obsdesign.verification.impulsive_input.second_solution import FeatureCurve


@dataclass(frozen=True)
class PlaneCurve:
    """(b_i, b_j) for ages in [margin, tau]; start: balls of both at the margin."""

    curve: FeatureCurve
    pair: tuple[int, int]
    start: tuple[Ball, Ball]
    effort: signs.Effort

    @classmethod
    def from_features(
        cls, curve: FeatureCurve, pair: tuple[int, int], effort: signs.Effort
    ) -> PlaneCurve:
        """The curve of two features, counted from 0."""
        b = curve.value(curve.margin)
        return cls(curve, pair, (b[pair[0]], b[pair[1]]), effort)

    def turns_one_way(self, back: float | None) -> tuple[bool, float]:
        """(b_i b_j' - b_j b_i' has one sign and the first direction never returns, worst age).

        back: None, or an age at which it is about opposite to it. Then it must be beside the first
        direction before, behind it around that age, and on the other side of it afterwards: so it
        turns by less than 2 pi.
        """
        margin, tau = self.curve.margin, self.curve.tau
        sign, place = self._turning_sign()
        if sign == 0:
            return False, place
        near = margin + (tau - margin) / 64
        holds, place = self._has_sign(self._leaving, sign, margin, near)
        if not holds:
            return False, place
        parts = [(near, tau, self._beside_start, sign)]
        if back is not None:
            room = min(back - near, tau - back) / 2
            if room <= 0:
                return False, place
            parts = [
                (near, back - room / 2, self._beside_start, sign),
                (back - room, back + room, self._behind_start, 1),
                (back + room / 2, tau, self._beside_start, -sign),
            ]
        for low, high, side, required in parts:
            holds, place = self._has_sign(side, required, low, high)
            if not holds:
                return False, place
        return True, place

    def _turning_sign(self) -> tuple[int, float]:
        """(sign of the turning speed at all ages, 0 if it has none, where that was not shown)."""
        place = math.nan
        for sign in (1, -1):
            holds, place = self._has_sign(_turn, sign, self.curve.margin, self.curve.tau)
            if holds:
                return sign, place
        return 0, place

    def _has_sign(
        self, entries: Callable[[signs.Box], signs.Polynomial], sign: int, low: float, high: float
    ) -> tuple[bool, float]:
        holds, place = signs.one_sign(self._boxes(low, high), entries, sign, self.effort)
        return holds is True, place

    def _boxes(self, low: float, high: float) -> Iterator[signs.Box]:
        """Boxes of ages with (b_i, b_j, b_i', b_j'); used up by one look."""
        rows = [self.curve.n + index for index in self.pair]
        whole, state = _with_derivatives(self.curve.F, self.curve.z, rows, self.curve.tau)
        return signs.boxes(whole, ball(state), low, high, list(range(4)), effort=self.effort)

    def _beside_start(self, box: signs.Box) -> signs.Polynomial:
        return signs.combined((self.start[0], box.rows[1]), (-self.start[1], box.rows[0]))

    def _behind_start(self, box: signs.Box) -> signs.Polynomial:
        return signs.combined((-self.start[0], box.rows[0]), (-self.start[1], box.rows[1]))

    def _leaving(self, box: signs.Box) -> signs.Polynomial:
        return signs.combined((self.start[0], box.rows[3]), (-self.start[1], box.rows[2]))


def _turn(box: signs.Box) -> signs.Polynomial:
    p, q, dp, dq = box.rows
    return signs.combined((1, times(p, dq)), (-1, times(q, dp)))


def _with_derivatives(F: Exact, z: Exact, rows: list[int], tau: float) -> tuple[Exact, Exact]:
    """A system whose first four entries are b_i, b_j and their derivatives, then the old one.

    Derivatives by time over a power of two near tau: units of time change no size of an entry.
    """
    N, unit = len(F), rational(math.ldexp(1.0, math.frexp(tau)[1]))
    picked = np.vstack([F[rows[0] : rows[0] + 1], F[rows[1] : rows[1] + 1]])
    top = np.vstack([picked, picked @ F * unit])
    whole = np.hstack([np.vstack([exact(np.zeros((4, 4))), exact(np.zeros((N, 4)))]),
                       np.vstack([top, F])])  # fmt: skip
    start = np.vstack([z[rows[0] : rows[0] + 1], z[rows[1] : rows[1] + 1], picked @ z * unit, z])
    return whole, start
