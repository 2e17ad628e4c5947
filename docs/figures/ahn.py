"""Figures 3 and 4 of Ahn: unknown inputs by block pulses and by a derivative block.

python -m docs.figures.ahn [FOLDER]        draws ahn_differentiators.png

The alternatives of the paper are simulated as MATLAB's Simulink does: plant and observer by
Runge-Kutta or Euler in steps of 0.1, and a block whose first output is 0, then backward
differences of y.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import obsdesign
from docs.figures import block_pulse
from docs.figures.folder import chosen
from obsdesign.runtime import from_design

EXAMPLES = Path(__file__).parents[2] / "examples"
H, M = 0.1, 100
FIRST = ("ahn_1", np.array([-1.0, -1, 1]), np.array([5.0, 3.0]))
SECOND = ("ahn_2", np.array([5.0, -3, 5]), np.array([3.0]))


def gains(name: str) -> dict[str, Any]:
    """Gains of an example in the paper's coordinates; L does not matter in the first."""
    body = obsdesign.load_problem(EXAMPLES / f"{name}.toml").to_dict()
    if name == "ahn_1":
        body["observer"]["gains"] = {"T1": [[0, 1, 0], [0, 0, 1], [1, 0, 0]], "L": [[]]}
    return dict(obsdesign.design(obsdesign.Problem.from_dict(body)).gains)


def runge_kutta(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float = H) -> np.ndarray:
    states = [x]
    for _ in range(M):
        x = states[-1]
        a = f(x)
        b = f(x + h / 2 * a)
        c = f(x + h / 2 * b)
        states.append(x + h / 6 * (a + 2 * b + 2 * c + f(x + h * c)))
    return np.array(states)


def euler(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    states = [x]
    for _ in range(M):
        states.append(states[-1] + H * f(states[-1]))
    return np.array(states)


def plant(name: str, d: np.ndarray) -> tuple[Any, ...]:
    flow = obsdesign.load_problem(EXAMPLES / f"{name}.toml").plant
    A, D, C = flow.flow.A, flow.flow.D, flow.output.C
    return A, D, C, lambda x: A @ x + D @ d


def block_pulse_estimates(
    case: tuple[str, np.ndarray, np.ndarray], sign: float = 1.0, h: float = H
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(true x averaged, estimated x, estimated d) on the cells, through the shipped observer.

    sign: of the differentiated output in (44).
    """
    name, x0, d = case
    _, _, C, f = plant(name, d)
    x = runge_kutta(f, x0, h)
    t, y = h * np.arange(M + 1), x @ C.T
    design = obsdesign.Design(**{
        **vars(obsdesign.design(obsdesign.load_problem(EXAMPLES / f"{name}.toml"))),
        "gains": gains(name),
    })  # fmt: skip
    batch = from_design(design).run_batch(t, y, x=np.zeros(3))
    estimate = block_pulse.coefficients(batch.x)
    slope = block_pulse.cell_derivative(y, t) @ design.gains["N"].T
    return block_pulse.coefficients(x), estimate, batch.d[1:] - (1 - sign) * slope


def simulink_estimates(
    case: tuple[str, np.ndarray, np.ndarray],
    method: Callable[..., np.ndarray],
    sign: float = 1.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The paper's alternatives: plant and observer together, and a block that differentiates y.

    The first output of that block is 0, then backward differences.
    """
    name, x0, d = case
    A, D, C, f = plant(name, d)
    g, k = gains(name), 3 - len(d)

    def both(z: np.ndarray) -> np.ndarray:
        return np.concatenate([A @ z[:3] + D @ d, g["F"] @ z[3:] + g["H"] @ C @ z[:3]])

    z = method(both, np.concatenate([x0, np.zeros(k)]))
    y, w = z[:, :3] @ C.T, z[:, 3:]
    slope = np.vstack([np.zeros((1, len(C))), np.diff(y, axis=0) / H])
    x_hat = w @ g["X"].T + y @ g["Xy"].T
    d_hat = w @ g["Q"].T + y @ g["R"].T + sign * slope @ g["N"].T
    exact = runge_kutta(f, x0)
    of = block_pulse.coefficients
    return of(exact), of(x_hat), of(d_hat)


def draw(folder: Path) -> None:
    """Both components of d, as in Figures 3 and 4 of the paper."""
    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2)
    cells = H * np.arange(M)
    estimates: dict[str, tuple[Any, str, str]] = {
        "block pulses (the observer)": (block_pulse_estimates(FIRST)[2], "#0072B2", "-"),
        "Runge-Kutta, derivative block": (
            simulink_estimates(FIRST, runge_kutta)[2],
            "#D55E00",
            "--",
        ),
    }
    for k, axis in enumerate(axes):
        axis.axhline(FIRST[2][k], color="0.6", lw=1.0, label="true")
        for label, (d, colour, style) in estimates.items():
            axis.step(cells, d[:, k], where="post", color=colour, ls=style, lw=1.4, label=label)
        axis.set(xlabel="t", ylabel=f"d{k + 1}", xlim=(0, 4))
        axis.grid(alpha=0.25)
    axes[1].legend(frameon=False, loc="lower right")
    figure.suptitle("Ahn, example 1: the first sample of the derivative block makes the difference",
                    fontsize=10)  # fmt: skip
    path = folder / "ahn_differentiators.png"
    figure.savefig(path, dpi=120)
    print(f"written: {path}")


if __name__ == "__main__":
    draw(chosen())
