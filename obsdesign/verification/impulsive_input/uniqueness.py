"""Uniqueness of (17): b(age) g = R has one solution (age, g) only.

The paper calls uniqueness likely; it is false in general. What decides here, for ages in
[margin, window], exponents lambda_1..lambda_m, and h(s) = C_j e^{D s} H g:

1. D with real spectrum. A second solution makes the integral of e^{lambda u} q(u), q piecewise a
   sum of n exponentials, vanish at m real lambda; by Descartes' rule for Laplace transforms it has
   no more zeros than q has sign changes, at most 2 n - 1, or n where h has no zero. So m >= 2 n
   suffices, m >= n + 1 if h has no zero, and m >= 2 if C_j (s I - D)^-1 H has no zero at all: then
   h is a Polya frequency function and b_i / b_j is strictly monotone.
2. Any spectrum: the plane curve (b_i, b_j) turns one way, by less than pi. Proved in balls. Among
   nonnegative weights less than 2 pi is enough: opposite directions are no longer one answer.
3. A second solution, where two or three features are all there is: `second_solution`.
"""

from __future__ import annotations

import itertools

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, ball, exact, fixed_vector, precision, to_float
from lmi.prove import exponential_sign as signs
from lmi.prove.hurwitz import real_spectrum
from lmi.time_budget import UNLIMITED, TimeBudget
from lmi.verdict import Verdict, proved, refuted, undecided
from obsdesign.equations.impulsive_input.features import (
    FeatureWindow,
    feature_flows,
    feature_units,
    filtered_system,
)
from obsdesign.verification.impulsive_input.second_solution import FeatureCurve, second_solution
from obsdesign.verification.impulsive_input.turning import PlaneCurve
from obsdesign.verification.impulsive_input.witnesses import EqualFeatures

SOURCE = "Mattsson, Medvedev, ECC 2013, (17); Descartes' rule for Laplace transforms"
_BITS = 160
_PAIRS = 4  # pairs of features that are tried
_GRID = 200
_EFFORT = 6000  # boxes and halvings, a few seconds


def markov_parameters(D: Exact, c: Exact, H: Exact) -> list[Exact]:
    """c D^k H for k = 0..n-1, exact, each (q,)."""
    parameters, row = [], c
    for _ in range(len(D)):
        parameters.append(row @ H)
        row = row @ D
    return parameters


def decide_uniqueness(
    window: FeatureWindow, nonnegative: bool = False, budget: TimeBudget = UNLIMITED
) -> Verdict:
    """Verdict on (17) for ages in [margin, tau]; D, C, H exact, exponents floats.

    nonnegative: among weights that are not negative, of one direction.
    """
    n, m, q = len(window.D), len(window.exponents), window.H.shape[1]
    idle = fixed_vector([window.H])
    if idle is not None:
        reason = f"impulses with weights {idle} do nothing: the columns of jump.H are dependent"
        return refuted({"weights": idle, "reason": reason, "of_all_gains": True})
    if real_spectrum(window.D):
        verdict = _by_theorem(window)
        if verdict is not None:
            return verdict
    if q > 1:
        return undecided(
            f"with {q} directions the theorem is what decides: it needs a real spectrum of A - K C "
            f"and {2 * n} exponents; got {m}"
        )
    if m * len(window.C) == 1:
        return _one_feature(window)
    try:
        return _by_turning(window, nonnegative, budget)
    except ValueError as error:
        return undecided(str(error))


def _by_theorem(window: FeatureWindow) -> Verdict | None:
    """Proved where Descartes' rule decides, by one output; None elsewhere. Real spectrum."""
    D, C, H, m = window.D, window.C, window.H, len(window.exponents)
    n, q = len(D), H.shape[1]
    for j in range(len(C)):
        c = C[j : j + 1]
        moments = [entry.ravel() for entry in markov_parameters(D, c, H)]
        if q == 1:
            visible = any(entry[0] != 0 for entry in moments)
        else:
            rows = [c]
            for _ in range(n - 1):
                rows.append(rows[-1] @ D)
            visible = fixed_vector(rows) is None and fixed_vector([H]) is None
        if not visible:
            continue
        if q == 1 and m >= 2 and all(e[0] == 0 for e in moments[:-1]) and moments[-1][0] != 0:
            return proved(method="no zeros: b_i/b_j is strictly monotone", output=j + 1)
        if m >= 2 * n:
            return proved(method=f"real spectrum and {m} >= 2 n exponents", output=j + 1)
        if q == 1 and m >= n + 1 and _no_zero(D, c, H, moments, window.tau):
            return proved(method=f"real spectrum, h without zero, {m} >= n + 1", output=j + 1)
    return None


