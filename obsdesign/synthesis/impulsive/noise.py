"""Windows and weights of impulsive observers that keep noise below a target, by estimate."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from obsdesign.analysis.impulsive_noise import missed_target, noise_of, simulated
from obsdesign.equations.impulsive.gains import ImpulsiveGains
from obsdesign.problem.options import ImpulsiveOptions
from obsdesign.problem.problem import Problem

# windows up to so many times the shortest, alpha from nearly 1 to hardly a memory
_LONGEST, _SLOWEST, _FASTEST, _HALVINGS = 16, 1.02, 8.0, 12


def quiet_enough(problem: Problem, gains: ImpulsiveGains) -> tuple[ImpulsiveGains, NewEntries]:
    """The shortest window, and the largest alpha, whose estimated errors meet noise_target.

    Window and alpha are kept where they are given, alpha also where a decay rate fixes it. Returns
    the gains and, where the target is missed, the evidence of it.
    """
    options, noise = problem.options_as(ImpulsiveOptions), noise_of(problem)
    target = np.array(options.noise_target)
    fixed = options.is_stated("alpha") or options.is_stated("decay_rate")
    slow = gains.window_weight if fixed else _SLOWEST
    shortest = gains.window_length
    longest = _LONGEST * shortest if options.window is None else shortest

    def std(window: int, alpha: float) -> Matrix:
        return simulated(replace(gains, window=window, alpha=alpha), noise).std

    window = shortest
    while not np.all(std(window, slow) <= target):
        if window >= longest:
            best = replace(gains, window=window, alpha=slow)
            return best, missed_target(problem, best)
        window += 1
    if fixed:
        return replace(gains, window=window), {}
    fast = _FASTEST
    for _ in range(_HALVINGS):
        middle = math.sqrt(slow * fast)
        if np.all(std(window, middle) <= target):
            slow = middle
        else:
            fast = middle
    return replace(gains, window=window, alpha=slow), {}
