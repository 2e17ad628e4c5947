"""Finite-time estimation in discrete time: the state from the samples of one window.

    x_hat = phi + sum over i of W_i (y_i - C phi_i),   i = 0 ... k-1,   samples N steps apart

phi is the response of the plant to known inputs from zero at the first sample of the window, phi_i
at sample i, phi at the last one, about which the estimate is. The error is linear in the state at
the first sample, in b of every step and in the noise:

    q_T = W_{k-1} C - I,   q_{t-1} = q_t A + W_i C     at step t - 1 of sample i, T = (k - 1) N
    x_hat - x = q_0 x_0 + sum over the steps of q_{t+1} b_t + sum of W_i v_i
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmi.arithmetic.arrays import Array, NewEntries
from obsdesign.equations.gains import PlantGains, plant_data
from obsdesign.equations.plant import Plant
from obsdesign.equations.stored import count, matrix, number
from obsdesign.equations.time_grid import steps_of


@dataclass(frozen=True, kw_only=True, eq=False)
class StepWindowGains(PlantGains):
    """window_gain (n, k p): W_0 ... W_{k-1} for k = `samples` samples, `period` apart."""

    period: float = number()
    samples: int = count()
    window_gain: Array = matrix("n", "window")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dt is None or not steps_of(self.period, self.dt):
            raise ValueError("gains.period must be a multiple of gains.dt.")
        if self.window_gain.shape[1] != self.samples * self.p:
            raise ValueError("gains.window_gain must have one column for each output of a sample.")

    @property
    def period_steps(self) -> int:
        """Steps from sample to sample."""
        return steps_of(self.period, self.step) or 1

    @property
    def of_samples(self) -> Array:
        """(k, n, p): the gain of each sample, oldest first."""
        return np.stack(np.hsplit(self.window_gain, self.samples))


def window_entries(plant: Plant) -> NewEntries:
    """The plant's numbers that a design stores."""
    return plant_data(plant) | {"period": plant.output.period}


def observation_rows(A: Array, C: Array, steps: int, samples: int) -> Array:
    """(k p, n): the samples of a window from the state at the first; floats or exact."""
    rows, row = [C], C
    for _ in range(samples - 1):
        for _ in range(steps):
            row = row @ A
        rows.append(row)
    return np.vstack(rows)


def error_maps(A: Array, C: Array, W: Array, steps: int) -> list[Array]:
    """q_0 ... q_T (n, n) each: of the state at the first sample, then of b of every step.

    W (k, n, p): gains of the samples; floats or exact.
    """
    q = W[-1] @ C - np.eye(len(A), dtype=int)
    maps = [q]
    for i in range(len(W) - 2, -1, -1):
        for _ in range(steps):
            q = q @ A
            maps.append(q)
        maps[-1] = q = q + W[i] @ C
    return maps[::-1]


def cancelled_terms(A: Array, C: Array, W: Array, steps: int) -> Array:
    """Size of the terms that cancel in q_0, (n, n)."""
    return np.asarray(abs(error_maps(abs(A), abs(C), -abs(W), steps)[0]))
