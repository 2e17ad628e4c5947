"""Error of the unknown input under noise: four differentiators and a Kalman filter, side by side.

python -m tests.long.noise_of_unknown_inputs [runs]: root mean square error over t >= 3 of both of the
paper's examples, h = 0.1, 100 cells, noise 0.01 on every sample; compared with d at mid-cell.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of
from obsdesign.studies.comparison.kalman import kalman_filter

EXAMPLES = Path(__file__).parents[2] / "examples"
H, CELLS, SIGMA, FROM = 0.1, 100, 0.01, 3.0
LEVELS = {"ahn_1": np.array([5.0, 3.0]), "ahn_2": np.array([3.0])}
INITIAL = {"ahn_1": [-1.0, -1, 1], "ahn_2": [5.0, -3, 5]}
SHAPES: dict[str, Callable[[float], float]] = {
    "const": lambda t: 1.0,
    "sin": lambda t: float(np.sin(1.5 * t)),
    "step": lambda t: 2.0 if t >= 5 else 1.0,
}
WALKS = (0.01, 0.1, 1.0, 10.0, 100.0)


def trajectory(name: str, shape: str, refine: int = 20) -> tuple[np.ndarray, ...]:
    """(t, C x, d at mid-cell); d held over a twentieth of a cell, at its middle."""
    plant = obsdesign.load_problem(EXAMPLES / f"{name}.toml").plant
    (n, q), small = plant.flow.D.shape, H / refine
    block = np.zeros((n + q, n + q))
    block[:n] = np.hstack([plant.flow.A, plant.flow.D]) * small
    move = expm(block)[:n]
    x, states = np.array(INITIAL[name]), [np.array(INITIAL[name])]
    for k in range(CELLS * refine):
        d = LEVELS[name] * SHAPES[shape]((k + 0.5) * small)
        x = move @ np.concatenate([x, d])
        if (k + 1) % refine == 0:
            states.append(x)
    t = H * np.arange(CELLS + 1)
    middle = np.array([LEVELS[name] * SHAPES[shape](float(s)) for s in t[1:] - H / 2])
    return t, np.array(states) @ plant.output.C.T, middle


def observer(name: str, differentiator: str) -> Any:
    body = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()
    body["output"]["noise_std"] = [SIGMA] * 2
    body["observer"]["differentiator"] = differentiator
    return from_design(obsdesign.design(obsdesign.Problem.from_dict(body)))


def rmse(d: np.ndarray, truth: np.ndarray, t: np.ndarray) -> float:
    late = t[1:] > FROM
    return float(np.sqrt(np.mean((d[1:] - truth)[late] ** 2)))


def error(name: str, shape: str, method: str | float, runs: int, sigma: float = SIGMA) -> float:
    """Mean over runs; method: a differentiator, or the random-walk variance of a filter."""
    t, clean, truth = trajectory(name, shape)
    found = []
    body = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()
    body["output"]["noise_std"] = [SIGMA] * 2
    plant = obsdesign.Problem.from_dict(body).plant
    running = observer(name, method) if isinstance(method, str) else None
    for seed in range(runs):
        y = clean + sigma * np.random.default_rng(seed).standard_normal(clean.shape)
        if running is not None:
            d = running.run_batch(t, y, x=np.zeros(3)).d
        else:
            d = kalman_filter(plant, rows_of(t, y), walk=float(method)).d
        found.append(rmse(d, truth, t))
    return float(np.mean(found))


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    cases = [(name, shape) for name in LEVELS for shape in SHAPES]
    print("method".ljust(20) + "".join(f"{name} {shape}".rjust(13) for name, shape in cases))
    methods: list[str | float] = ["cell", "damped", "fixed_lag", "batch", *WALKS]
    for method in methods:
        label = method if isinstance(method, str) else f"filter, walk {method:g}"
        row = [error(name, shape, method, runs) for name, shape in cases]
        print(str(label).ljust(20) + "".join(f"{value:13.3f}" for value in row), flush=True)


if __name__ == "__main__":
    main()
