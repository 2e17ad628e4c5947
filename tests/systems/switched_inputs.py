"""Records of finite-time observers whose known inputs switch between samples, and exact states.

Samples are taken at t_0 + j nu, their stamps are the nearest binary64 numbers; switches happen at
their stamps. The truth has 50 digits and more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

import obsdesign
from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Plant
from obsdesign.runtime import Sample, from_design
from tests.systems.time_stamps import Tally, Truth

ORIGINS = (0.0, -3.3, 1e3, 1e6, 1.7e9)
METHODS = ("least_squares", "minimax", "exact")  # `approximate` promises no bounds
# parts of a period at which an input switches
PLACES = (0.001, 0.1, 0.5, 0.9, 0.99, 1 - 1e-6)


def with_input(plant: obsdesign.Problem) -> Plant:
    """The plant with its input as a state of slope zero: B u is exact."""
    A, B, C = plant.plant.flow.A, plant.plant.flow.B, plant.plant.output.C
    assert B is not None
    (n, m), V = B.shape, plant.plant.output.noise_bound
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A, B
    return Plant(Flow(whole), None, Output(np.hstack([C, np.zeros((len(C), m))]), noise_bound=V))


@dataclass(frozen=True)
class Row:
    """A row of a record: its instant, its stamp, whether it is a sample; u of (m,) or None."""

    instant: Fraction
    t: float
    is_sample: bool
    u: np.ndarray | None


def rows_of(
    rng: np.random.Generator, origin: float, period: float, count: int, m: int
) -> list[Row]:
    """Samples, and in some periods up to four switches; inputs at samples, too."""
    rows, size = [], float(rng.choice([1.0, 1e3]))
    for j in range(count):
        start = Fraction(origin) + j * Fraction(period)
        is_switched = rng.random() < 0.2
        rows.append(Row(start, float(start), True, _input(rng, m, size) if is_switched else None))
        for place in rng.permutation(PLACES)[: int(rng.choice([0, 1, 1, 4]))]:
            t = float(start + Fraction(period) * Fraction(place))
            rows.append(Row(Fraction(t), t, False, _input(rng, m, size)))
    ordered = sorted(rows, key=lambda row: (row.instant, row.t))
    kept = ordered[:1]
    for row in ordered[1:]:
        if row.t > kept[-1].t and row.instant > kept[-1].instant:
            kept.append(row)
        elif row.is_sample:  # a switch that its stamp does not keep apart from the sample
            kept[-1] = row
    return kept


def _input(rng: np.random.Generator, m: int, size: float) -> np.ndarray:
    return size * rng.choice([-1.0, 1.0], m) * (1 + 0.01 * rng.random(m))


def run(
    problem: obsdesign.Problem,
    observer: Any,
    rows: list[Row],
    rng: np.random.Generator,
    tally: Tally,
) -> float:
    """Put the rows of a record into the tally; return the largest width of a row with status ok."""
    n, plant = problem.plant.n, with_input(problem)
    m = plant.n - n
    truth = Truth(plant, np.concatenate([rng.standard_normal(n), np.zeros(m)]))
    box, state, before, widest = problem.plant.flow, observer.init(rows[0].t), rows[0].instant, 0.0
    for row in rows:
        if row.instant > before:
            b = np.where(rng.random(n) < 0.5, box.lower, box.upper)
            truth.flow(row.instant - before, np.concatenate([b, np.zeros(m)]))
            before = row.instant
        y = truth.measured(rng) if row.is_sample else None
        u = np.zeros(m) if row is rows[0] and row.u is None else row.u
        state, estimate = observer.step(state, Sample(row.t, y, u=u))
        if not observer.constants.has_finite_radius:  # states that no sample shows
            tally.add("finite_time", "without bounds", True)
        elif estimate.status == "ok":
            tally.add("finite_time", "ok", truth.inside(estimate.lower, estimate.upper))
            widest = max(widest, float(np.max(estimate.upper - estimate.lower)))
        else:
            tally.add("finite_time", estimate.status, True)
        if row.u is not None:
            truth.hold(n, row.u)
    return widest


def random_problem(rng: np.random.Generator, method: str) -> obsdesign.Problem:
    """A plant with modes up to 100 per period, some growing, sometimes in seconds, sometimes not."""
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    p = int(rng.integers(1, min(n, 2) + 1))
    period = float(rng.choice([0.25, 0.1, 1.0, 0.003]))
    poles = -(10.0 ** rng.uniform(-2, 2, n))
    poles = np.where(rng.random(n) < 0.15, rng.uniform(0, 1, n), poles)
    A = np.diag(poles) + np.triu(rng.standard_normal((n, n)), 1) * float(rng.choice([0, 1, 10]))
    if n > 1 and rng.random() < 0.3:
        A[1, 0] = -float(rng.choice([1.0, 30.0]))
    V = 10.0 ** rng.uniform(-9, -1, p)
    B = np.round(rng.standard_normal((n, m)), 2) * max(1.0, float(np.abs(poles).max()))
    push = 0.01 * rng.random(n) * float(rng.integers(0, 2))
    observer: dict[str, Any] = {"kind": "finite_time", "method": method}
    observer["window"] = int(rng.integers(n, 3 * n + 2)) * period
    if method == "exact":
        observer["gains"] = {"L": 0.3 * rng.standard_normal((n, p)) / period}
    return obsdesign.Problem(
        flow={
            "A": A / period,
            "B": B / period,
            "disturbance": {"lower": -push / period, "upper": push / period},
        },
        output={
            "C": np.round(rng.standard_normal((p, n)), 2),
            "noise_bound": V,
            "measured": "periodic",
            "period": period,
        },
        observer=observer,
    )


def random_run(seed: int, tally: Tally) -> bool:
    """One record of a random plant; False where it has no proved design with bounds."""
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, METHODS[seed % 3])
    try:
        outcome = obsdesign.investigate(problem)
    except obsdesign.InputError:
        return False
    if outcome.verdict != "proved" or outcome.design is None:
        return False
    period, samples = problem.plant.output.sample_period, int(outcome.design.gains["samples"])
    inputs = outcome.design.gains["B"].shape[1]
    for origin in rng.choice(ORIGINS, 2, replace=False):
        if math.ulp(origin) < 1e-3 * period:
            rows = rows_of(rng, float(origin), period, 2 * samples + 15, inputs)
            run(problem, from_design(outcome.design), rows, rng, tally)
    return True
