"""Objective `least_noise` of finite-time estimation: L with small gains, and the window.

Longer windows average more noise and collect more disturbance. The window is judged by the gains
of least squares, which under noise alone no unbiased gains beat; L by the gains it leads to. The
search for L ends after some evaluations with the best so far. Floats only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm, exponential_grid, flow_integrals
from lmi.solvers import Solvers
from lmi.time_budget import Remark, TimeBudget, ended_by_count, remark_end
from obsdesign.analysis.finite_time.requirements import relative_deviations
from obsdesign.equations.finite_time.formulas import (
    approximate_terms,
    difference_block,
    discrete_injection,
    exact_terms,
    series_steps,
    window_matrix,
)
from obsdesign.equations.finite_time.rows import least_squares_gain, sample_rows
from obsdesign.problem.plant import Plant

# of the gains, in the search for L
_EVALUATIONS = 1000
# the shortest window is taken whose error is at most this much larger than the best
_LARGEST_RATIO = 1.1


def low_noise_samples(plant: Plant, counts: list[int]) -> int:
    """The first of these windows with every state's error close to the least of all windows."""
    errors = np.array([_errors(plant, k) for k in counts])
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.nanmin(np.where(errors > 0, errors, np.nan), axis=0)
        worst = np.nanmax(np.where(errors > 0, errors / least, 1.0), axis=1)
    good = worst <= _LARGEST_RATIO * worst.min()
    return counts[int(np.argmax(good))]


def _errors(plant: Plant, k: int) -> Matrix:
    """Errors (n,) of least squares under noise and disturbance of the plant's sizes."""
    A, C, period = plant.flow.A, plant.output.C, plant.output.sample_period
    deviations = relative_deviations(plant.output)
    rows = sample_rows(A, C, period, k).reshape(-1, len(A))
    if not np.isfinite(rows).all():
        return np.full(len(A), np.inf)
    gain = least_squares_gain(rows, np.tile(deviations, k))
    noise = plant.output.noise_radius
    Delta = np.subtract(*plant.flow.b_bounds[::-1]) / 2
    noise = np.zeros(len(C)) if noise is None else noise
    if not np.any(noise) and not np.any(Delta):
        return np.asarray(np.linalg.norm(gain * np.tile(deviations, k), axis=1))
    error = np.abs(gain) @ np.tile(noise, k)
    back, half = expm(-A * period), expm(-A * period / 2)
    R = np.zeros_like(A)
    for term in gain.reshape(len(A), k, len(C)).transpose(1, 0, 2):
        R = R @ back + term @ C
        error = error + np.abs(R @ half) @ Delta * period
    return np.asarray(error)


def low_noise_injection(
    plant: tuple[Matrix, Matrix],
    L: Matrix,
    samples: tuple[float, int],
    method: str,
    budget: TimeBudget,
) -> tuple[Matrix, tuple[Remark, ...], Solvers]:
    """L with the least Frobenius norm of the gains, from a first guess and larger ones.

    plant: A, C; samples: period and number of samples of the window. Beside L the remarks of the
    search, and the solvers that led to an L other than the first.
    """
    from scipy.optimize import minimize

    gain = _exact_gain if method == "exact" else _approximate_gain
    (A, C), limit = plant, budget.scaled(_EVALUATIONS)
    sizes = _GainSizes(lambda L: gain(A, C, L, *samples), L, limit, budget)
    reach = float(np.linalg.norm(A, 2)) / float(np.linalg.norm(C, 2))
    unit, remarks = L / np.linalg.norm(L), tuple[Remark, ...]()
    try:
        guesses = [L, *(unit * reach * factor for factor in (0.1, -0.1, 1.0, -1.0))]
        for x in sorted(guesses, key=lambda x: sizes.cost(x.reshape(-1))):
            minimize(sizes.cost, x.reshape(-1), method="Nelder-Mead")
    except _BudgetEnded:
        end = budget.ended() or ended_by_count("evaluations", limit)
        remarks = remark_end("a quiet L", end)
    return sizes.best, remarks, () if np.array_equal(sizes.best, L) else ("SciPy",)


class _BudgetEnded(Exception):
    """The time or the evaluations of a search have ended."""


@dataclass
class _GainSizes:
    """Frobenius norms of the gains of L, and the L of the least one so far.

    gain: L -> gains; left: evaluations before the search ends.
    """

    gain: Callable[[Matrix], Matrix]
    best: Matrix
    left: int
    budget: TimeBudget
    least: float = math.inf

    def cost(self, x: Matrix) -> float:
        """The norm for L = x, flat; 1e300 where there is none. _BudgetEnded at the end."""
        self.left -= 1
        if self.left < 0 or self.budget.remaining() < 0:
            raise _BudgetEnded
        L = x.reshape(self.best.shape)
        with np.errstate(all="ignore"):
            try:
                size = float(np.linalg.norm(self.gain(L)))
            except np.linalg.LinAlgError:
                return 1e300
        if size < self.least:
            self.best, self.least = L.copy(), size
        return size if math.isfinite(size) else 1e300


def _exact_gain(A: Matrix, C: Matrix, L: Matrix, period: float, k: int) -> Matrix:
    m = series_steps(A, C, L, period)
    backs = exponential_grid(-A, 0.0, period / m, m)
    steps = [(back, 0.0) for back in backs]
    forward = expm(A * period)
    K_d = forward @ discrete_injection(A, C, L, period / m, steps)
    terms = exact_terms(forward + K_d @ C, K_d, k)
    W = window_matrix(terms)
    rows = sample_rows(A, C, period, k).reshape(-1, len(A))
    return np.asarray(np.linalg.solve(W @ rows, W))


def _approximate_gain(A: Matrix, C: Matrix, L: Matrix, period: float, k: int) -> Matrix:
    n = len(A)
    back, once = flow_integrals(-(A + L @ C), period)
    whole = expm(difference_block(A, L @ C) * (k * period))
    terms = approximate_terms(back, once @ L, k)
    return np.asarray(np.linalg.solve(whole[:n, n:], window_matrix(terms)))
