"""Coordinates for interval observers: bases with few wrong signs in flow and jump.

Candidates are eigenvectors of the flow A - L C for a few L, and bases of the same kind adapted to
the kernel of the jump. Gains are then sought in each (`descent`), and the best bases are
improved by a simplex search over the entries of S with the gains inside, of bounded effort.
Source: Degue, Efimov, Richard, NOLCOS 2016, the remark after Theorem 8; S is proved like any gain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lmi.arithmetic.arrays import Array, Entries, Matrix
from lmi.arithmetic.spectrum import spectral_radius
from lmi.solvers import Solvers, merged
from lmi.time_budget import Remark, ended_by_count, remark_end
from obsdesign.analysis.balancing import BalancedPlant
from obsdesign.equations.interval.splits import flow_and_jump
from obsdesign.problem.plant import Plant
from obsdesign.synthesis.interval.descent import best_gains, quick_gains, solvers_of_gains
from obsdesign.synthesis.interval.task import GainSearch
from obsdesign.synthesis.placement import riccati_gain

# a basis closer to a singular one than this costs more digits in its inverse than it can gain
_WORST_CONDITION = 1e6
# evaluations of a search, and with more states than that their number times n^3
_EVALUATIONS, _LARGE, _EVALUATION_WORK = 60, 4, 2500
# bases, and their number times n^3
_MOST_BASES, _BASES_WORK = 8, 8000
_SUFFICIENT_GROWTH = 0.9  # the largest growth from jump to jump that is good enough


@dataclass(frozen=True)
class CoordinateChoice:
    """Coordinates with their gains in the plant's coordinates; value as in `descent.best_gains`."""

    value: float
    S: Matrix
    L: Matrix
    M: Matrix
    remarks: tuple[Remark, ...] = ()
    solvers: Solvers = ()


