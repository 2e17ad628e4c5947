"""Gains L against bounded disturbance, noise and effects of parameters.

First by the matrix inequality of `lmi.find.peak_to_peak`, its rate by a line search; then the sum
of the states' bounds int |e^(Fs) E| ds, in units of the box of x, is made smaller by a simplex
search. Jumps are left out of both: M is chosen for these L, and certified bounds choose among all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import to_float
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius
from lmi.find.peak_to_peak import DisturbedOutput, peak_gain
from obsdesign.analysis.folded import StateBounds
from obsdesign.analysis.luenberger.driven_error import driven_error
from obsdesign.equations.luenberger.gains import LuenbergerGains
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.luenberger.error_bound import KnownBox

# rates of the inequality, in parts of the plant's fastest mode
_RATES = tuple(2.0**k for k in range(-3, 7))
_REFINED = tuple(2.0**k for k in (-0.5, 0.5))
# evaluations of the simplex search, for each entry of L
_EVALUATIONS = 60
# part of the bounds that smaller gains may cost, and how often an entry is halved
_SPARED, _HALVINGS = 0.05, 60
# the integral: cells of this part of 1 / ||F||, so many of each length, each length twice the last
_REACH, _CELLS_LOG2, _STAGES, _DECAY = 0.05, 6, 40, 14.0


@dataclass(frozen=True)
class DrivenPlant:
    """The nominal plant, columns E (n, k) of what acts on e whatever L is, V (p,) of noise.

    units (n,): in which bounds of e are added.
    """

    plant: Plant
    E: Matrix
    V: Matrix
    units: Matrix

    @staticmethod
    def from_box(uncertain: Plant, nominal: Plant, box: KnownBox) -> DrivenPlant:
        """In units of the box; effects of parameters on y count as noise of their largest size."""
        n, p = nominal.n, nominal.p
        zero = np.zeros((n, p))
        gains = LuenbergerGains.from_plant(nominal, L=zero, M=zero)
        E = to_float(driven_error(uncertain, gains, box.bounds).E)
        radius = nominal.output.noise_radius
        V = np.zeros(p) if radius is None else radius
        V = V + _output_effects(uncertain, box.bounds)
        return DrivenPlant(nominal, E, V, box.units)

    def cost(self, L: Matrix) -> float:
        """Sum of the bounds of e in these units, in floats; infinite where e does not decay."""
        F = self.plant.flow.A - L @ self.plant.output.C
        E = np.hstack([self.E, L * self.V])
        return float((_integrals(F, E) / self.units[:, None]).sum())


def is_noisy(plant: Plant) -> bool:
    """Has every output noise? Without, no gain would be too large."""
    radius = plant.output.noise_radius
    return radius is not None and bool((radius > 0).all())


def peak_gains(driven: DrivenPlant) -> Iterator[tuple[str, Matrix]]:
    """Yield the gain of a search from that of the inequality, and that one; with labels."""
    first = _least_peak(driven)
    if first is None:
        return
    shape, scale = first.shape, np.abs(first).ravel()
    scale = np.where(scale > 0, scale, scale.max() or 1.0)

    def cost(x: Matrix) -> float:
        return driven.cost((x * scale).reshape(shape))

    options = {"maxfev": _EVALUATIONS * first.size, "xatol": 1e-3, "fatol": 1e-4}
    with np.errstate(all="ignore"):
        result = minimize(cost, first.ravel() / scale, method="Nelder-Mead", options=options)
    searched = (result.x * scale).reshape(shape)
    if np.isfinite(searched).all():
        yield "peak-to-peak L, then searched", _moderate(driven, searched)
    yield "peak-to-peak L", first


def _moderate(driven: DrivenPlant, L: Matrix) -> Matrix:
    """L with entries halved as long as the bounds hardly grow: where they need none, large ones.

    A state that is measured is known as well as its noise by any gain that is large enough.
    """
    L, most = L.copy(), (1 + _SPARED) * driven.cost(L)
    for place in np.ndindex(L.shape):
        for factor in (0.0, *[0.5] * _HALVINGS):
            smaller = L.copy()
            smaller[place] *= factor
            if driven.cost(smaller) <= most:
                L = smaller
            elif factor:
                break
    return L


def _least_peak(driven: DrivenPlant) -> Matrix | None:
    """The gain of the inequality whose sum of bounds is least over a line of rates."""
    A, C, units = driven.plant.flow.A, driven.plant.output.C, driven.units
    pace = spectral_radius(np.abs(A)) or 1.0
    system = DisturbedOutput(
        A * units / units[:, None] / pace, C * units, driven.E / units[:, None] / pace, driven.V
    )

    def at(rate: float) -> tuple[float, float, Matrix] | None:
        gain = peak_gain(system, rate)
        if gain is None:
            return None
        L = units[:, None] * gain.L * pace
        return driven.cost(L), rate, L

    answers = [answer for answer in map(at, _RATES) if answer is not None]
    if not answers:
        return None
    best = min(answers, key=_cost)
    nearby = [answer for share in _REFINED if (answer := at(best[1] * share)) is not None]
    cost, _, L = min([best, *nearby], key=_cost)
    return L if math.isfinite(cost) else None


def _cost(answer: tuple[float, float, Matrix]) -> float:
    return answer[0]


def _output_effects(uncertain: Plant, bounds: StateBounds) -> Matrix:
    """Largest effect of parameters on y in the box, (p,)."""
    middle, half = (bounds.lower + bounds.upper) / 2, (bounds.upper - bounds.lower) / 2
    total = np.zeros(uncertain.p)
    for parameter in uncertain.parameters:
        low, high = parameter.range
        X = parameter.effects.get("C")
        if X is not None:
            total += (high - low) / 2 * (np.abs(X @ middle) + np.abs(X) @ half)
    return total


def _integrals(F: Matrix, E: Matrix) -> Matrix:
    """Integrals of |e^(Fs) E| over s >= 0 by the midpoint rule; infinite where F is not Hurwitz."""
    size, decay = float(np.abs(F).sum(axis=1).max()), -float(np.linalg.eigvals(F).real.max())
    if not (np.isfinite(size) and decay > 0):
        return np.full(E.shape, np.inf)
    length, time, start, total = _REACH / size, 0.0, E, np.zeros(E.shape)
    for _ in range(_STAGES):
        states, power = (expm(F * length / 2) @ start)[None], expm(F * length)
        onwards = power
        for _ in range(_CELLS_LOG2):
            states, onwards = np.concatenate([states, onwards @ states]), onwards @ onwards
        total = total + length * np.abs(states).sum(axis=0)
        start, time = onwards @ start, time + length * len(states)
        if decay * time > _DECAY:
            break
        length *= 2
    return total
