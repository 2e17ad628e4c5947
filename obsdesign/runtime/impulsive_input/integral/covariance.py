"""Covariance of the error of a free run: initial value, and growth by noise of the samples."""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.runtime.impulsive_input.initial import initial_sizes
from obsdesign.runtime.impulsive_input.integral.free_run import FreeRun
from obsdesign.runtime.impulsive_input.whitening import USUAL_SHARE


def first_covariance(run: FreeRun, y: Matrix, x: Matrix) -> Matrix:
    """As wide as states that would explain the range of y (rows, p) in the first window.

    x (n,): the estimate at its first row.
    """
    ranges = np.ptp(y, axis=0) + np.abs(y[0] - run.gains.C @ x)
    return np.diag(initial_sizes(run.plant, run.tau, ranges) ** 2)


def propagated(run: FreeRun, P: Matrix, elapsed: float, times: Matrix, spread: Matrix) -> Matrix:
    """P after a time, from sample to sample, by P+ = E P E' + G N G'; by doubling.

    Spacing and variance N of the samples are those of a window, times (rows,), spread (rows, p):
    their mean, and what most variances are below, about the mean but for outliers. P is that of the
    error without the noise of the row's own sample: that one acts through `newer` of the step to
    the row and `older` of the step from it, G = E newer + older.
    """
    spacing = float(times[-1] - times[0]) / max(len(times) - 1, 1)
    count = round(elapsed / spacing)
    if count < 1:
        return P
    maps = run.step_maps(elapsed / count)
    gain = (maps.error @ maps.newer + maps.older) * np.quantile(spread, USUAL_SHARE, axis=0)
    flow, added = maps.error, gain @ gain.T  # of 1, 2, 4, ... steps
    while count:
        if count % 2:
            P = flow @ P @ flow.T + added
        added, flow, count = flow @ added @ flow.T + added, flow @ flow, count // 2
    return np.asarray((P + P.T) / 2)
