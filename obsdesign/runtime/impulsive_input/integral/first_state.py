"""State at the first rows of a record, where its first window shows no impulse.

The covariance of an error that is not known at first dies out no faster than A - K C: until then it
hides weak impulses from features of one window, though the rows before tell the state. So the state
is fitted to the samples of half a window, a sum of squares with the covariance at first as prior,
and the search begins there. Impulses in the other half are still to come for it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.runtime.impulsive_input.integral.evaluate import Evaluator, Window
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun, Track
from obsdesign.runtime.impulsive_input.integral.recursions import accumulated
from obsdesign.runtime.impulsive_input.significance import LEAST_DEVIATIONS, LEAST_SHARE_OF_GAIN
from obsdesign.runtime.impulsive_input.whitening import chi_squared_limit


class FirstState(NamedTuple):
    """Estimates x (k + 1, n) at rows 0 .. k, and the covariance (n, n) of the error at row k.

    The last one takes in its own sample as the observer does; covariance: without that.
    """

    x: Matrix
    covariance: Matrix


def first_state(run: FreeRun, track: Track, row: int, spread: Matrix, root: Matrix) -> FirstState:
    """The state that the samples before a row show; spread (row, p): their deviations.

    root (n, n): F of the covariance F F' of the error at the first row.
    """
    times, C = track.t[: row + 1], run.gains.C
    free = np.empty((row + 1, run.gains.n))
    free[0] = track.x[0]
    for a, b, h in run.runs(times):
        flow, once, _ = run.plant.step(h)
        free[a + 1 : b + 1] = accumulated(flow, track.forcing[a:b] @ once.T, free[a])
    moves = expm(run.gains.A * (times - times[0])[:, None, None]) @ root
    shown = (C @ moves[:-1] / spread[:, :, None]).reshape(spread.size, -1)
    white = ((track.y[:row] - free[:-1] @ C.T) / spread).reshape(-1)
    Q, upper = np.linalg.qr(np.vstack([shown, np.eye(len(root))]))
    x = free + moves @ np.linalg.solve(upper, Q[: len(white)].T @ white)
    newer = run.maps(run.runs(times)[-1][2]).newer
    x[-1] += newer @ (track.y[row] - C @ x[-1])
    left = np.linalg.solve(upper.T, moves[-1].T).T
    left = left - newer @ C @ left
    return FirstState(x, left @ left.T)


def has_none(evaluator: Evaluator, window: Window, P: Matrix) -> bool:
    """Whether a window in noise is explained without an impulse; P (n, n): of the error at t_o."""
    R = evaluator.noise(window, P).features.R
    return float(R @ R) <= min(chi_squared_limit(len(R)), LEAST_DEVIATIONS**2)


def confused_until(evaluator: Evaluator, window: Window, P: Matrix) -> float:
    """Time until which an impulse passes for an error of the state at first.

    P (n, n): covariance of that error. Minus infinity where there are no such times, and where the
    residual of the window is noise: then it has neither.
    """
    unknown, known = (evaluator.noise(window, each) for each in (P, np.zeros_like(P)))
    if float(known.features.R @ known.features.R) <= chi_squared_limit(len(known.features.R)):
        return -math.inf
    shown = known.responses.onsets[1:] @ evaluator.gains.H
    gains = [((noise.features.T @ shown) ** 2).sum(axis=1) for noise in (unknown, known)]
    is_confused = (gains[0] < LEAST_SHARE_OF_GAIN * gains[1]).any(axis=1)
    rows = int(np.argmin(np.append(is_confused, False)))
    return float(window.t[rows]) if rows else -math.inf
