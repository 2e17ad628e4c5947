"""Goals of the synthesis of interval observers, evaluated in floats.

Each goal is a function of a task and of gains (L, M) in its coordinates, the smaller the better.
"""

from __future__ import annotations

import math

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from lmi.arithmetic.spectrum import spectral_radii
from lmi.families import Edge
from obsdesign.equations.interval.width import WidthSystem, periodic_width
from obsdesign.synthesis.interval.task import Task

_POINTS = 16
_ZOOMS = 8  # 17^8: to the last digits
_TIE = 1e-6  # of equal pre-jump widths (a jump is forgotten at the next one) the least average


def _thetas(task: Task, W: Matrix, low: float) -> Matrix:
    """Return sample dwell times, denser near the shortest."""
    last = Edge(W, np.eye(len(W)), low, task.high).last
    return low + (last - low) * np.linspace(0.0, 1.0, _POINTS) ** 2


def _radii(task: Task, system: WidthSystem, low: float) -> tuple[Matrix, Matrix]:
    """(dwell times, spectral radius of e^{W theta} N at each)."""
    thetas = _thetas(task, system.W, low)
    maps = expm(system.W * thetas[:, None, None]) @ system.at_jumps[0]
    radii = spectral_radii(maps)
    return thetas, np.where(np.isnan(radii), np.inf, radii)


def growth(task: Task, L: Matrix, M: Matrix) -> float:
    """The largest spectral radius over the range (the slowest mode, where jumps may stay away)."""
    system = task.system(L, M)
    with np.errstate(all="ignore"):
        slow = float(np.linalg.eigvals(system.W).real.max())
        if system.N is None:
            return math.exp(min(slow, 700.0))
        worst = float(_radii(task, system, task.low)[1].max())
    return max(worst, math.exp(min(slow, 700.0))) if math.isinf(task.high) else worst


def mean_width(task: Task, L: Matrix, M: Matrix) -> float:
    """Return the weighted mean width at the worse end of the range; inf if it grows.

    The mean is over time; the weighted pre-jump width, if the task is about that.
    """
    system = task.system(L, M)
    if (system.N is None or task.low < task.high) and growth(task, L, M) >= 1:
        return math.inf
    with np.errstate(all="ignore"):
        settled = (
            task.weights @ np.linalg.solve(-system.W, system.f) if task.high == math.inf else 0
        )
        if system.N is None:
            return float(settled)
        N, h = system.at_jumps
        means = [float(settled)]
        for theta in {task.low, task.high} - {0.0, math.inf}:
            try:
                before, _, mean = periodic_width(system.W, N, system.f, h, theta)
            except (ValueError, np.linalg.LinAlgError):
                return math.inf
            width = before + _TIE * mean if task.pre_jump else mean
            means.append(float(task.weights @ width))
    if task.low == 0:  # jumps may follow each other at once
        try:
            means.append(float(task.weights @ np.linalg.solve(np.eye(len(N)) - N, h)))
        except np.linalg.LinAlgError:
            return math.inf
    return max(means) if all(math.isfinite(x) for x in means) else math.inf


def shortest(task: Task, L: Matrix, M: Matrix) -> float:
    """The shortest dwell time from which on all constant ones contract, in floats; inf if none.

    Where all do, the largest growth minus one, which is negative: the more room the better.
    """
    system = task.system(L, M)
    with np.errstate(all="ignore"):
        if math.isinf(task.high) and np.linalg.eigvals(system.W).real.max() >= 0:
            return math.inf
        thetas, radii = _radii(task, system, 0.0)
        bad = np.flatnonzero(radii >= 1)
        if not bad.size:
            return float(radii.max()) - 1.0
        if bad[-1] == len(thetas) - 1:
            return math.inf
        left, right = thetas[bad[-1]], thetas[bad[-1] + 1]
        for _ in range(_ZOOMS):  # many at once: each call costs more than what it computes
            finer = np.linspace(left, right, 18)
            maps = expm(system.W * finer[1:-1, None, None]) @ system.at_jumps[0]
            if not np.isfinite(maps).all():
                return math.inf
            bad = np.flatnonzero(spectral_radii(maps) >= 1)
            k = int(bad[-1]) + 1 if bad.size else 0
            left, right = finer[k], finer[k + 1]
    return float(right)
