"""Example 4.1 with the paper's gains and with the narrowest ones; oral doses between samples.

python examples/narrowest_bounds.py [FOLDER]       writes degue_4_1.png and oral_doses.png
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

import obsdesign
from lmi.arithmetic.arrays import Matrix
from obsdesign.data.simulation import simulate
from obsdesign.pages.plotting.style import BLACK, BLUE, GREEN, VERMILION, picture
from obsdesign.runtime import from_design

HERE = Path(__file__).parent
_COLOURS = (VERMILION, BLUE, GREEN)
_Bounds = Mapping[str, tuple[ArrayLike, ArrayLike]]


def compared(output: Path) -> dict[str, float]:
    """Mean width x1 + x2 of both designs on one record with dwell time 5, after 10 jumps."""
    problems = {
        "gains of the paper": obsdesign.load_problem(HERE / "degue_4_1.toml").with_dwell_time(5, 5),
        "narrowest": obsdesign.load_problem(HERE / "degue_4_1_narrowest.toml"),
    }
    plant = problems["narrowest"].plant
    record = simulate(plant, until=60.0, step=0.01, initial=[1.0, 1.0], disturbance="sine",
                      dwell=5.0, rng=np.random.default_rng(1))  # fmt: skip
    bounds, means = {}, {}
    last = record.t > 50.0
    for label, problem in problems.items():
        batch = from_design(obsdesign.design(problem)).run_batch(
            record.t, record.block("y"), jump=record.columns["jump"], lower=[0, 0], upper=[2, 2]
        )
        bounds[label] = batch.lower[last], batch.upper[last]
        means[label] = float((batch.upper - batch.lower)[last].sum(axis=1).mean())
    plot_bounds(record.t[last], record.block("x")[last], bounds, str(output))
    return means


def doses(output: Path) -> bool:
    """Three days of doses, 6 to 14 hours apart; is the state inside all the way?"""
    problem = obsdesign.load_problem(HERE / "oral_doses.toml")
    plant, rng = problem.plant, np.random.default_rng(3)
    record = simulate(plant, until=72.0, step=0.25, initial=[100.0] + [0.0] * 5,
                      disturbance="random", rng=rng)  # fmt: skip
    batch = from_design(obsdesign.design(problem)).run_batch(
        record.t, record.block("y"), jump=record.columns["jump"],
        lower=[90.0] + [0.0] * 5, upper=[110.0] + [10.0] * 5,
    )  # fmt: skip
    x = record.block("x")
    plot_bounds(record.t, x, {"bounds": (batch.lower, batch.upper)}, str(output))
    return bool(np.all((batch.lower <= x) & (x <= batch.upper)))


def plot_bounds(t: ArrayLike, x: ArrayLike, bounds: _Bounds, output: str) -> None:
    """Bounds by label, (lower, upper) each (rows, n), over the true state x, (rows, n).

    t: (rows,). At most three observers are told apart.
    """
    times, truth = np.asarray(t), np.asarray(x)
    n = truth.shape[1]
    with picture(7.0, 1.0 + 1.7 * n, output) as figure:
        axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
        for i, axis in enumerate(axes):
            _panel(axis, times, truth[:, i], bounds, i)
            axis.set_ylabel(f"$x_{{{i + 1}}}$", rotation=0, ha="right", va="center", fontsize=11)
        axes[-1].set_xlabel("time")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)


def _panel(axis: Axes, t: Matrix, x: Matrix, bounds: _Bounds, i: int) -> None:
    for colour, (label, (lower, upper)) in zip(_COLOURS, bounds.items(), strict=False):
        low, high = np.asarray(lower)[:, i], np.asarray(upper)[:, i]
        axis.fill_between(t, low, high, color=colour, alpha=0.22, lw=0, label=label)
        for edge in (low, high):
            axis.plot(t, edge, color=colour, lw=0.8)
    axis.plot(t, x, color=BLACK, lw=1.0, label="true state")
    axis.margins(x=0.01)


def main(folder: str = ".") -> None:
    """Both pictures, and what they show in a line each."""
    home = Path(folder)
    for label, mean in compared(home / "degue_4_1.png").items():
        print(f"example 4.1, {label}: mean width {mean:.4f}")
    print(f"oral doses: inside the bounds: {doses(home / 'oral_doses.png')}")


if __name__ == "__main__":
    main(*sys.argv[1:])
