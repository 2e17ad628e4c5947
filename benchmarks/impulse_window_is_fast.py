"""A window of many rows: sums brought along with a filter, against the covariance of the window.

Operator `samples`, rows 250 times finer than the period. The obvious alternative forms the
covariance of the window, factors it, and solves for the responses of all onsets (kept from before).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import obsdesign
from benchmarks.cases import report, seconds
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design

EXAMPLE = Path(__file__).parents[1] / "examples" / "luteinizing_hormone.toml"
STEP, ROWS, ONSETS, FLOOR = 0.04, 1500, 1000, 20.0


def alternative(e: np.ndarray, seen: np.ndarray, noise: np.ndarray, h: np.ndarray) -> float:
    """The largest likelihood ratio of an onset: e residuals, h (rows, onsets) responses."""
    half = np.linalg.cholesky(np.diag(noise**2) + seen @ seen.T)
    b, r = np.linalg.solve(half, h), np.linalg.solve(half, e)
    size = np.einsum("ij,ij->j", b, b)
    return float((np.maximum(r @ b, 0) ** 2 / np.where(size > 0, size, np.inf)).max())


def main() -> bool:
    observer = from_design(obsdesign.design(obsdesign.load_problem(EXAMPLE)))
    plant, window = observer.engine.model.plant, observer.engine.window
    rows = round(window / STEP)
    t, ages = STEP * np.arange(ROWS), STEP * np.arange(1, rows + 1)
    onsets = np.linspace(0, window, ONSETS, endpoint=False)
    late = ages[:, None] - onsets
    flows = expm(plant.A * np.maximum(late, 0)[:, :, None, None])
    h = (plant.C @ flows @ plant.H)[..., 0, 0] * (late >= 0)
    seen = (plant.C @ expm(plant.A * ages[:, None, None]))[:, 0]
    ours, theirs = [], []
    for seed in range(3):
        y = 1.0 + 0.1 * np.random.default_rng(seed).standard_normal((ROWS, 1))
        time, _ = seconds(lambda y=y: observer.run_batch(t, y))
        ours.append(time / ROWS)
        noise = np.full(rows, 0.1)
        theirs.append(seconds(lambda y=y, n=noise: alternative(y[:rows, 0], seen, n, h))[0])
    return report(f"a row of few samples, {rows} in a window", ours, theirs, FLOOR)


if __name__ == "__main__":
    sys.exit(not main())
