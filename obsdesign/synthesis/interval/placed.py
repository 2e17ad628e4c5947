"""Modal coordinates of a flow with placed poles: a first answer for many states.

A - L C is in its modal coordinates diagonal but for blocks of complex pairs a +- b i, on which W
has the eigenvalues a + |b| and a - |b|. So pairs need not become real: as far left as they are
wide is enough, which moves the modes less and keeps their coordinates far better conditioned. A
jump gain that contracts at the shortest dwell time, and more at every longer one, is then one
linear program (HiGHS): zeta > 0 and M with q' e^(W low) < zeta', q' W <= 0, where
q' = zeta' |G - M C_J|; where there is none, as little above zeta' as possible. The searches over
forms take minutes for many states; this one takes seconds, and what they find is compared with it.
Poles: J. Kautsky, N. K. Nichols, P. Van Dooren, Int. J. Control 41 (1985), as in SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Indices, Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radius
from lmi.find.linear_program import minimise
from lmi.solvers import Solvers
from lmi.time_budget import Remark
from obsdesign.analysis.interval.requirements import large_gain
from obsdesign.problem.options import IntervalOptions
from obsdesign.synthesis.interval.coordinates import CoordinateChoice, scaled_columns
from obsdesign.synthesis.interval.goals import growth, mean_width
from obsdesign.synthesis.interval.task import GainSearch, Task
from obsdesign.synthesis.placement import robust_gain

# with fewer states the searches over forms are quick
FEWEST_STATES = 8
# of the width at the shortest dwell time: room for a proof; and the largest ratio of weights
_CONTRACTION, _LARGEST_WEIGHT = 0.99, 1e4
# poles that take the place of others: their least distance, in terms of the fastest
_DISTANCE = 0.02
# how much farther left than wide complex pairs are placed, in terms of the fastest
_MARGINS = (0.02, 0.1, 0.3)
# cost of an entry of q' e^(W low) above zeta'
_EXCESS = 1e4
# entries of W and its exponential beside the largest one: those that rounding leaves
_ROUNDING = 1e-9


@dataclass(frozen=True)
class PlacedGains:
    """The gains of least mean width of a few sets of poles, None where none contract.

    sets: those that were tried; growth: of the width from jump to jump, with the best of them.
    """

    choice: CoordinateChoice | None = None
    sets: int = 0
    growth: float = math.inf

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """A sentence where sets of poles were tried in vain."""
        if self.choice is not None or not self.sets or self.growth < 1:
            return ()
        why = (
            f"from jump to jump it grows {self.growth:.3g} times at least, since bounds take the "
            "absolute value of every entry"
        )
        if self.growth == math.inf:
            why = "none could be placed in floats, by gains within observer.gain_limit"
        text = (
            f"of {self.sets} sets of placed poles none has gains with which the width contracts in "
            f"its modal coordinates: {why}. Kind set_membership needs no such gains"
        )
        return (Remark(text),)


def placed_gains(search: GainSearch) -> PlacedGains:
    """Gains from placed poles, without constraints on the gains, and with L open."""
    units, best = search.units, PlacedGains()
    limit = search.problem.options_as(IntervalOptions).gain_limit
    for poles in _pole_sets(units.A) if _is_open(search) else ():
        if search.budget.remaining() < 0:
            break
        best = replace(best, sets=best.sets + 1)
        L = robust_gain(units.A, units.C, poles, rtol=1e-2)
        S = None if L is None else _modal_basis(units.A - L @ units.C)
        if L is None or S is None:
            continue
        S = units.sizes[:, None] * S
        task = search.task(False, S)
        gain, _ = task.inward(units.flow_gain(L), 0.0 * L)
        M = _jump_gain(task, gain)
        if M is None or large_gain(*task.gains(gain, M), limit):
            continue
        best = replace(best, growth=min(best.growth, growth(task, gain, M)))
        value = mean_width(task, gain, M)
        if value < (math.inf if best.choice is None else best.choice.value):
            solvers: Solvers = ("SciPy", "HiGHS") if task.open_M else ("SciPy",)
            choice = CoordinateChoice(value, S, *task.gains(gain, M), solvers=solvers)
            best = replace(best, choice=choice)
    return best


def _is_open(search: GainSearch) -> bool:
    task = search.task(False, None)
    return task.open_L and not task.is_constrained


def _pole_sets(A: Matrix) -> Iterator[NDArray[np.complexfloating]]:
    """Yield n distinct poles: those of A, moved into the sector |Im| < -Re; or real and spread."""
    n, rate = len(A), spectral_radius(A) or 1.0
    for margin in _MARGINS:
        yield _sector_poles(A, margin * rate, _DISTANCE * rate)
    yield _real_poles(A, rate) + 0j
    yield -np.linspace(0.25 * rate, 2.5 * rate, n) + 0j
    yield -np.geomspace(0.25 * rate, 2.5 * rate, n) + 0j
    yield -np.linspace(0.15 * rate, 1.5 * rate, n) + 0j
    yield -np.linspace(rate, 6.0 * rate, n) + 0j


def _sector_poles(A: Matrix, margin: float, distance: float) -> NDArray[np.complexfloating]:
    """Eigenvalues of A, moved left until Re + |Im| <= -margin; real ones a distance apart."""
    values = np.linalg.eigvals(A)
    pairs = values[values.imag > 0]
    inside = np.minimum(pairs.real, -pairs.imag - margin) + 1j * pairs.imag
    real = _apart(np.minimum(values[values.imag == 0].real, -margin), distance)
    return np.concatenate([real, inside, inside.conj()])


def _real_poles(A: Matrix, rate: float) -> Matrix:
    """Eigenvalues of A, a +- bi as a +- b, moved left of zero and then a distance apart."""
    values = np.linalg.eigvals(A)
    real = np.minimum(values.real + values.imag, -0.2 * rate)
    return _apart(real, _DISTANCE * max(float(np.abs(real).max()), rate))


def _apart(values: Matrix, distance: float) -> Matrix:
    """Values in falling order, moved down to be a distance apart."""
    result: Matrix = -np.sort(-values)
    for k in range(1, len(result)):
        result[k] = min(result[k], result[k - 1] - distance)
    return result


def _modal_basis(X: Matrix) -> Matrix | None:
    """As `eigenbasis`; of a complex eigenvector orthogonal real and imaginary parts."""
    values, vectors = np.linalg.eig(X)
    columns = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag > 0:
            turned = vector * np.exp(-0.5j * np.angle(vector @ vector))
            columns += [turned.real, turned.imag]
        elif value.imag == 0:
            columns.append(vector.real)
    return scaled_columns(np.column_stack(columns))


def _jump_gain(task: Task, L: Matrix) -> Matrix | None:
    """M in z that contracts best at the shortest dwell time; zero where it is given, or no jump.

    Unknown: zeta (n,), Z = diag(zeta) M (n, p), T >= |diag(zeta) G - Z C_J| (n, n), of which q is
    the sum of the rows, and the excess s (n,) of q' e^(W low) above zeta'. None without a solution.
    """
    none = np.zeros(L.shape)
    if task.G is None or not task.open_M:
        return none
    (n, p), G, C = L.shape, task.G, task.C_jump
    W = _without_rounding(task.system(L, none).W)
    if not np.linalg.eigvals(W).real.max() < 0:
        return None
    zeta, Z = np.arange(n), n + np.arange(n * p).reshape(n, p)
    T = n + n * p + np.arange(n * n).reshape(n, n)
    excess = n + n * p + n * n + zeta
    entries: list[tuple[Indices, Indices, Matrix]] = []
    i, j = (index.ravel() for index in np.indices((n, n)))
    for sign, first in ((1.0, 0), (-1.0, n * n)):
        row = first + np.arange(n * n)
        entries += [(row, zeta[i], sign * G[i, j]), (row, T[i, j], np.full(n * n, -1.0))]
        entries += [(row, Z[i, k], -sign * C[k, j]) for k in range(p)]
    E = _without_rounding(expm(W * task.low))
    for first, product in ((2 * n * n, E), (2 * n * n + n, W)):
        j, k = np.nonzero(product)
        entries += [(first + k, T[row, j], product[j, k]) for row in range(n)]
    above = 2 * n * n + zeta
    entries += [(above, zeta, np.full(n, -_CONTRACTION)), (above, excess, np.full(n, -1.0))]
    return _solved(entries, zeta, Z, T, excess)


def _solved(
    entries: list[tuple[Indices, Indices, Matrix]], zeta: Indices, Z: Indices, T: Indices,
    excess: Indices,
) -> Matrix | None:  # fmt: skip
    """M of the linear program with these entries of its rows, all <= 0; None without a solution."""
    n, count = len(zeta), int(excess[-1]) + 1
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    cost = np.zeros(count)
    cost[T.ravel()], cost[excess] = 1.0, _EXCESS
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    low[zeta], high[zeta], low[T.ravel()], low[excess] = 1.0, _LARGEST_WEIGHT, 0.0, 0.0
    size = 2 * n * n + 2 * n
    sides = np.full(size, -np.inf), np.zeros(size)
    x = minimise(cost, (row, column, value), sides, (low, high))
    return None if x is None else x[Z] / x[zeta][:, None]


def _without_rounding(X: Matrix) -> Matrix:
    """X without entries that rounding leaves beside the largest one."""
    return np.where(np.abs(X) > _ROUNDING * np.abs(X).max(), X, 0.0)