def _no_zero(D: Exact, c: Exact, H: Exact, moments: list[Exact], window: float) -> bool:
    """h(s) = c e^{D s} H has no zero on (0, window]; h ~ s^k at 0, k its relative degree."""
    n = len(D)
    k = next(i for i, entry in enumerate(moments) if entry[0] != 0)
    sign = 1 if moments[k][0] > 0 else -1
    F = np.vstack([np.hstack([D, exact(np.zeros((n, 1)))]), np.hstack([c @ D, exact([[0.0]])])])
    z = np.vstack([H, c @ H])
    with precision(_BITS):
        try:
            for i, box in enumerate(signs.boxes(F, ball(z), 0.0, window, [n])):
                p = [sign * a for a in box.rows[0]]
                if i == 0:  # divided by s^k, exactly zero coefficients in front
                    p = p[k:]
                if signs.positive(p) is not True:
                    return False
        except ValueError:
            return False
    return True


def _one_feature(window: FeatureWindow) -> Verdict:
    """A single feature: any two ages at which it does not vanish explain it equally well."""
    F = filtered_system(window.D, window.C, exact(window.exponents))
    z = np.vstack([window.H, exact([[0.0]])])
    tau = window.tau
    for part in range(1, 12):  # close to the window the signs are the same: weights may not differ
        ages = (tau, tau - (tau - window.margin) * 0.5**part)
        with precision(_BITS):
            first, second = (signs.value(F, z, age)[-1] for age in ages)
        if (first > 0 and second > 0) or (first < 0 and second < 0):
            other = float(first / second)
            reason = (
                f"one feature cannot tell two unknowns: age {ages[0]!r}, weight 1 and age "
                f"{ages[1]!r}, weight {other:.9g} leave the same; give more exponents"
            )
            return refuted(EqualFeatures(list(ages), [1.0, other], reason).to_dict())
    return undecided("a single feature, and its sign is not certain")


def _by_turning(window: FeatureWindow, nonnegative: bool, budget: TimeBudget) -> Verdict:
    """Proved where a pair of features turns one way; refuted with a second solution."""
    n, rows = len(window.D), len(window.exponents) * len(window.C)
    F = filtered_system(window.D, window.C, exact(window.exponents))
    z = np.vstack([window.H, exact(np.zeros((rows, 1)))])
    margin, tau = window.margin, window.tau
    # units of states and features change no answer, but the effort
    units = feature_units(to_float(F), n, tau)
    F, z = F * exact(units) / exact(units)[:, None], z / exact(units)[:, None]
    step = (tau - margin) / _GRID
    # from the margin on: next to the window, steps are far shorter than the way there
    flows = feature_flows(to_float(F), n, margin, step, _GRID + 1)
    b = (flows[:, n:] @ to_float(z[:n]))[:, :, 0]
    pairs = list(itertools.combinations(range(rows), 2))
    pairs.sort(key=lambda pair: -_least_turn(b, *pair))
    curve = FeatureCurve(F=F, z=z, n=n, b=b, margin=margin, tau=tau, nonnegative=nonnegative)
    place, stopped, effort = margin, "", signs.Effort(_EFFORT, budget)
    with precision(_BITS):
        for i, j in pairs[:_PAIRS]:
            back = _opposite(b, i, j, margin, step) if nonnegative else None
            try:
                plane = PlaneCurve.from_features(curve, (i, j), effort)
                turns, place = plane.turns_one_way(back)
            except ValueError as error:
                stopped = f"{error}; "
                break
            if turns:
                angle = "pi" if back is None else "2 pi, for nonnegative weights"
                return proved(method=f"a pair of features turns one way, by less than {angle}",
                              features=[i + 1, j + 1])  # fmt: skip
        verdict = second_solution(curve)
        if verdict is not None:
            return verdict
    return undecided(
        f"{stopped}no pair of features was seen to turn one way for all ages; the last one tried "
        f"fails near age {place:.6g}. With a real spectrum of A - K C, {2 * n} exponents decide",
        age=place,
        **effort.ended,
    )


def _opposite(b: Matrix, i: int, j: int, margin: float, step: float) -> float | None:
    """Age at which (b_i, b_j) is opposite to what it is at the margin, or None; floats."""
    cross = b[0, i] * b[:, j] - b[0, j] * b[:, i]
    along = b[0, i] * b[:, i] + b[0, j] * b[:, j]
    back = np.flatnonzero((cross[1:-1] * cross[2:] < 0) & (along[1:-1] < 0))
    return None if len(back) == 0 else margin + step * (float(back[0]) + 1.5)


def _least_turn(b: Matrix, i: int, j: int) -> float:
    """Least turning speed of (b_i, b_j) along the grid, signed by the majority; floats."""
    size = np.hypot(b[:, i], b[:, j])
    size = np.where(size > 0, size, 1.0)
    unit = b[:, [i, j]] / size[:, None]
    turn = unit[:-1, 0] * unit[1:, 1] - unit[:-1, 1] * unit[1:, 0]
    return float(max(turn.min(), (-turn).min()))
