"""Samples of a window that leave no state possible, by a dual sum of the objective zero.

A state that meets all samples makes the sum nonnegative (Farkas' lemma). The feasible set contains
that of disturbances which are constant on parts of a step: multipliers that exclude this part
nearly always exclude the whole, and are those that are evaluated.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.enclosure import TINY
from obsdesign.runtime.set_membership.condensed import Condensed
from obsdesign.runtime.set_membership.evaluation import upper_bounds
from obsdesign.runtime.set_membership.proposals import propose_contradiction
from obsdesign.runtime.set_membership.stages import Targets, Window
from obsdesign.runtime.set_membership.tape import Contradiction

# part of the largest multiplier below which a sample is not named in a contradiction
_NEGLIGIBLE_MULTIPLIER = 1e-3


def excluding_samples(window: Window, program: Condensed, steps: int) -> Contradiction | None:
    """The samples that exclude each other; None where so many steps at most give no proof."""
    own = propose_contradiction(program.least, steps)
    if not own.any():
        return None
    mu = program.by_stage(own[None], window)
    zero = Targets(np.zeros((1, window.drift.shape[1])), np.array([len(window) - 1]))
    for chosen in (without_negligible(window, mu), mu):
        if upper_bounds(window, zero, chosen)[0] < 0.0:
            return samples_with_multipliers(window, chosen)
    return None


def without_negligible(window: Window, mu: Matrix) -> Matrix:
    """Multipliers (B, stages, p), zero where those of a stage weigh next to nothing."""
    V = (window.strips[:, 1] - window.strips[:, 0]) / 2
    weight = (np.abs(mu) * (V + TINY)).sum(axis=2)
    largest = weight.max(axis=1, initial=0.0)[:, None]
    return np.where((weight > _NEGLIGIBLE_MULTIPLIER * largest)[..., None], mu, 0.0)


def samples_with_multipliers(window: Window, mu: Matrix) -> Contradiction:
    """The samples of a window with multipliers (B, stages, p) that are not zero."""
    return Contradiction(tuple(window.times[mu.any(axis=(0, 2))].tolist()))
