"""Gains L, M against bounded disturbance, noise and effects of parameters.

L first by the matrix inequality of `lmi.find.peak_to_peak`, its rate by a line search, jumps left
out; then the sum of the states' bounds, in units of the box of x, is made smaller by a simplex
search over all entries that are open, from the best of several gains. What is searched are
estimates of the bounds; certified bounds choose among all candidates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.spectrum import spectral_radius
from lmi.find.peak_to_peak import DisturbedOutput, peak_gain
from lmi.time_budget import TimeBudget
from obsdesign.synthesis.convex_gain import ConvexGain
from obsdesign.synthesis.luenberger.driven_plant import DrivenPlant, GainPair

# rates of the inequality, in parts of the plant's fastest mode
_RATES = tuple(2.0**k for k in range(-3, 7))
_REFINED = tuple(2.0**k for k in (-0.5, 0.5))
# evaluations of the simplex search, for each open entry
_EVALUATIONS = 60
# so many of the best starts have a search; that of the best end begins anew there, at most so
# often, while the cost falls to this part
_STARTS, _AGAIN, _WORTHWHILE = 4, 3, 0.95
# its first steps: parts of an entry, of the plant's unit of it where it is zero
_STEP, _STEP_FROM_ZERO = 0.05, 0.1
# part of the bounds that smaller gains may cost, and how often an entry is halved
_SPARED, _HALVINGS = 0.02, 60


@dataclass(frozen=True)
class GainSearch:
    """Search of the entries that are open, of the gains `free` ("L", "M"), under constraints."""

    driven: DrivenPlant
    wanted: dict[str, ConvexGain]
    free: tuple[str, ...]

    def cost(self, gains: GainPair) -> float:
        """Estimate of the bounds' sum; infinite where the error does not decay."""
        with np.errstate(all="ignore"):
            return self.driven.cost(gains)

    def first_flow_gain(self, budget: TimeBudget) -> Matrix | None:
        """L of the matrix inequality, held to the constraints; None where they exclude it.

        budget: ends the line of rates, of which the best gain so far counts.
        """
        if "L" not in self.free:
            return None
        with np.errstate(all="ignore"):
            L = _least_peak(self.driven, budget)
        if L is None:
            return None
        gains = self._rounded(GainPair(L, np.zeros(L.shape)))
        F, _ = self.driven.matrices(gains)
        return gains.L if self.wanted["L"].is_met(gains.L, F) else None

    def improved_flow_gain(self, L: Matrix, budget: TimeBudget) -> Matrix:
        """L searched for the least bounds without jumps."""
        alone = replace(self, driven=replace(self.driven, K=None), free=("L",))
        gains = alone.improved([GainPair(L, 0 * L)], budget)
        return L if gains is None else gains.L

    def improved(self, starts: list[GainPair], budget: TimeBudget) -> GainPair | None:
        """The gains of the least cost that searches from the best of these meet in time."""
        coarse = map(self._coarse, starts if self.free else ())
        rated = {self._admitted_cost(gains): gains for gains in coarse}
        best = sorted(cost for cost in rated if math.isfinite(cost))[:_STARTS]
        if not best:
            return None
        ends = [self._descended(rated[cost], budget) for cost in best]
        gains, before = min(ends, key=self._admitted_cost), best[0]
        for _ in range(_AGAIN):
            cost = self._admitted_cost(gains)
            if cost > _WORTHWHILE * before or budget.remaining() < 0:
                break
            gains, before = self._descended(gains, budget), cost
        return self._moderate(gains)

    def _descended(self, start: GainPair, budget: TimeBudget) -> GainPair:
        """The gains that a simplex search from these ends with; these where no time is left."""
        if budget.remaining() < 0:
            return start
        scales = [self._scale(name, start) for name in self.free]
        x = np.concatenate([getattr(start, name).ravel() for name in self.free])
        scale = np.concatenate([values.ravel() for values in scales])
        open_entries = np.flatnonzero(np.concatenate([self._pattern(name) for name in self.free]))

        def gains_of(z: Matrix) -> GainPair:
            values = x.copy()
            values[open_entries] = z * scale[open_entries]
            parts = np.split(values, len(self.free))
            shaped = zip(self.free, parts, strict=True)
            return self._rounded(
                start._replace(**{name: part.reshape(start.L.shape) for name, part in shaped})
            )

        first = (x / scale)[open_entries]
        steps = np.where(first != 0, _STEP * first, _STEP_FROM_ZERO)
        options = {
            "maxfev": _EVALUATIONS * len(first), "xatol": 1e-3, "fatol": 1e-4,
            "initial_simplex": np.vstack([first, first + np.diag(steps)]),
        }  # fmt: skip
        from scipy.optimize import minimize  # slow to import, and few plants have parameters

        def end_in_time(_: Matrix) -> None:
            if budget.remaining() < 0:
                raise StopIteration

        result = minimize(
            lambda z: self._admitted_cost(gains_of(z)), first, method="Nelder-Mead",
            options=options, callback=end_in_time,
        )  # fmt: skip
        return gains_of(result.x)

    def _moderate(self, gains: GainPair) -> GainPair:
        """The gains with entries halved, first all of them, as long as the bounds hardly grow.

        A state that is measured is known as well as its noise by any gain that is large enough;
        entries may matter in their ratio alone, so that they shrink together.
        """
        most = (1 + _SPARED) * self.cost(gains)
        n, p = gains.L.shape
        columns = [(slice(None), j) for j in range(p)]
        for name in self.free:
            for place in ((slice(None), slice(None)), *columns, *np.ndindex(n, p)):
                for factor in (0.0, *[0.5] * _HALVINGS):
                    smaller = getattr(gains, name).copy()
                    smaller[place] *= factor
                    other = gains._replace(**{name: smaller})
                    if np.array_equal(smaller, getattr(gains, name)):
                        break
                    if self._admitted_cost(other) <= most:
                        gains = other
                    elif factor:
                        break
        return gains

    def _admitted_cost(self, gains: GainPair) -> float:
        """The cost; infinite for gains that the constraints exclude."""
        for name, X in zip("LM", self.driven.matrices(gains), strict=True):
            if X is None or name not in self.free:
                continue
            if not self.wanted[name].is_met(getattr(gains, name), X):
                return math.inf
        return self.cost(gains)

    def _rounded(self, gains: GainPair) -> GainPair:
        """Open gains with the zeros that are wanted, their norms below the largest ones."""
        return gains._replace(
            **{name: self.wanted[name].rounded(getattr(gains, name)) for name in self.free}
        )

    def _coarse(self, gains: GainPair) -> GainPair:
        """Open gains in 24 bits: a search that starts there ends alike whatever the rounding."""
        parts = {name: getattr(gains, name) for name in self.free}
        coarse = {name: X.astype(np.float32).astype(np.float64) for name, X in parts.items()}
        return self._rounded(gains._replace(**coarse))

    def _pattern(self, name: str) -> Matrix:
        pattern, shape = self.wanted[name].stated.pattern, self.driven.plant.output.C.T.shape
        return np.ones(math.prod(shape)) if pattern is None else np.array(pattern).ravel()

    def _scale(self, name: str, start: GainPair) -> Matrix:
        """Sizes of the entries; where they are zero, a unit of x for the unit of y that it is."""
        units, plant = self.driven.units, self.driven.plant
        natural = units[:, None] / self.driven.outputs
        if name == "L":
            natural = natural * (spectral_radius(np.abs(plant.flow.A)) or 1.0)
        own = np.abs(getattr(start, name))
        return np.where(own > 0, own, natural)


