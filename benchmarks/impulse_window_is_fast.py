"""A window of many rows: sums brought along with a filter, against the covariance of the window.

Operator `samples`, rows 250 times finer than the period. The obvious alternative forms the
covariance of the window, factors it, and solves for the responses of all onsets (kept from before).
Beside it, without a floor, what one writes where noise and spacing are the same in every window:
factored once, a product for each row.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np

import obsdesign
from benchmarks.cases import report, seconds
from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.runtime.impulsive_input.observer import ImpulsiveInputObserver

EXAMPLE = Path(__file__).parents[1] / "examples" / "luteinizing_hormone.toml"
STEP, ROWS, ONSETS, FLOOR = 0.04, 1500, 1000, 20.0


def alternative(e: Matrix, response: Matrix, noise: Matrix, h: Matrix) -> float:
    """The largest likelihood ratio of an onset: e residuals, h (rows, onsets) responses."""
    half = np.linalg.cholesky(np.diag(noise**2) + response @ response.T)
    b, r = np.linalg.solve(half, h), np.linalg.solve(half, e)
    size = np.einsum("ij,ij->j", b, b)
    return float((np.maximum(r @ b, 0) ** 2 / np.where(size > 0, size, np.inf)).max())


def kept(response: Matrix, noise: Matrix, h: Matrix) -> Matrix:
    """What residuals of any window are multiplied with, (onsets, rows)."""
    half = np.linalg.cholesky(np.diag(noise**2) + response @ response.T)
    b = np.linalg.solve(half, h)
    size = np.sqrt(np.einsum("ij,ij->j", b, b))
    return np.linalg.solve(half.T, b / np.where(size > 0, size, np.inf)).T


def once(e: Matrix, weights: Matrix) -> float:
    """The same ratio as `alternative`, from what was factored once."""
    return float((np.maximum(weights @ e, 0) ** 2).max())


def main() -> bool:
    design = obsdesign.design(obsdesign.load_problem(EXAMPLE))
    observer = ImpulsiveInputObserver.from_gains(design.gains)
    A, H, C = observer.gains.A, observer.gains.H, observer.gains.C
    window = observer.gains.window
    rows = round(window / STEP)
    t, ages = STEP * np.arange(ROWS), STEP * np.arange(1, rows + 1)
    onsets = np.linspace(0, window, ONSETS, endpoint=False)
    late = ages[:, None] - onsets
    flows = expm(A * np.maximum(late, 0)[:, :, None, None])
    h = (C @ flows @ H)[..., 0, 0] * (late >= 0)
    response = (C @ expm(A * ages[:, None, None]))[:, 0]
    ours, theirs, factored = [], [], []
    noise = np.full(rows, 0.1)
    weights = kept(response, noise, h)
    for seed in range(3):
        y = 1.0 + 0.1 * np.random.default_rng(seed).standard_normal((ROWS, 1))
        time, _ = seconds(partial(observer.run_batch, t, y))
        ours.append(time / ROWS)
        e = y[:rows, 0]
        time, ratio = seconds(partial(alternative, e, response, noise, h))
        theirs.append(time)
        time, again = seconds(partial(once, e, weights), 5)
        factored.append(time)
        assert abs(again - ratio) <= 1e-6 * ratio
    report("a row of few samples, factored once", ours, factored, 0)
    return report(f"a row of few samples, {rows} in a window", ours, theirs, FLOOR)


if __name__ == "__main__":
    sys.exit(not main())
