"""Windows and weights of impulsive observers that keep noise below a target, by estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from obsdesign.analysis.impulsive_noise import missed, noise_of, simulated
from obsdesign.problem.problem import Problem

Matrix = NDArray[np.float64]

# windows up to so many times the shortest, alpha from nearly 1 to hardly a memory
_LONGEST, _SLOWEST, _FASTEST, _HALVINGS = 16, 1.02, 8.0, 12


def quiet_enough(
    problem: Problem, gains: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The shortest window, and the largest alpha, whose estimated errors meet noise_target.

    Window and alpha are kept where they are given, alpha also where a decay rate fixes it. Returns
    the gains and, where the target is missed, what was reached.
    """
    target = np.array(problem.options["noise_target"])
    noise, fixed = noise_of(problem), {"alpha", "decay_rate"} & set(problem.options)
    slow = float(gains["alpha"]) if fixed else _SLOWEST
    shortest = int(gains["window"])
    longest = shortest if "window" in problem.options else _LONGEST * shortest

    def std(window: int, alpha: float) -> Matrix:
        return simulated(dict(gains) | {"window": window, "alpha": alpha}, noise).std

    window = shortest
    while not np.all(std(window, slow) <= target):
        if window >= longest:
            best = dict(gains) | {"window": window, "alpha": slow}
            return best, missed(problem, best)
        window += 1
    if fixed:
        return dict(gains) | {"window": window}, {}
    fast = _FASTEST
    for _ in range(_HALVINGS):
        middle = math.sqrt(slow * fast)
        if np.all(std(window, middle) <= target):
            slow = middle
        else:
            fast = middle
    return dict(gains) | {"window": window, "alpha": slow}, {}