def _least_peak(driven: DrivenPlant, budget: TimeBudget) -> Matrix | None:
    """The gain of the inequality whose sum of bounds is least over a line of rates, in time."""
    A, C, units = driven.plant.flow.A, driven.plant.output.C, driven.units
    pace = spectral_radius(np.abs(A)) or 1.0
    outputs = driven.outputs  # what the unit of y is does not matter
    own = np.hstack([driven.E, np.zeros((len(A), len(C)))]) / units[:, None] / pace
    on_output = np.hstack([driven.D, np.diag(driven.V)]) / outputs[:, None]
    system = DisturbedOutput(A * units / units[:, None] / pace, C * units / outputs[:, None],
                             own, on_output)  # fmt: skip

    def at(rate: float) -> tuple[float, float, Matrix] | None:
        gain = peak_gain(system, rate) if budget.remaining() > 0 else None
        if gain is None:
            return None
        L = units[:, None] * gain.L * pace / outputs
        return driven.flow_cost(L), rate, L

    answers = [answer for answer in map(at, _RATES) if answer is not None]
    if not answers:
        return None
    best = min(answers, key=_cost)
    nearby = [answer for share in _REFINED if (answer := at(best[1] * share)) is not None]
    cost, _, L = min([best, *nearby], key=_cost)
    return L if math.isfinite(cost) else None


def _cost(answer: tuple[float, float, Matrix]) -> float:
    return answer[0]
