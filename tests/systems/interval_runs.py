"""Random plants, random gains and admissible runs for interval observers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from obsdesign.data.simulation import Simulation, simulate
from obsdesign.equations.estimation_error import flow_error_matrix, jump_error_matrix
from obsdesign.equations.gains import plant_data
from obsdesign.equations.interval import splits as equations
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime.interval.observer import IntervalObserver

DISTURBANCES = ("extreme", "random", "sine")

# The simulated "truth" is itself rounded; its error, relative to the largest state of the run.
SIMULATION_ROUNDING = 1e-12


def random_plant(rng: np.random.Generator, n: int | None = None) -> Plant:
    """n <= 5 states, up to 3 outputs, inputs or none, any jump_measurement; moderately unstable."""
    n = int(rng.integers(1, 6)) if n is None else n
    p, m, k = (int(rng.integers(low, high)) for low, high in ((1, 4), (0, 3), (0, 2)))
    A = rng.standard_normal((n, n)) - rng.uniform(0, 2) * np.eye(n)
    G = rng.standard_normal((n, n)) * rng.uniform(0.1, 1.0) * (rng.random((n, n)) < 0.8)
    centre, size = rng.standard_normal((2, n)), rng.uniform(0, 0.5, (2, n))
    size *= rng.random((2, 1)) < 0.8
    return Plant(
        Flow(A, B=rng.standard_normal((n, m)) if m else None,
             lower=centre[0] - size[0], upper=centre[0] + size[0]),
        Jump(G, E=rng.standard_normal((n, k)) if k else None,
             lower=centre[1] - size[1], upper=centre[1] + size[1], dwell_time=(0.1, 0.8)),
        Output(rng.standard_normal((p, n)), noise_bound=rng.uniform(0, 0.2, p) * (rng.random() < 0.8),
               jump_measurement=str(rng.choice(["before", "after", "none"]))),
    )  # fmt: skip


def observer_for(plant: Plant, L: Any, M: Any, **splits: Any) -> IntervalObserver:
    """An observer with these gains and the minimal splits, proved or not."""
    data = plant_data(plant) | {"form": "split", "L": L, "M": M}
    F = flow_error_matrix(plant.flow.A, L, plant.output.C)
    data["D0"], data["D1"] = equations.metzler_split(F)
    if plant.jump is not None:
        when = plant.output.jump_measurement
        H = jump_error_matrix(plant.jump.G, M, plant.output.C, when)
        data["Gp"], data["Gn"] = equations.nonnegative_split(H)
    return IntervalObserver.from_gains(data | splits)


def random_observer(plant: Plant, rng: np.random.Generator) -> IntervalObserver:
    """Gains without any sense: the enclosure must hold all the same."""
    shape = (len(plant.flow.A), len(plant.output.C))
    M = rng.standard_normal(shape) * 0.5
    if plant.output.jump_measurement == "none":
        M = 0 * M
    return observer_for(plant, rng.standard_normal(shape) * rng.choice([0.0, 0.5, 3.0]), M)


@dataclass(frozen=True)
class Run:
    """A simulated record, bounds at its start, and the estimates of an observer on it."""

    record: Simulation
    lower: np.ndarray
    upper: np.ndarray
    status: tuple[str, ...]

    def violation(self) -> float:
        """How far the state leaves its bounds, relative to the largest state seen."""
        x = self.record.block("x")
        beyond = np.maximum(self.lower - x, x - self.upper).max()
        return float(beyond / max(np.abs(x).max(), 1.0))


def random_run(seed: int, drop: float = 0.1) -> Run:
    """One admissible run: random plant, gains, disturbances, jumps and missing samples."""
    rng = np.random.default_rng(seed)
    plant = random_plant(rng)
    observer = random_observer(plant, rng)
    initial = rng.standard_normal(observer.n) * rng.choice([1.0, 100.0])
    record = simulate(
        plant, until=2.0, step=float(rng.choice([0.02, 0.05, 0.1])), initial=initial,
        disturbance=str(rng.choice(DISTURBANCES)), rng=rng,
    )  # fmt: skip
    return execute(observer, record, initial, rng, drop)


def execute(
    observer: IntervalObserver,
    record: Simulation,
    initial: Any,
    rng: np.random.Generator,
    drop: float,
) -> Run:
    """Run an observer from a random box around the initial state, losing some samples."""
    y = np.where(rng.random((len(record.t), 1)) < drop, np.nan, record.block("y"))
    width = rng.uniform(0, 1, (2, observer.n)) * rng.choice([0.0, 1.0])
    # the record starts after the flow from 0 to its first row, which is at t = 0
    batch = observer.run_batch(
        record.t, y, record.block("u"), np.nan_to_num(record.block("w")), record.columns["jump"],
        lower=initial - width[0], upper=initial + width[1],
    )  # fmt: skip
    assert batch.lower is not None
    assert batch.upper is not None
    return Run(record, batch.lower, batch.upper, batch.status)
