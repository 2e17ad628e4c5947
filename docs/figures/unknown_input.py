"""Pictures of the unknown-input examples: python -m docs.figures.unknown_input [FOLDER]

The paper's two examples (its figures 1-8: estimates of the states and of the unknown inputs) and an
actuator fault of a quarter car on a shaker rig. Data and estimates go through the same files as the
command line's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import obsdesign
from docs.figures.folder import chosen
from lmi.arithmetic.exponential import expm
from obsdesign.data.csv_text import table_text
from obsdesign.data.execution import execute
from obsdesign.pages.plotting.estimate import plot_estimate

EXAMPLES = Path(__file__).parents[2] / "examples"
Signal = Callable[[float], list[float]]


def record(name: str, x0: list[float], d: Signal, u: Signal | None, h: float, until: float) -> dict:
    """Columns t, y, u, x, d; u and d held between rows, noise as the problem says."""
    plant = obsdesign.load_problem(EXAMPLES / f"{name}.toml").plant
    flow, n = plant.flow, plant.n
    drive = flow.D if flow.B is None else np.hstack([flow.D, flow.B])
    block = np.zeros((n + drive.shape[1],) * 2)
    block[:n] = np.hstack([flow.A, drive]) * h
    move = expm(block)[:n]
    t = np.round(h * np.arange(round(until / h) + 1), 12)
    inputs = np.array([u(s) for s in t]) if u else np.zeros((len(t), 0))
    unknown, x = np.array([d(s) for s in t]), [np.array(x0)]
    for k in range(len(t) - 1):
        x.append(move @ np.concatenate([x[-1], unknown[k], inputs[k]]))
    states = np.array(x)
    noise = np.random.default_rng(0).standard_normal((len(t), plant.p)) * plant.output.noise_std
    columns = {"t": t}
    blocks = {"y": states @ plant.output.C.T + noise, "u": inputs, "x": states, "d": unknown}
    for letter, values in blocks.items():
        columns |= {f"{letter}{i + 1}": values[:, i] for i in range(values.shape[1])}
    return columns


def picture(folder: Path, name: str, columns: dict, initial: list[float] | None) -> None:
    problem = obsdesign.load_problem(EXAMPLES / f"{name}.toml")
    with tempfile.TemporaryDirectory() as scratch:
        design, data, estimate = (str(Path(scratch, file)) for file in ("d.json", "y.csv", "x.csv"))
        obsdesign.design(problem).save(design)
        Path(data).write_text(table_text(columns))
        execute(design, data, estimate, initial, None)
        plot_estimate(estimate, data, str(folder / f"{name}.png"))
    print(f"written: {folder / name}.png")


def road(t: float) -> float:
    """A bump of 5 cm and 0.25 s at 1 s, then a rough road by sines of 1 to 12 Hz."""
    bump = 0.025 * (1 - np.cos(8 * np.pi * (t - 1))) if 1 <= t < 1.25 else 0.0
    rough = sum(0.004 / f * np.sin(2 * np.pi * f * t + f) for f in (1.0, 2.3, 5.1, 11.7))
    return float(bump + rough)


def fault(t: float) -> float:
    """The actuator sticks with 0.4 kN at 2 s, then lets go slowly from 3 s on."""
    return 0.0 if t < 2 else 0.4 if t < 3 else 0.4 * max(0.0, 4 - t)


def draw(folder: Path) -> None:
    columns = record("ahn_1", [-1, -1, 1], lambda _: [5.0, 3.0], None, 0.1, 10.0)
    picture(folder, "ahn_1", columns, [0.0] * 3)
    columns = record("ahn_2", [5, -3, 5], lambda _: [3.0], None, 0.1, 10.0)
    picture(folder, "ahn_2", columns, [0.0] * 3)
    columns = record(
        "quarter_car", [0.0] * 4, lambda t: [fault(t)],
        lambda t: [road(t), 0.3 * float(np.sin(2 * np.pi * 1.5 * t))], 0.001, 5.0,
    )  # fmt: skip
    picture(folder, "quarter_car", columns, None)


if __name__ == "__main__":
    draw(chosen())
