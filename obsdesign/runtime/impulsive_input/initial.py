"""A record before its first row that counts, and how large its states may be there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import exponential_grid
from obsdesign.runtime.impulsive_input.plant import HeldPlant
from obsdesign.runtime.state_marks import Inputs, Past, Square, States

# of |C| |x| after an impulse: an output that shows less shows rounding
_LEAST_SHOWN = 1e-9
_AGES = 64  # of a window, at which states are looked at


@dataclass(frozen=True, slots=True)
class Initial:
    """The estimate x at t, and the input u from then on; first: time of the first row, if any.

    covariance: of the estimate at time `since`, None where the design has none.
    """

    t: float
    x: States
    u: Inputs
    covariance: Square | None
    since: Past
    first: Past | None = None


def largest_outputs(C: Matrix, states: Matrix) -> Matrix:
    """Largest outputs (p, q) of states (k, n, q) that impulses leave; zero where rounding alone."""
    shown = np.abs(C @ states).max(axis=0)
    return np.where(shown > _LEAST_SHOWN * (np.abs(C) @ np.abs(states)).max(axis=0), shown, 0.0)


def impulse_sizes(C: Matrix, states: Matrix, outputs: Matrix) -> Matrix:
    """States (n,) of an impulse as large as some output needs, of outputs (p,).

    states (k, n, q): what impulses of weight 1 leave. Zero of those that no impulse reaches.
    """
    shown = largest_outputs(C, states)
    reached = shown > 0
    weights = np.where(reached, outputs[:, None], 0.0) / np.where(reached, shown, 1.0)
    return np.asarray((np.abs(states) * weights.max(axis=0)).max(axis=(0, 2)))


def initial_sizes(plant: HeldPlant, tau: float, outputs: Matrix) -> Matrix:
    """States (n,) at first that may leave outputs of sizes (p,) within a time tau.

    As large as an impulse leaves them, or as each of them shows by itself: a bias of a sensor or a
    constant feed is reached by no impulse. Zero of those that no output shows but for rounding.
    """
    flows = exponential_grid(plant.A, 0.0, tau / _AGES, _AGES + 1)
    shown = largest_outputs(plant.C, flows)
    alone = np.where(shown > 0, outputs[:, None], 0.0) / np.where(shown > 0, shown, 1.0)
    sizes = impulse_sizes(plant.C, flows @ plant.H, outputs)
    return np.asarray(np.maximum(alone.max(axis=0), sizes))
