"""Figures 1 and 3 of Degue, Efimov and Richard: the paper's signals, initial bounds chosen here.

python -m docs.figures.degue [FOLDER]       draws degue_1.png and degue_3.png

The paper prints plants, gains, signals and jump times, but neither x(0) nor the initial bounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import obsdesign
from docs.figures.folder import chosen
from obsdesign.runtime import from_design

EXAMPLES = Path(__file__).parents[2] / "examples"
JUMPS, END, STEP = (5.0, 10.0), 15.0, 0.01
START, LOWER, UPPER = (1.0, -1.0), (-1.0, -3.0), (3.0, 1.0)
Signal = Callable[[float], float]

# number of the figure -> example, b, d and v of the paper (b and d are the same in both states)
FIGURES: dict[int, tuple[str, Signal, Signal, Signal]] = {
    1: ("degue_4_1", lambda t: 0.1 * np.sin(t), lambda t: 0.3 * np.sin(t),
        lambda t: 0.03 * np.sin(t)),
    3: ("degue_4_3", lambda t: 0.1 * np.sin(2 * t) * np.cos(t), lambda t: 0.2 + 0.1 * np.sin(t),
        lambda t: 0.0),
}  # fmt: skip


def simulated(number: int) -> tuple[Any, Any, Any, Any]:
    """t, x just before jumps, y and the jumps of a figure."""
    name, b, d, v = FIGURES[number]
    plant = obsdesign.load_problem(EXAMPLES / f"{name}.toml").plant
    t = np.round(STEP * np.arange(round(END / STEP) + 1), 10)
    x, rows = np.array(START), [np.array(START)]
    for begin, end in itertools.pairwise(t):
        if begin in JUMPS:
            x = plant.jump.G @ x + d(begin)
        x = solve_ivp(lambda s, z: plant.flow.A @ z + b(s), (begin, end), x,
                      method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]  # fmt: skip
        rows.append(x)
    states = np.array(rows)
    y = states @ plant.output.C.T + np.array([[v(s)] for s in t])
    return t, states, y, np.isin(t, JUMPS)


def bounds(number: int) -> tuple[Any, Any, Any, Any]:
    """t, x, lower and upper of a figure; at a jump the values just after it."""
    t, x, y, jump = simulated(number)
    name, _, d, _ = FIGURES[number]
    problem = obsdesign.load_problem(EXAMPLES / f"{name}.toml")
    observer: Any = from_design(obsdesign.design(problem))
    batch = observer.run_batch(t, y, jump=jump, lower=LOWER, upper=UPPER)
    after = x.copy()
    for row in np.flatnonzero(jump):
        after[row] = problem.plant.jump.G @ x[row] + d(t[row])
    return t, after, batch.lower, batch.upper


def draw_figure(number: int, path: Path) -> None:
    """Both states and their bounds."""
    t, x, lower, upper = bounds(number)
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    for k, axis in enumerate(figure.subplots(1, 2)):
        axis.fill_between(t, lower[:, k], upper[:, k], color="#56B4E9", alpha=0.35, lw=0)
        axis.plot(t, lower[:, k], t, upper[:, k], color="#0072B2", lw=0.9, ls="--")
        axis.plot(t, x[:, k], color="black", lw=1.2)
        axis.set(xlabel="t", ylabel=f"x{k + 1}", xlim=(0, END))
        axis.grid(alpha=0.25)
    figure.suptitle(f"Degue et al., Figure {number}: the state (solid) inside its bounds (dashed); "
                    "jumps at 5 and 10", fontsize=10)  # fmt: skip
    figure.savefig(path, dpi=120)
    print(f"written: {path}")


def draw(folder: Path) -> None:
    for number in FIGURES:
        draw_figure(number, folder / f"degue_{number}.png")


if __name__ == "__main__":
    draw(chosen())
