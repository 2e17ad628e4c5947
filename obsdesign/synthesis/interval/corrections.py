"""Gains that take the measured part of an uncertain effect from the measurement.

Of A_i x, Q_i (y - C m) is known, and R_i = A_i - Q_i C is left to the radius; likewise T_i of G_i.
Any gains are sound, so that nothing of a choice needs proof: each row of Q_i is the least sum of
|R_i| over states and |Q_i| over outputs, in units of the states and of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmi.arithmetic.arrays import Matrix, NewEntries
from lmi.find.linear_program import minimise
from obsdesign.equations.interval.gains import IntervalGains


def corrections(gains: IntervalGains, measured: str, sizes: Matrix, noise: Matrix) -> NewEntries:
    """Entries of a design: flow_correction, jump_correction (q, n, p), without those of zeros.

    sizes (n,), noise (p,): typical magnitudes of the states, and of the noise.
    """
    if measured == "periodic":  # A and G alone predict there
        return {}
    listed = {}
    if measured == "continuous":
        listed["flow_correction"] = [effect.A for effect in gains.effects]
    if gains.jump_measurement == "before":
        listed["jump_correction"] = [effect.G for effect in gains.effects]
    entries = {name: _of_effects(gains, effects, sizes, noise) for name, effects in listed.items()}
    return {name: values for name, values in entries.items() if values.any()}


def _of_effects(
    gains: IntervalGains, effects: Sequence[Matrix | None], sizes: Matrix, noise: Matrix
) -> Matrix:
    """Gains for each effect, (q, n, p); zeros where there is none."""
    S = np.eye(gains.n) if gains.S is None else gains.S
    C, units = gains.C @ S, np.abs(np.linalg.inv(S)) @ sizes
    zero = np.zeros((gains.n, gains.p))
    rows = [
        zero
        if effect is None
        else np.array([_row(row, C, units, noise) for row in np.linalg.solve(S, effect @ S)])
        for effect in effects
    ]
    return np.array(rows).reshape(len(rows), gains.n, gains.p)


def _row(row: Matrix, C: Matrix, units: Matrix, V: Matrix) -> Matrix:
    """Return q (p,) of least |row - q C| in units plus |q| V."""
    p, n = C.shape
    if not row.any():
        return np.zeros(p)
    cost = np.concatenate([np.zeros(p), np.ones(n), V])
    # s >= |(row - q C) units|, t >= |q|
    left = np.vstack([(C * units).T, -(C * units).T, np.eye(p), -np.eye(p)])
    slack = np.zeros((2 * n + 2 * p, n + p))
    slack[:n, :n] = slack[n : 2 * n, :n] = np.eye(n)
    slack[2 * n : 2 * n + p, n:] = slack[2 * n + p :, n:] = np.eye(p)
    low = np.concatenate([row * units, -row * units, np.zeros(2 * p)])
    sides = (low, np.full(len(low), np.inf))
    bounds = (np.append(np.full(p, -np.inf), np.zeros(n + p)), np.full(n + 2 * p, np.inf))
    best = minimise(cost, np.hstack([left, slack]), sides, bounds)
    return np.zeros(p) if best is None else best[:p] + 0.0
