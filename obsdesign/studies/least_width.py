"""Widths that no observer can guarantee less than, from two states that rest apart.

Two trajectories whose difference e is constant give the same measurements for ever, if disturbances
within their bounds make up for A e and for (G - I) e at every event, and noise within its bounds
for C e. Bounds that hold for both are |e| wide, whatever the observer. The largest such e_i comes
from a linear program, and is made exact in rational numbers before it is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.balls import Exact, exact, nearest_float, pivot_columns, rational, row_echelon
from lmi.find.linear_program import minimise
from obsdesign.problem.plant import Plant

# below the rounding of the widths of bounds, and of the result
_ROUNDED_DOWN = 1 - 2.0**-50


@dataclass(frozen=True)
class Standstill:
    """All constant differences: equations @ (e, w) = 0, |w| <= widths, |C e| <= noise.

    equations (m, n + k); widths (k,) > 0; C (p, n); noise (p,) > 0: widths of the bounds of v.
    """

    equations: Matrix
    widths: Matrix
    C: Matrix
    noise: Matrix

    @cached_property
    def _echelon(self) -> tuple[Exact, list[int]]:
        """The equations in reduced row echelon form, and its pivot columns."""
        equations = exact(self.equations)
        return row_echelon(equations)[0], pivot_columns(equations)

    def exact_solution(self, near: Matrix) -> Exact:
        """A rational solution of equations @ z = 0 near a vector of floats."""
        reduced, pivots = self._echelon
        z = exact(near)
        free = [j for j in range(len(near)) if j not in pivots]
        for row, pivot in enumerate(pivots):
            z[pivot] = -sum((reduced[row, j] * z[j] for j in free), rational(0))
        return z


def least_widths(plant: Plant) -> list[float | None]:
    """For each state a width that no observer can guarantee less than; None where none is known.

    It is a lower bound, of differences that stay constant: others may show that more is needed.
    None with modes, a stated box of x, impulses or inputs without bounds, or noise without bounds.
    """
    unknown: list[float | None] = [None] * plant.n
    problem = standstill(plant)
    return unknown if problem is None else [_largest(problem, i) for i in range(plant.n)]


def standstill(plant: Plant) -> Standstill | None:
    """The constant differences that a plant allows; None as for `least_widths`."""
    flow, n = plant.flow, plant.n
    bounds = [sensor.noise_bound for sensor in plant.sensors if sensor.noise_bound is not None]
    if plant.modes or plant.state is not None or len(bounds) < len(plant.sensors):
        return None
    if flow.D is not None and flow.d_bounds is None:
        return None
    unit = np.eye(n)
    stays = flow.A if flow.dt is None else flow.A - unit
    blocks = [(stays, *flow.shaped_disturbance)]
    for event in plant.events:
        if event.H is not None:
            return None
        if event.dwell_time is not None and math.isfinite(event.dwell_time[1]):
            blocks.append((event.G - unit, *event.shaped_disturbance))
    ends = [(low, high) for _, _, low, high in blocks]
    widths = np.concatenate([high - low for low, high in ends])
    rows, first = [], 0
    for move, columns, _, _ in blocks:
        shaped = np.zeros((n, len(widths)))
        shaped[:, first : first + columns.shape[1]] = columns
        rows.append(np.hstack([move, shaped]))
        first += columns.shape[1]
    C, noise = plant.outputs.C, np.concatenate([_noise(bound) for bound in bounds])
    used = np.concatenate([np.ones(n, dtype=bool), widths > 0])
    exactly = np.hstack([C[noise == 0], np.zeros((int((noise == 0).sum()), len(widths)))])
    equations = np.vstack([*rows, exactly])[:, used]
    return Standstill(equations, widths[widths > 0], C[noise > 0], noise[noise > 0])


def _noise(bound: Matrix) -> Matrix:
    """Width of the bounds of the noise of each output, (p,)."""
    return 2 * bound if bound.ndim == 1 else bound[:, 1] - bound[:, 0]


def _largest(problem: Standstill, i: int) -> float | None:
    """The largest difference of state i, rounded down; None where there is none, or all are 0."""
    m, size = problem.equations.shape
    n, k = problem.C.shape[1], len(problem.widths)
    cost = np.zeros(size)
    cost[i] = -1.0
    limits = np.concatenate([np.full(n, np.inf), problem.widths])
    sides = np.concatenate([np.zeros(m), problem.noise])
    measured = np.hstack([problem.C, np.zeros((len(problem.C), k))])
    rows = np.vstack([problem.equations, measured])
    solution = minimise(cost, rows, (-sides, sides), (-limits, limits))
    if solution is None:
        return None
    z = problem.exact_solution(solution)
    readings = exact(problem.C) @ z[:n]
    sizes = [*zip(z[n:], problem.widths, strict=True), *zip(readings, problem.noise, strict=True)]
    scale = min((rational(float(most)) / abs(x) for x, most in sizes if x), default=rational(1))
    value = abs(z[i]) * min(scale, rational(1))
    return nearest_float(value) * _ROUNDED_DOWN if value else None
