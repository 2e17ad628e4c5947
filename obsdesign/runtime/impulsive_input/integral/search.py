"""Step 1 of Mattsson and Medvedev: at which t_o an impulse is to be evaluated.

The peak rule of their Section IV, made safe in noise: the maximum is that of a moving average of
|R| (the raw maximum selects noise that makes R large), it counts after a rise, and it is final
after a drop. An impulse that is already past its peak when a search begins leaves no interior
maximum; then the first instant is offered, to be taken only if the fit is good (`at_start`).
Where |b(age)| has no peak inside the ages that are searched, the oldest position is waited for: an
impulse is evaluated once the age that explains the features best is most of the window
(`Position`). With a threshold, the rule of their Section III-C: the first t_o with |R| above it.

An impulse that |R| does not show above its floor is evaluated where it stands out of white features
(`matched_filter`), once it is past its peak, unless a maximum is in progress.

    rise = share max(N, floor) + sigma      drop = share N_max + sigma
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.equations.impulsive_input.evaluation_rule import EVALUATED_AGE_SHARE
from obsdesign.runtime.clocks.time_stamps import time_tolerance
from obsdesign.runtime.impulsive_input.significance import LEAST_DEVIATIONS, LEAST_PEAK_DEVIATIONS
from obsdesign.runtime.state_marks import Past

_SHARE = 0.5  # of the features that it must explain


@dataclass(frozen=True, slots=True)
class Search:
    """Where a search stands: next row to look at, lowest and highest value, row of the highest.

    armed: after a rise, so that a maximum counts; at_start: the maximum is the first instant, or
    there is none, and only a good fit counts. matched_from: time from which on an impulse below
    the floor of |R| counts.
    """

    position: int = 0
    armed: bool = False
    at_start: bool = False
    lowest: float = math.inf
    highest: float = -math.inf
    top: int = 0
    matched_from: Past = -math.inf

    @property
    def front(self) -> int:
        """First row whose estimate an impulse may still change."""
        return self.top if self.armed else self.position

    def shifted(self, rows: int) -> Search:
        """The same search after `rows` rows were dropped in front."""
        return replace(self, position=self.position - rows, top=self.top - rows)

    def given_up(self, value: float, matched_from: float) -> Search:
        """The search after its maximum was turned down."""
        return replace(
            self, armed=False, at_start=False, lowest=value, highest=-math.inf,
            matched_from=matched_from,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Rule:
    """When an impulse is evaluated.

    floor: |R| that stands out from rounding; share: of the hysteresis. threshold: fire when it is
    exceeded, instead of at a maximum; None for the peak rule.
    """

    floor: float
    share: float
    threshold: float | None = None

    def advance(
        self, search: Search, values: list[float], offset: int, rows: NoisyRows, tau: float
    ) -> tuple[Search, bool]:
        """(search, fired) after the values of rows offset, offset + 1, ...; stops when it fires.

        A fired search points with `top` at t_o. A maximum that no drop followed within tau is
        final: what made it has left the window by then, or was no impulse.
        """
        if self.threshold is not None:
            return self._exceeded(search, values, offset)
        times, sigmas = rows.times, rows.sigmas[offset : offset + len(values)].tolist()
        matched = rows.is_matched(search.matched_from, offset, offset + len(values))
        lowest, highest, top = search.lowest, search.highest, search.top
        armed, at_start = search.armed, search.at_start
        for j in range(search.position, offset + len(values)):
            value, sigma = values[j - offset], sigmas[j - offset]
            floor = max(self.floor, LEAST_PEAK_DEVIATIONS * sigma)
            if lowest == math.inf and not armed:  # the search begins: is it past a peak?
                lowest = value
                armed, at_start, highest, top = value > floor, True, value, j
                continue
            if matched[j - offset] and not (armed and highest > floor):
                return replace(
                    search, position=j + 1, armed=True, at_start=True, lowest=lowest,
                    highest=value, top=j,
                ), True  # fmt: skip
            if not armed:
                lowest = min(lowest, value)
                if value > lowest + self.share * max(value, floor) + sigma:
                    armed, at_start, highest, top = True, False, value, j
                continue
            if value > highest:
                at_start &= value < lowest + self.share * max(value, floor) + sigma
                highest, top = value, top if at_start else j
            elif value < highest - self.share * highest - sigma or times[j] - times[top] > tau:
                if highest > max(self.floor, LEAST_PEAK_DEVIATIONS * float(rows.sigmas[top])):
                    return replace(
                        search, position=j + 1, armed=True, at_start=at_start, lowest=lowest,
                        highest=highest, top=top,
                    ), True  # fmt: skip
                armed, at_start, lowest, highest = False, False, value, -math.inf
        return replace(
            search, position=offset + len(values), armed=armed, at_start=at_start, lowest=lowest,
            highest=highest, top=top,
        ), False  # fmt: skip

    def _exceeded(self, search: Search, values: list[float], offset: int) -> tuple[Search, bool]:
        for j in range(search.position, offset + len(values)):
            if values[j - offset] > (self.threshold or 0.0):
                highest = values[j - offset]
                return Search(position=j + 1, armed=True, lowest=0.0, highest=highest, top=j), True
        return Search(position=offset + len(values)), False


class NoisyRows(NamedTuple):
    """Times of all rows (L,); deviations of the values of those that have one (k,).

    matched (k,): deviations by which an impulse stands out of their white features.
    """

    times: Matrix
    sigmas: Matrix
    matched: Matrix

    def is_matched(self, since: float, first: int, last: int) -> list[bool]:
        """Whether rows first .. last - 1 show an impulse, from a time on."""
        counts = self.times[first:last] >= since
        return list((counts & (self.matched[first:last] > LEAST_DEVIATIONS)).tolist())


@dataclass(frozen=True)
class Position:
    """Part of the features that one impulse explains, where it is old enough to be evaluated.

    whitening (r, mp) makes the noise of features uncorrelated; bases (G, r, q) span the whitened b
    at G ages.
    """

    whitening: Matrix
    bases: Matrix
    old: Array

    @classmethod
    def from_curve(cls, whitening: Matrix, ages: Matrix, b: Matrix, oldest: float) -> Position:
        """From b (G, mp, q) at increasing ages above zero; `oldest`: ages searched end here."""
        ages, b = ages[ages <= oldest], b[ages <= oldest]
        bases = np.linalg.qr(whitening @ b)[0]
        return cls(whitening, bases, ages >= EVALUATED_AGE_SHARE * oldest)

    def values(self, R: Matrix) -> Matrix:
        """Square root of what the best age explains of |R|^2, (k,) for R (k, mp); else zero.

        Zero where that age is young, or where it leaves half of the features unexplained.
        """
        weighted = R @ self.whitening.T
        G, r, q = self.bases.shape
        onto = weighted @ self.bases.transpose(1, 0, 2).reshape(r, G * q)
        explained = (onto.reshape(len(R), G, q) ** 2).sum(axis=2)
        best = np.argmax(explained, axis=1)
        most = explained[np.arange(len(R)), best]
        whole = (weighted * weighted).sum(axis=1)
        return np.where(self.old[best] & (most >= _SHARE * whole), np.sqrt(most), 0.0)


def smoothed(times: Matrix, values: Matrix, first: int, half: float) -> Matrix:
    """Moving average of `values` over times within `half` of each row from `first` on.

    Only rows whose neighbourhood is complete to the right; it is cut short to the left.
    """
    if half <= 0:
        return values[first:]
    slack, times = time_tolerance(half, float(times[-1])), times[: len(values)]
    rows = int(np.searchsorted(times, times[-1] - half + slack, "right"))
    centres = times[first:rows]
    if len(centres) == 0:
        return values[:0]
    sums = np.concatenate([[0.0], np.cumsum(values)])
    low = np.searchsorted(times, centres - half - slack, "left")
    high = np.searchsorted(times, centres + half + slack, "right")
    return np.asarray((sums[high] - sums[low]) / (high - low))
