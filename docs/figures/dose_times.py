"""Bounds of plasma where doses have times that are known to 15 minutes: with a curve and without.

python -m docs.figures.dose_times [FOLDER]   draws dose_times.png and prints the widths it names
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import obsdesign
from docs.figures.folder import chosen
from lmi.arithmetic.arrays import Matrix
from lmi.arithmetic.exponential import expm
from obsdesign.document import Design
from obsdesign.problem.problem import Problem
from obsdesign.runtime import Sample, from_design

EXAMPLE = Path(__file__).parents[2] / "examples" / "dose_times.toml"
DOSE, ERROR = 100.0, 0.25
STAMPS, OFF = (2.0, 8.0, 14.0, 20.0), (0.2, -0.22, 0.1, -0.05)
SAMPLES, END, STEP = (4.0, 9.0, 13.0, 16.5, 22.0), 26.0, 0.05
BLUE, GREY, RED = "#0072B2", "#999999", "#D55E00"
STATES = ("depot, mg", "plasma, mg", "tissue, mg")


@dataclass(frozen=True)
class Run:
    """Times, truth (rows, 3), bounds (rows, 2, 3) at uncertain times and at exact ones."""

    t: Matrix
    x: Matrix
    bounds: Matrix


def truth(A: Matrix, t: Matrix) -> Matrix:
    """States under doses at their true times, without any other disturbance."""
    jumps = [(stamp + off, DOSE * np.eye(3)[0]) for stamp, off in zip(STAMPS, OFF, strict=True)]
    return np.array(
        [sum((expm(A * (s - at)) @ c for at, c in jumps if s >= at), np.zeros(3)) for s in t]
    )


def run(design: Design, samples: tuple[float, ...] = SAMPLES) -> Run:
    """The example on a record of its own, with a row every three minutes."""
    observer: Any = from_design(design)
    t = np.round(np.union1d(np.arange(0, END, STEP), [*STAMPS, *samples]), 9)
    x = truth(Problem.from_dict(design.problem).plant.flow.A, t)
    rows = [
        Sample(
            s, [0.05 * z[1]] if s in samples else None, None,
            np.array([DOSE if s in STAMPS else np.nan]), s in STAMPS, None,
            (0,) if s in STAMPS else (),
        )
        for s, z in zip(t.tolist(), x, strict=True)
    ]  # fmt: skip
    state = observer.init(0.0, lower=[0, 0, 0], upper=[1, 1, 1])
    bounds = np.array([[e.lower, e.upper] for e in observer.run(state, rows)])
    return Run(t, x, bounds)


def draw(folder: Path) -> None:
    """Three states with their bounds, the windows of the doses shaded."""
    design = obsdesign.design(obsdesign.load_problem(EXAMPLE))
    with_samples, without = run(design), run(design, ())
    figure = Figure(figsize=(8.4, 6.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for i, ax in enumerate(axes):
        for stamp in STAMPS:
            ax.axvspan(stamp - ERROR, stamp + ERROR, color="#E8E8E8", lw=0)
        ax.fill_between(without.t, *without.bounds[:, :, i].T, color=GREY, alpha=0.4, lw=0,
                        label="bounds without samples")  # fmt: skip
        ax.fill_between(with_samples.t, *with_samples.bounds[:, :, i].T, color=BLUE, alpha=0.5,
                        lw=0, label="bounds")  # fmt: skip
        ax.plot(with_samples.t, with_samples.x[:, i], color="black", lw=1.0, label="state")
        ax.set_ylabel(STATES[i])
        ax.margins(x=0)
    plasma = np.isin(with_samples.t, SAMPLES)
    axes[1].plot(with_samples.t[plasma], with_samples.x[plasma, 1], "o", color=RED, ms=5,
                 label="blood sample")  # fmt: skip
    axes[1].legend(loc="upper left", ncols=2, fontsize=8)
    axes[-1].set_xlabel("time, h; grey: time_error about each stamp of a dose")
    figure.savefig(folder / "dose_times.png", dpi=130)
    inside = (with_samples.bounds[:, 0] <= with_samples.x) & (
        with_samples.x <= with_samples.bounds[:, 1]
    )
    print(f"written: {folder / 'dose_times.png'}; rows inside: {inside.all()}")
    for name, shown in (("with samples", with_samples), ("without", without)):
        last = np.ptp(shown.bounds[np.searchsorted(shown.t, 25.7)], axis=0)
        print(f"widths {name} 5.7 h after the last dose: {last.round(2)}")


if __name__ == "__main__":
    draw(chosen())
