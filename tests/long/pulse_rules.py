"""Other ways to find pulses in a few samples: a rise above the last nadir, and deconvolution.

python -m tests.long.pulse_rules     all of them on the luteinizing hormone record
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.data.csv_lines import read_columns
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "luteinizing_hormone.toml"
GRID, MERGED, LEAST = 1.0, 12.0, 0.5  # minutes, minutes, weight
Pulses = list[tuple[float, float]]  # onset, weight (NaN where a rule gives none)


def rise_rule(t: Any, y: Any, share: float) -> Pulses:
    """A pulse where y exceeds its last nadir by a share of it; its onset half a sample later.

    The next nadir is looked for once y has come down from its peak.
    """
    pulses: Pulses = []
    nadir, rising = 0, False
    for k in range(1, len(y)):
        if rising:
            rising = y[k] >= y[k - 1]
            nadir = k
        elif y[k] <= y[nadir]:
            nadir = k
        elif y[k] > (1 + share) * y[nadir]:
            pulses.append(((t[nadir] + t[nadir + 1]) / 2, float("nan")))
            rising, nadir = True, k
    return pulses


def deconvolution(t: Any, y: Any, spread: Any, A: Any, h: int, c: int, basal: float) -> Pulses:
    """Nonnegative least squares for weights on a grid of onsets, neighbours merged.

    State h receives impulses, state c is measured above `basal`; all states at first are free.
    """
    onsets = np.arange(t[0], t[-1], GRID)
    ages = t[:, None] - onsets
    flows = expm(A * np.maximum(ages, 0.0)[:, :, None, None])[..., c, h] * (ages >= 0)
    first = expm(A * t[:, None, None])[:, c, :]
    X = np.hstack([first, flows]) / spread[:, None]
    weights = nnls(X, (y - basal) / spread)[0][first.shape[1] :]
    groups: list[list[int]] = []
    for k in np.flatnonzero(weights > 1e-9).tolist():
        if groups and onsets[k] - onsets[groups[-1][-1]] <= MERGED:
            groups[-1].append(k)
        else:
            groups.append([k])
    merged = [(float(weights[g] @ onsets[g] / weights[g].sum()), float(weights[g].sum()))
              for g in groups]  # fmt: skip
    return [pulse for pulse in merged if pulse[1] >= LEAST]


def observed(observer: Any, t: Any, y: Any) -> list[Any]:
    """Events of the observer, begun at the first sample."""
    state = observer.init(float(t[0]), x=[0, y[0]], covariance=np.diag([0.25, 1.0]))
    return [event for row in observer.run(state, rows_of(t, y)) for event in row.events]


def methods(observer: Any, basal: float, cv: float) -> dict[str, Callable[[Any, Any], Pulses]]:
    """Every way to find pulses, by name; the observer first."""
    A, std = observer.gains.A, observer.gains.noise_std[0]
    return {
        "observer": lambda t, y: [(e.t, float(e.weights[0])) for e in observed(observer, t, y)],
        "NNLS": lambda t, y: deconvolution(t, y, np.hypot(std, cv * y), A, 0, 1, basal),
        "rise of 3 cv": lambda t, y: rise_rule(t, y, 3 * cv),
        "rise of 20 %": lambda t, y: rise_rule(t, y, 0.2),
    }


def main() -> None:
    problem = obsdesign.load_problem(EXAMPLE)
    observer = from_design(obsdesign.design(problem))
    flow, cv = problem.plant.flow, float(problem.plant.output.noise_cv[0])
    basal = float(flow.lower[1] / -flow.A[1, 1])
    columns = read_columns(str(EXAMPLE.with_suffix(".csv")))
    t, y = (np.array(columns[name], dtype=np.float64) for name in ("t", "y1"))
    by_method = {name: find(t, y) for name, find in methods(observer, basal, cv).items()}
    for name, pulses in by_method.items():
        times = " ".join(f"{moment:.0f}" for moment, _ in pulses)
        weights = " ".join(f"{weight:.2f}" for _, weight in pulses if weight == weight)
        print(f"{name:14s} {times:40s} {weights}")


if __name__ == "__main__":
    main()