@dataclass(frozen=True)
class CoordinateSearch:
    """A search for coordinates, the open gains in each of them chosen by another search."""

    gains: GainSearch

    def best(self, *, improve: bool, with_own: bool = False) -> CoordinateChoice:
        """Return the best of the bases, improved by a simplex search if `improve`.

        with_own: of the plant's own coordinates too, where no other form has tried them.
        """
        choices: list[CoordinateChoice] = []
        count = self.gains.budget.scaled(_BASES_WORK) // self.gains.problem.plant.n**3
        for S in itertools.islice(_bases(self.gains), min(max(count, 1), _MOST_BASES)):
            if choices and self.gains.budget.remaining() < 0:
                break
            choices.append(self._with_quick_gains(S))
            if self._is_sufficient(choices[-1]):
                return choices[-1]
        best = min(choices, key=lambda choice: choice.value)
        remarks, solvers = tuple[Remark, ...](), best.solvers
        if improve:
            best, remarks = self._improved(best)
            solvers = merged(solvers, ("SciPy",))
        if not self._is_sufficient(best):
            remarks += self._remark(self.gains.budget.ended())
        own = np.diag(self.gains.units.sizes)
        thorough = [self._with_best_gains(S) for S in ((best.S, own) if with_own else (best.S,))]
        chosen = min(best, *thorough, key=lambda choice: choice.value)
        remarks += tuple(remark for choice in thorough for remark in choice.remarks)
        return replace(chosen, remarks=remarks, solvers=solvers)

    def _remark(self, end: Entries) -> tuple[Remark, ...]:
        return remark_end("coordinates", end, matters=self.gains.objective != "feasible")

    def _is_sufficient(self, choice: CoordinateChoice) -> bool:
        """Is a further search of no use to the objective?"""
        if self.gains.objective == "narrowest":
            return False
        limit = _SUFFICIENT_GROWTH
        return choice.value <= (limit if self.gains.objective == "feasible" else limit - 1.0)

    def _with_quick_gains(self, S: Matrix) -> CoordinateChoice:
        task = self.gains.task(False, S)
        value, L, M = quick_gains(task, self.gains.objective, self.gains.budget)
        return CoordinateChoice(value, S, *task.gains(L, M), solvers=solvers_of_gains(task))

    def _with_best_gains(self, S: Matrix) -> CoordinateChoice:
        task = self.gains.task(False, S)
        (value, L, M), remarks = best_gains(task, self.gains.objective, self.gains.budget)
        return CoordinateChoice(value, S, *task.gains(L, M), remarks, solvers_of_gains(task))

    def _improved(self, start: CoordinateChoice) -> tuple[CoordinateChoice, tuple[Remark, ...]]:
        """The best of a Nelder-Mead search over S, gains from a small program for each."""
        n, units = self.gains.problem.plant.n, self.gains.units.sizes
        best, first = [start], scaled_columns(start.S / units[:, None])
        if first is None:  # at the border of what is singular
            return start, ()

        def value(entries: Matrix) -> float:
            if self._is_sufficient(best[0]) or self.gains.budget.remaining() < 0:
                return best[0].value
            S = scaled_columns(entries.reshape(n, n))
            if S is None:
                return math.inf
            choice = self._with_quick_gains(units[:, None] * S)
            best[0] = min(best[0], choice, key=lambda each: each.value)
            return min(choice.value, 1e30)

        from scipy.optimize import minimize  # slow to import, and rarely needed

        most = _EVALUATIONS if n <= _LARGE else max(_EVALUATION_WORK // n**3, 1)
        effort = self.gains.budget.scaled(most)
        with np.errstate(all="ignore"):
            result = minimize(
                value, first.ravel(), method="Nelder-Mead",
                options={"maxfev": effort, "initial_simplex": _simplex(first)},
            )  # fmt: skip
        if result.nfev >= effort and not self._is_sufficient(best[0]):
            return best[0], self._remark(ended_by_count("evaluations", effort))
        return best[0], ()


def _simplex(S: Matrix) -> Matrix:
    corners = np.tile(S.ravel(), (S.size + 1, 1))
    corners[1:] += 0.15 * np.eye(S.size)
    return corners


def _bases(gains: GainSearch) -> Iterator[Matrix]:
    """Yield candidates for S, without repetition; the plant's own coordinates if there are none."""
    plant, yielded = gains.problem.plant, list[Matrix]()
    for L in _flow_gains(gains):
        M = gains.given.get("M", np.zeros((plant.n, plant.p)))
        for S in bases(plant, L, M, gains.units):
            own = S / gains.units.sizes[:, None]
            if not any(np.allclose(own, other) for other in yielded):
                yielded.append(own)
                yield S
    if not yielded:  # eigenvectors of a defective matrix are dependent: a search starts here
        yield np.diag(gains.units.sizes)


def _flow_gains(gains: GainSearch) -> Iterator[Matrix]:
    """Yield L as given; else zero and a few of growing speed."""
    if "L" in gains.given:
        yield gains.given["L"]
        return
    plant, units = gains.problem.plant, gains.units
    yield np.zeros((plant.n, plant.p))
    speed = spectral_radius(units.A)
    for factor in (0.0, 1.0, 4.0):
        try:
            yield units.flow_gain(riccati_gain(units.A, units.C, None, factor * speed))
        except np.linalg.LinAlgError:  # no finite solution in floats: not this one
            continue


def bases(plant: Plant, L: Array, M: Array, units: BalancedPlant) -> list[Matrix]:
    """Return eigenvectors of the flow, of the jump, and a mixture with the kernel of the jump.

    Each in balanced units, in which their entries and their independence are judged.
    """
    F, H = flow_and_jump(
        plant.flow.A, plant.output.C, None if plant.jump is None else plant.jump.G, L=L, M=M,
        jump_measurement=plant.output.jump_measurement,
        is_periodic=plant.output.measured == "periodic",
    )  # fmt: skip
    F = units.map(F)
    candidates = [eigenbasis(F)]
    if H is not None:
        H = units.map(H)
        candidates += [eigenbasis(H), adapted_basis(F, H)]
    return [units.sizes[:, None] * S for S in candidates if S is not None]


def eigenbasis(X: Matrix) -> Matrix | None:
    """Real basis of eigenvectors of X, largest entries 1; None if it is nearly singular.

    Real eigenvectors make S^-1 X S diagonal; a complex pair gives its real and imaginary part.
    """
    values, vectors = np.linalg.eig(X)
    columns = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag > 0:
            columns += [vector.real, vector.imag]
        elif value.imag == 0:
            columns.append(vector.real)
    return scaled_columns(np.column_stack(columns))


def adapted_basis(F: Matrix, H: Matrix) -> Matrix | None:
    """Kernel of H first, then eigenvectors of F that are independent of it."""
    _, sizes, rows = np.linalg.svd(H)
    kernel = rows[sizes <= 1e-10 * max(float(sizes[0]), 1e-300)].T
    if not kernel.shape[1]:
        return None
    full = eigenbasis(F)
    columns = list(kernel.T)
    for column in () if full is None else full.T:
        trial = np.column_stack([*columns, column])
        if len(columns) < len(F) and np.linalg.svd(trial, compute_uv=False)[-1] > 1e-3:
            columns.append(column)
    return scaled_columns(np.column_stack(columns)) if len(columns) == len(F) else None


def scaled_columns(S: Matrix) -> Matrix | None:
    """Columns divided by their largest entry, digits beyond 2**-40 dropped; None if singular."""
    with np.errstate(all="ignore"):
        scaled = S / np.abs(S).max(axis=0)
        short: Matrix = np.round(scaled * 2.0**40) / 2.0**40
    if not np.isfinite(short).all() or np.linalg.cond(short) > _WORST_CONDITION:
        return None
    return short
