"""Section IV of Mattsson and Medvedev.

    python -m docs.figures.mattsson [FOLDER]      draws its figures
    python -m docs.figures.mattsson RECORD.csv    writes its record without noise, states included

mattsson.png: |b| against the age of an impulse (2), states without noise (3), their error (4), and
the impulses, by the design of examples/mattsson_medvedev.toml. mattsson_noise.png: the output (1),
errors and impulses with noise of variance 10 for both sets of exponents (5, 6), and with whitened
features, which go beyond the paper. States jump as (18) says; impulses are shown where noise is
declared at the means of their posterior.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from benchmarks.pulses_in_noise import (
    EXAMPLE,
    GUESS,
    ROWS,
    STEP,
    TRAIN,
    VARIANCE,
    A,
    C,
    H,
    observer,
    truth,
)
from docs.figures.folder import chosen
from lmi.arithmetic.exponential import expm, exponential_grid
from obsdesign.data.csv_text import table_text
from obsdesign.equations.impulsive_input.features import filtered_system
from obsdesign.output_files import write_text
from obsdesign.pages.plotting.style import BLACK, BLUE, GREEN, GREY, VERMILION, picture
from obsdesign.runtime import from_design
from tests.long.pulses_over_seeds import FAST

SLOW = [-0.65, -0.70, -0.75, -0.80, -0.85, -0.90]
K = np.array([[0.0002], [0.0048], [0.02]])
TAU, SEED, SHOWN = 20.0, 7000, slice(None, None, 10)
MOMENTS = [STEP * k for k in TRAIN]
SETS = {"Λ = −2.65 … −2.90": (FAST, VERMILION), "Λ = −0.65 … −0.90": (SLOW, BLUE)}


def batch_of(y: Any, **options: Any) -> Any:
    kind: Any = observer(**options)
    return kind.run_batch(np.round(STEP * np.arange(ROWS), 10), y, x=GUESS)


def columns() -> dict[str, Any]:
    """The record without noise: t, y1 and the true states."""
    x = truth()
    table = {"t": np.round(STEP * np.arange(ROWS), 10), "y1": (x @ C.T)[:, 0]}
    return table | {f"x{i + 1}": x[:, i] for i in range(3)}


def estimates() -> Any:
    """Estimates of the example's design on the record without noise, from the paper's guess."""
    kind: Any = from_design(obsdesign.design(obsdesign.load_problem(EXAMPLE)))
    table = columns()
    return kind.run_batch(table["t"], table["y1"][:, None], x=GUESS)


def profile(axis: Any) -> None:
    """Figure 2, and the same for the second set."""
    D = A - K @ C
    ages = np.linspace(0.0, TAU, 401)
    for label, (exponents, colour) in SETS.items():
        F = filtered_system(D, C, np.array(exponents))
        b = (exponential_grid(F, 0.0, TAU / 400, 401)[:, :, :3] @ H)[:, 3:, 0]
        size = np.linalg.norm(b, axis=1)
        k = int(np.argmax(size))
        axis.plot(TAU - ages, size, color=colour, lw=1.3, label=label)
        axis.plot(TAU - ages[k], size[k], "o", ms=4, color=colour)
        axis.annotate(f"{TAU - ages[k]:.1f}", (TAU - ages[k], size[k]), (0, 4), color=colour,
                      textcoords="offset points", ha="center", fontsize=8)  # fmt: skip
    axis.set_xlim(0, TAU)
    axis.set_ylim(0, 46)
    axis.set_xlabel("$t_k - t_o$")
    axis.set_ylabel("$|V(t_o + \\tau - t_k)B|$")
    axis.legend(frameon=False, loc="center right")


def impulses(axis: Any, events: Any, colour: str, label: str, marker: str) -> None:
    axis.plot([e.t for e in events], [e.weights[0] for e in events], marker, ms=6, mew=1.2,
              mfc="none", color=colour, label=label)  # fmt: skip


def true_impulses(axis: Any) -> None:
    axis.vlines(MOMENTS, 0, list(TRAIN.values()), color=GREY, lw=4, label="true impulses")
    axis.set_ylabel("weight")
    axis.set_ylim(0, 8.5)


def errors(axis: Any, t: Any, x: Any, estimate: Any, colour: str, label: str) -> None:
    size = np.linalg.norm(x - estimate, axis=1)
    axis.semilogy(t[SHOWN], size[SHOWN], color=colour, lw=1.0, label=label)


def without_noise(output: str) -> None:
    t, x = np.round(STEP * np.arange(ROWS), 10), truth()
    batch = estimates()
    alone = np.linalg.norm(
        expm((A - K @ C) * t[SHOWN][:, None, None]) @ (x[0] - GUESS), axis=1
    )  # impulses known, only the first error decays
    with picture(7.2, 9.0, output) as figure:
        axes = figure.subplots(6, 1, height_ratios=[1.5, 1, 1, 1, 1.2, 1])
        profile(axes[0])
        for i in range(3):
            axis = axes[1 + i]
            axis.plot(t[SHOWN], x[SHOWN, i], color=BLACK, lw=2.2, alpha=0.35, label="true")
            axis.plot(t[SHOWN], batch.x[SHOWN, i], color=BLUE, lw=1.0, label="estimate")
            axis.set_ylabel(f"$x_{i + 1}$")
        axes[1].legend(frameon=False, loc="upper right", ncols=2)
        errors(axes[4], t, x, batch.x, BLUE, "estimated impulses")
        axes[4].semilogy(t[SHOWN], alone, color=VERMILION, lw=1.0, label="impulses known exactly")
        axes[4].set_ylabel("$|x - \\hat x|$")
        axes[4].set_ylim(1e-8, 1e2)
        axes[4].legend(frameon=False, loc="upper right")
        true_impulses(axes[5])
        impulses(axes[5], batch.events, BLUE, "estimated", "o")
        axes[5].legend(frameon=False, loc="upper right", ncols=2)
        for axis in axes[1:]:
            axis.set_xlim(0, 240)
            axis.sharex(axes[5])
        for axis in axes[1:5]:
            axis.tick_params(labelbottom=False)
        axes[5].set_xlabel("time")
    for event in batch.events:
        print(f"t = {event.t:.5f}, weight {event.weights[0]:.5f}")


def with_noise(output: str) -> None:
    t, x = np.round(STEP * np.arange(ROWS), 10), truth()
    noise = np.random.default_rng(SEED).normal(0, VARIANCE**0.5, (ROWS, 1))
    runs = {
        f"paper, {label}": (batch_of(x @ C.T + noise, weighting="plain", exponents=lams), colour)
        for label, (lams, colour) in SETS.items()
    }
    better = batch_of(x @ C.T + noise, weighting="gls")
    runs["gls, state corrected"] = (better, GREEN)
    markers = dict(zip(runs, ("s", "o", "^"), strict=True))
    with picture(7.2, 6.4, output) as figure:
        axes = figure.subplots(3, 1, sharex=True, height_ratios=[1, 1.8, 1.4])
        axes[0].plot(t[SHOWN], (x @ C.T + noise)[SHOWN], color=GREY, lw=0.4, label="measured")
        axes[0].plot(t[SHOWN], (x @ C.T)[SHOWN], color=BLACK, lw=0.9, label="true")
        axes[0].legend(frameon=False, loc="upper right", ncols=2)
        axes[0].set_ylabel("$y$")
        true_impulses(axes[2])
        for label, (batch, colour) in runs.items():
            errors(axes[1], t, x, batch.x, colour, label)
            impulses(axes[2], batch.events, colour, label, markers[label])
        axes[1].set_ylabel("$|x - \\hat x|$")
        axes[1].set_ylim(1e-2, 3e2)
        axes[1].legend(frameon=False, loc="upper right")
        axes[2].legend(frameon=False, loc="upper right")
        axes[2].set_xlim(0, 240)
        axes[2].set_xlabel("time")


def draw(folder: Path) -> None:
    without_noise(f"{folder}/mattsson.png")
    with_noise(f"{folder}/mattsson_noise.png")


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].endswith(".csv"):
        write_text(sys.argv[1], table_text(columns()))
    else:
        draw(chosen())
