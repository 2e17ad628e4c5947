"""The illustration of Mazenc and Ahmed: Fig. 1 beside exact estimates, and a table over the period.

python -m docs.figures.mazenc [FOLDER]       draws mazenc.png and prints the table
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import obsdesign
from docs.figures.folder import chosen
from lmi.arithmetic.exponential import flow_integrals
from obsdesign.runtime import from_design

EXAMPLE = Path(__file__).parents[2] / "examples" / "mazenc_4.toml"
END, STEP_HEIGHT, START = 30.0, 0.5, (0.0, 2.0)
METHODS = {"approximate": "(14) of the paper", "exact": "exact, (9) with (16)",
           "least_squares": "least squares"}  # fmt: skip
STYLES: dict[str, Any] = {"approximate": "-", "exact": "-", "least_squares": (0, (4, 3))}
COLOURS = {"approximate": "#D55E00", "exact": "#0072B2", "least_squares": "#009E73"}
PERIODS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0)


@dataclass(frozen=True)
class Run:
    """Truth and estimate over time, from the end of the window on; the gains."""

    t: Any
    x: Any
    estimate: Any
    gain: Any

    @property
    def error(self) -> float:
        return float(np.linalg.norm(self.estimate - self.x, axis=1).max())


def run(method: str, period: float) -> Run:
    """The paper's plant under a unit step of height 0.5 at t = 0."""
    body = obsdesign.load_problem(EXAMPLE).to_dict()
    body["output"]["period"] = period
    body["observer"]["method"] = method
    if method == "least_squares":
        body["observer"]["gains"] = {}
    problem = obsdesign.Problem.from_dict(body)
    design = obsdesign.design(problem)
    flow, once = flow_integrals(problem.plant.flow.A, period)
    push = once @ np.array([STEP_HEIGHT, 0.0])
    x = [np.array(START)]
    for _ in range(round(END / period)):
        x.append(flow @ x[-1] + push)
    states, t = np.array(x), np.round(period * np.arange(len(x)), 10)
    observer: Any = from_design(design)
    u = np.full((len(t), 1), STEP_HEIGHT)
    batch = observer.run_batch(t, states @ problem.plant.output.C.T, u)
    full = np.array([status == "ok" for status in batch.status])
    return Run(t[full], states[full], batch.x[full], design.gains["window_gain"])


def draw(folder: Path) -> None:
    runs = {method: run(method, 0.05) for method in METHODS}
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for method, label in METHODS.items():
        one = runs[method]
        above.step(one.t, one.estimate[:, 1], where="post", color=COLOURS[method],
                   ls=STYLES[method], lw=1.4, label=label)  # fmt: skip
        error = np.maximum(np.linalg.norm(one.estimate - one.x, axis=1), 1e-17)
        below.semilogy(one.t, error, color=COLOURS[method], lw=1.1)
    truth = runs["exact"]
    above.plot(truth.t, truth.x[:, 1], color="black", lw=0.9, label="$x_2$")
    above.set_ylabel("$x_2$")
    above.legend(frameon=False, loc="lower left")
    inset = above.inset_axes((0.66, 0.47, 0.33, 0.45))
    near = (truth.t >= 12.0) & (truth.t <= 12.6)
    for method in METHODS:
        one = runs[method]
        held = one.estimate[near, 1]
        inset.step(one.t[near], held, where="post", color=COLOURS[method],
                   ls=STYLES[method], lw=1.2)  # fmt: skip
    inset.plot(truth.t[near], truth.x[near, 1], color="black", lw=0.9)
    inset.set_title("held between samples", fontsize=8)
    inset.tick_params(labelsize=7)
    above.indicate_inset_zoom(inset, edgecolor="0.5")
    below.set_ylabel("$|\\hat x - x|$")
    below.set_xlabel("time")
    below.set_xlim(6.0, END)
    for axis in (above, below):
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, lw=0.5)
    figure.savefig(folder / "mazenc.png", dpi=160)


def table() -> None:
    print(
        "| ν | error (14) | error exact | error least squares | noise gain (14) | exact | l. s. |"
    )
    print("|---|---|---|---|---|---|---|")
    for period in PERIODS:
        runs = [run(method, period) for method in METHODS]
        errors = " | ".join(f"{one.error:.2g}" for one in runs)
        norms = " | ".join(f"{np.linalg.norm(one.gain, 2):.4f}" for one in runs)
        print(f"| {period:g} | {errors} | {norms} |")


if __name__ == "__main__":
    draw(chosen())
    table()
