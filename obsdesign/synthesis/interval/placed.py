"""Coordinates of eigenvectors of a flow with real poles: a first answer for many states.

A - L C with real distinct poles is diagonal in its eigenvectors, so that W is, and e^(W theta)
falls with theta. A jump gain that contracts at the shortest dwell time is then one linear program
(HiGHS): zeta > 0 and M with zeta' |G - M C_J| < zeta' e^(-W low). The searches over forms take
minutes for many states; this one takes a second, and what they find is compared with it.
Poles: J. Kautsky, N. K. Nichols, P. Van Dooren, Int. J. Control 41 (1985), as in SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.spectrum import spectral_radius
from lmi.find.linear_program import minimise
from lmi.solvers import Solvers
from obsdesign.analysis.interval.requirements import large_gain
from obsdesign.problem.options import IntervalOptions
from obsdesign.synthesis.interval.coordinates import CoordinateChoice, eigenbasis
from obsdesign.synthesis.interval.goals import mean_width
from obsdesign.synthesis.interval.task import GainSearch, Task, balanced_units
from obsdesign.synthesis.placement import robust_gain

# with fewer states the searches over forms are quick
FEWEST_STATES = 8
# of the width at the shortest dwell time: room for a proof; and the largest ratio of weights
_CONTRACTION, _LARGEST_WEIGHT = 0.99, 1e4
# poles that take the place of others: their least distance, in terms of the fastest
_DISTANCE = 0.02


def placed_choice(search: GainSearch) -> CoordinateChoice | None:
    """The gains of least mean width of a few sets of real poles; None where none contract.

    Without constraints on the gains, and with L open.
    """
    units, best = balanced_units(search.problem), None
    limit = search.problem.options_as(IntervalOptions).gain_limit
    for poles in _pole_sets(units.A) if _is_open(search) else ():
        if search.budget.remaining() < 0:
            break
        L = robust_gain(units.A, units.C, poles, rtol=1e-2)
        S = None if L is None else eigenbasis(units.A - L @ units.C)
        if L is None or S is None:
            continue
        S = units.sizes[:, None] * S
        task = search.task(False, S)
        gain, _ = task.inward(units.flow_gain(L), 0.0 * L)
        M = _jump_gain(task, gain)
        if M is None or large_gain(*task.gains(gain, M), limit):
            continue
        value = mean_width(task, gain, M)
        if value < (math.inf if best is None else best.value):
            solvers: Solvers = ("SciPy", "HiGHS") if task.open_M else ("SciPy",)
            best = CoordinateChoice(value, S, *task.gains(gain, M), solvers=solvers)
    return best


def _is_open(search: GainSearch) -> bool:
    task = search.task(False, None)
    return task.open_L and not task.is_constrained


def _pole_sets(A: Matrix) -> Iterator[Matrix]:
    """Yield n real negative distinct poles: near those of A, or evenly spread, ever faster."""
    n, rate = len(A), spectral_radius(A) or 1.0
    values = np.linalg.eigvals(A)
    own = np.sort(np.minimum(values.real + values.imag, -0.2 * rate))  # a +- bi: a +- b
    gap = _DISTANCE * max(float(np.abs(own).max()), rate)
    for k in range(n - 2, -1, -1):
        own[k] = min(own[k], own[k + 1] - gap)
    yield own
    yield -np.linspace(0.25 * rate, 2.5 * rate, n)
    yield -np.geomspace(0.25 * rate, 2.5 * rate, n)
    yield -np.linspace(0.15 * rate, 1.5 * rate, n)
    yield -np.linspace(rate, 6.0 * rate, n)


def _jump_gain(task: Task, L: Matrix) -> Matrix | None:
    """M in z that contracts at the shortest dwell time, if it is open; None where there is none.

    Unknown: zeta (n,), Z = diag(zeta) M (n, p), T >= |diag(zeta) G - Z C_J| (n, n).
    """
    none = np.zeros(L.shape)
    if task.G is None or not task.open_M:
        return none
    (n, p), G, C = L.shape, task.G, task.C_jump
    decay = np.diag(L @ task.C - task.A)
    if not (decay > 0).all():
        return None
    zeta, T = np.arange(n), n + n * p + np.arange(n * n).reshape(n, n)
    Z = n + np.arange(n * p).reshape(n, p)
    entries: list[tuple[Indices, Indices, Matrix]] = []
    i, j = (index.ravel() for index in np.indices((n, n)))
    for sign, first in ((1.0, 0), (-1.0, n * n)):
        row = first + np.arange(n * n)
        entries += [(row, zeta[i], sign * G[i, j]), (row, T[i, j], np.full(n * n, -1.0))]
        entries += [(row, Z[i, k], -sign * C[k, j]) for k in range(p)]
    entries += [(2 * n * n + j, T[i, j], np.ones(n * n))]
    entries += [(2 * n * n + zeta, zeta, -_CONTRACTION * np.exp(decay * task.low))]
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    cost, size = np.zeros(n + n * p + n * n), 2 * n * n + n
    cost[T.ravel()] = 1.0
    low, high = np.full(len(cost), -np.inf), np.full(len(cost), np.inf)
    low[zeta], high[zeta], low[T.ravel()] = 1.0, _LARGEST_WEIGHT, 0.0
    sides = np.full(size, -np.inf), np.zeros(size)
    x = minimise(cost, (row, column, value), sides, (low, high))
    return None if x is None else x[Z] / x[zeta][:, None]
