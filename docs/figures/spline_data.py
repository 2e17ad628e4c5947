"""The cubic spline of Medina and Lawrence, section IV, as data for examples/medina_spline.toml.

    python -m docs.figures.spline_data [FOLDER]         draws the paper's Figure 1, medina_1.png
    python -m docs.figures.spline_data SPLINE.csv       writes the data

The paper prints knots, jump inputs and the initial state, not the points behind them. A not-a-knot
spline through the points below gives all of its numbers to the printed digits: the trapezoidal
signal 2t, 2, 2(4 - t) with zeros at t = 0.1 and 3.9. Columns: t, y1 and w1 at the knots, jump, and
the true state x1..x4 after each row.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from docs.figures.folder import chosen
from obsdesign.data.csv_text import table_text
from obsdesign.output_files import write_text

TIMES = np.array([0, 0.1, 0.5, 0.9, 1, 1.1, 1.2, 2, 2.8, 2.9, 3, 3.1, 3.5, 3.9, 4])
VALUES = np.array([0, 0, 1, 1.8, 2, 2, 2, 2, 2, 2, 2, 1.8, 1, 0, 0])
STEP = 0.01


def spline() -> CubicSpline:
    return CubicSpline(TIMES, VALUES, bc_type="not-a-knot")


def columns() -> dict[str, np.ndarray]:
    """The data file, row by row; y and w only at the knots."""
    curve, knots = spline(), TIMES[1:-1]
    rows = np.union1d(np.round(np.arange(0, 4 + STEP / 2, STEP), 9), TIMES)
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


def draw(folder: Path) -> None:
    """Figure 1: the trapezoid, the spline and its knots."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.2), layout="constrained")
    axis = figure.subplots()
    t = np.linspace(0, 4, 801)
    axis.plot(t, trapezoid(t), color="0.6", lw=1.2, ls="--", label="trapezoid")
    axis.plot(t, spline()(t), color="#0072B2", lw=1.4, label="spline")
    axis.plot(TIMES[1:-1], VALUES[1:-1], "o", color="#D55E00", ms=4, label="impulse times")
    axis.set(xlabel="t", ylabel="x1", xlim=(0, 4))
    axis.grid(alpha=0.25)
    axis.legend(frameon=False, loc="lower center")
    figure.savefig(folder / "medina_1.png", dpi=120)


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].endswith(".csv"):
        write_text(sys.argv[1], table_text(columns()))
    else:
        draw(chosen())
