"""Figures 1 and 3 of Degue, Efimov and Richard: the paper's signals, initial bounds chosen here.

python -m docs.figures.degue [FOLDER]       draws degue_1.png and degue_3.png, prints widths

The paper prints plants, gains, signals and jump times, but neither x(0) nor the initial bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import obsdesign
from docs.figures.folder import chosen
from obsdesign.pages.plotting.style import BLACK, BLUE, VERMILION, picture
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


@dataclass(frozen=True)
class Run:
    """A figure's state and bounds, (rows, 2) each; at a jump the values just after it.

    printed: bounds of observer (6) or (11) with y at every instant; sampled: those of
    `obsdesign run` with y in rows STEP apart, which measurements cut.
    """

    t: Any
    x: Any
    printed: tuple[Any, Any]
    sampled: tuple[Any, Any]


def simulated(number: int) -> Run:
    """Plant and printed observer in one equation; the sampled observer on its output."""
    name, b, d, v = FIGURES[number]
    problem = obsdesign.load_problem(EXAMPLES / f"{name}.toml")
    design, plant = obsdesign.design(problem), problem.plant
    t = np.round(STEP * np.arange(round(END / STEP) + 1), 10)
    flow, jump = _printed(plant, design.gains, b, d, v)
    z, before, after = np.array([*START, *LOWER, *UPPER]), [], []
    for k, now in enumerate(t):
        if k:
            span = (t[k - 1], now)
            z = solve_ivp(flow, span, z, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        before.append(z[:2])
        z = jump(now, z) if now in JUMPS else z
        after.append(z)
    y = np.array(before) @ plant.output.C.T + np.array([[v(s)] for s in t])
    observer: Any = from_design(design)
    batch = observer.run_batch(t, y, jump=np.isin(t, JUMPS), lower=LOWER, upper=UPPER)
    rows = np.array(after)
    return Run(t, rows[:, :2], (rows[:, 2:4], rows[:, 4:]), (batch.lower, batch.upper))


def _printed(plant: Any, gains: Any, b: Signal, d: Signal, v: Signal) -> tuple[Any, Any]:
    """Flow and jump of (x, lower, upper) with observer (11), of which (6) is the case D1 = Gn = 0.

    With y(t-) at a jump (Theorem 5), not y(t).
    """
    A, G, C, L, M = plant.flow.A, plant.jump.G, plant.output.C, gains["L"], gains["M"]
    V = plant.output.noise_bound
    b_lower, b_upper = plant.flow.b_bounds
    c_lower, c_upper = plant.jump.c_bounds

    def flow(t: float, z: Any) -> Any:
        x, low, high = z[:2], z[2:4], z[4:]
        given, noise = L @ (C @ x + v(t)), np.abs(L) @ V
        rise = gains["D0"] @ low - gains["D1"] @ high + given + b_lower - noise
        fall = gains["D0"] @ high - gains["D1"] @ low + given + b_upper + noise
        return np.concatenate([A @ x + b(t), rise, fall])

    def jump(t: float, z: Any) -> Any:
        x, low, high = z[:2], z[2:4], z[4:]
        given, noise = M @ (C @ x + v(t)), np.abs(M) @ V
        lower = gains["Gp"] @ low - gains["Gn"] @ high + given + c_lower - noise
        upper = gains["Gp"] @ high - gains["Gn"] @ low + given + c_upper + noise
        return np.concatenate([G @ x + d(t), lower, upper])

    return flow, jump


def widths(run: Run) -> tuple[float, str]:
    """Time of the row before the second jump; how wide the bounds of x1, x2 are there."""
    row = int(np.searchsorted(run.t, JUMPS[1])) - 1
    printed, sampled = (upper[row] - lower[row] for lower, upper in (run.printed, run.sampled))
    text = "{:.3f}, {:.3f} ({:.3f}, {:.3f} with `run`)".format(*printed, *sampled)
    return float(run.t[row]), text


def draw_figure(number: int, path: Path) -> None:
    """Both states and their bounds."""
    run = simulated(number)
    observer = {1: "(6)", 3: "(11)"}[number]
    when, text = widths(run)
    print(f"Figure {number}: at t = {when:g} the widths of x1, x2 are {text}")
    with picture(8.0, 3.4, str(path)) as figure:
        for k, axis in enumerate(figure.subplots(1, 2)):
            lower, upper = run.sampled
            axis.fill_between(run.t, lower[:, k], upper[:, k], color=BLUE, alpha=0.25, lw=0,
                              label="obsdesign run, y every 0.01")  # fmt: skip
            for bound, label in zip(run.printed, (f"observer {observer}", None), strict=True):
                axis.plot(run.t, bound[:, k], color=VERMILION, lw=0.9, ls="--", label=label)
            axis.plot(run.t, run.x[:, k], color=BLACK, lw=1.2, label="state")
            axis.set(xlabel="t", ylabel=f"$x_{k + 1}$", xlim=(0, END))
        axis.legend(frameon=False, fontsize=8)
    print(f"written: {path}")


def draw(folder: Path) -> None:
    for number in FIGURES:
        draw_figure(number, folder / f"degue_{number}.png")


if __name__ == "__main__":
    draw(chosen())
