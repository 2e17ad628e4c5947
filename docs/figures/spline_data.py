"""The cubic spline of Medina and Lawrence, section IV, as data for examples/medina_spline.toml.

    python -m docs.figures.spline_data [FOLDER]     draws Figure 1 (medina_1.png) and 2 to 5
                                                    (medina_spline.png) of the paper
    python -m docs.figures.spline_data SPLINE.csv   writes the data

The paper prints knots, jump inputs and the initial state, not the points behind them. A not-a-knot
spline through the points below gives all of its numbers to the printed digits: the trapezoidal
signal 2t, 2, 2(4 - t) with zeros at t = 0.1 and 3.9. The estimate starts from the paper's
xhat(0) = (0, 0, 0, 100); before the first impulse its window holds the middle spacing.

Columns: t, y1 and w1 at the knots, jump, and the true state x1..x4 after each row.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import obsdesign
from docs.figures.folder import chosen
from obsdesign.data.csv_text import table_text
from obsdesign.output_files import write_text
from obsdesign.pages.plotting.style import BLACK, BLUE, GREY, VERMILION, picture
from obsdesign.runtime import from_design

EXAMPLE = Path(__file__).parents[2] / "examples" / "medina_spline.toml"
TIMES = np.array([0, 0.1, 0.5, 0.9, 1, 1.1, 1.2, 2, 2.8, 2.9, 3, 3.1, 3.5, 3.9, 4])
VALUES = np.array([0, 0, 1, 1.8, 2, 2, 2, 2, 2, 2, 2, 1.8, 1, 0, 0])
STEP, JUST_BEFORE = 0.01, 1e-9
START = (0.0, 0.0, 0.0, 100.0)  # xhat(0)


def spline() -> CubicSpline:
    return CubicSpline(TIMES, VALUES, bc_type="not-a-knot")


def columns(before_knots: bool = False) -> dict[str, np.ndarray]:
    """The data file, row by row; y and w only at the knots.

    before_knots: with a row just before each knot, where estimates jump.
    """
    curve, knots = spline(), TIMES[1:-1]
    rows = np.union1d(np.round(np.arange(0, 4 + STEP / 2, STEP), 9), TIMES)
    rows = np.union1d(rows, knots - JUST_BEFORE) if before_knots else rows
    jump = np.isin(rows, knots)
    states = np.stack([curve(rows, order) for order in range(4)])
    table = {
        "t": rows,
        "y1": np.where(jump, states[0], np.nan),
        "w1": np.where(jump, states[3], np.nan),  # x4 is set to the new third derivative
        "jump": jump.astype(np.int64),
    }
    return table | {f"x{i + 1}": states[i] for i in range(4)}


def trapezoid(t: np.ndarray) -> np.ndarray:
    """The signal that the spline approximates."""
    return np.minimum(2.0, np.minimum(2 * t, 2 * (4 - t)))


def estimates(design: obsdesign.Design) -> tuple[Any, Any, Any]:
    """t, the estimate from xhat(0) and the true state, (4), after each row."""
    table = columns(before_knots=True)
    observer: Any = from_design(design)
    batch = observer.run_batch(
        table["t"], table["y1"], w=np.nan_to_num(table["w1"]), jump=table["jump"], x=START
    )
    assert set(batch.status) == {"ok"}
    return table["t"], batch.x, np.stack([table[f"x{i + 1}"] for i in range(4)], axis=1)


def draw_signal(output: str) -> None:
    """Figure 1: the trapezoid, the spline and its knots."""
    t = np.linspace(0, 4, 801)
    with picture(6.0, 3.2, output) as figure:
        axis = figure.subplots()
        axis.plot(t, trapezoid(t), color=GREY, lw=1.2, ls="--", label="trapezoid")
        axis.plot(t, spline()(t), color=BLUE, lw=1.4, label="spline")
        axis.plot(TIMES[1:-1], VALUES[1:-1], "o", color=VERMILION, ms=4, label="impulse times")
        axis.set(xlabel="t", ylabel="x1", xlim=(0, 4))
        axis.legend(frameon=False, loc="lower center")


def draw_estimates(output: str) -> None:
    """Figures 2 to 5: each state (solid) and its estimate (dashed)."""
    t, estimate, true = estimates(obsdesign.design(obsdesign.load_problem(EXAMPLE)))
    with picture(7.0, 8.0, output) as figure:
        axes = figure.subplots(4, 1, sharex=True)
        for i, axis in enumerate(axes):
            for knot in TIMES[1:-1]:
                axis.axvline(knot, color=GREY, lw=0.6, ls=":")
            axis.plot(t, true[:, i], color=BLACK, lw=1.1, label="true state")
            axis.plot(t, estimate[:, i], color=BLUE, lw=1.4, ls="--", label="estimate")
            axis.set(ylabel=f"$x_{i + 1}$", xlim=(0, 4))
        axes[0].legend(frameon=False, loc="lower center", ncols=2)
        axes[-1].set_xlabel("t")


def draw(folder: Path) -> None:
    draw_signal(f"{folder}/medina_1.png")
    draw_estimates(f"{folder}/medina_spline.png")


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].endswith(".csv"):
        write_text(sys.argv[1], table_text(columns()))
    else:
        draw(chosen())
