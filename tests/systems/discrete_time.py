"""Plants in discrete time, their exact trajectories and their feasible sets."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.optimize import linprog

from lmi.arithmetic.arrays import Matrix
from obsdesign.problem.problem import Problem
from obsdesign.runtime.base import Sample


def two_rates(speed: int, position: int) -> dict[str, Any]:
    """Position, speed, force; two sensors that are silent for at most so many steps of 0.1."""
    return {
        "name": "two rates",
        "flow": {
            "dt": 0.1,
            "A": [[1, 0.1, 0], [0, 1, 0.1], [0, 0, 0.98]],
            "disturbance": {"lower": [0, -0.001, -0.01], "upper": [0, 0.001, 0.01]},
        },
        "sensor": [
            {
                "name": "speed", "C": [[0, 1, 0]], "noise_bound": 0.05,
                "every": [0, round(0.1 * speed, 6)],
            },
            {
                "name": "position", "C": [[1, 0, 0]], "noise_bound": 0.02,
                "every": [0, round(0.1 * position, 6)],
            },
        ],
        "observer": {"kind": "interval"},
    }  # fmt: skip


def turning(kind: str, **output: Any) -> dict[str, Any]:
    """Two states that turn into each other, one of them measured."""
    return {
        "flow": {
            "dt": 0.1, "A": [[0.9, 0.2], [-0.2, 0.9]], "B": [[0.1], [0]],
            "disturbance": {"lower": [-0.01, -0.02], "upper": [0.01, 0.02]},
        },
        "output": {"C": [[1, 0]], "noise_bound": 0.05, **output},
        "observer": {"kind": kind},
    }  # fmt: skip


def pulsed(kind: str = "interval") -> dict[str, Any]:
    """Two states that decay, an event that swaps them after 3 to 5 steps, two sensors."""
    return {
        "flow": {
            "dt": 0.5, "A": [[0.75, 0.25], [0, 0.5]],
            "disturbance": {"lower": [-0.125, 0], "upper": [0.125, 0.25]},
        },
        "event": [
            {
                "name": "swap", "G": [[0, 1], [1.5, 0]], "every": [1.5, 2.5], "E": [[1], [0]],
                "disturbance": {"lower": [0, -0.25], "upper": [0, 0.25]},
            }
        ],
        "sensor": [
            {"name": "first", "C": [[1, 0]], "noise_bound": 0.25, "every": 0.5, "losses": 1},
            {
                "name": "second", "C": [[1, 1]], "noise_bound": [[-0.5, 0.25]], "every": [0, 2],
                "sees": "after",
            },
        ],
        "observer": {"kind": kind},
    }  # fmt: skip


def exact_record(
    problem: Problem, x0: Sequence[Fraction], rows: int, rng: np.random.Generator
) -> tuple[list[Sample], list[list[Fraction]]]:
    """Samples and true states, in rational arithmetic: disturbances and noise at their corners.

    All times that the clocks of the plant allow; y is rounded to a float inside its bounds.
    """
    plant, dt = problem.plant, problem.plant.flow.dt
    assert dt is not None
    x, samples, truth = list(x0), list[Sample](), list[list[Fraction]]()
    A, last = _rational(plant.flow.A), [0] * len(plant.sensors)
    since = [0] * len(plant.events)
    for k in range(rows):
        if k:
            b = _corner(*plant.flow.b_bounds, rng)
            x = [sum(row[j] * x[j] for j in range(len(x))) + d for row, d in zip(A, b, strict=True)]
        before, events = x, list[int]()
        for place, event in enumerate(plant.events):
            low, high = (round(end / dt) for end in event.dwell_time or (1, 10))
            if (age := k - since[place]) >= low and (age == high or rng.random() < 0.5):
                G, c = _rational(event.G), _corner(*event.c_bounds, rng)
                x = [
                    sum(g * v for g, v in zip(r, x, strict=True)) + d
                    for r, d in zip(G, c, strict=True)
                ]
                since[place] = k
                events.append(place)
        y = []
        for place, sensor in enumerate(plant.sensors):
            due = k - last[place] >= round(sensor.gap / dt)
            seen = x if sensor.jump_measurement == "after" else before
            if k and not due and rng.random() < 0.6:
                y += [np.nan] * len(sensor.C)
                continue
            last[place] = k
            y += _measured(sensor, seen, rng)
        w = np.zeros(sum(event.inputs for event in plant.events))
        happens = {"jump": bool(events), "events": tuple(events)}
        u = np.zeros(0 if plant.flow.B is None else plant.flow.B.shape[1])
        samples.append(Sample(round(k * dt, 9), y=y, u=u, w=w if len(w) else None, **happens))
        truth.append(x)
    return samples, truth


def _measured(sensor: Any, x: Sequence[Fraction], rng: np.random.Generator) -> list[float]:
    C, values = _rational(sensor.C), []
    bound = np.asarray(sensor.noise_bound, dtype=np.float64)
    lower, upper = (-bound, bound) if bound.ndim == 1 else (bound[:, 0], bound[:, 1])
    for row, low, high in zip(C, lower, upper, strict=True):
        clean = sum(c * v for c, v in zip(row, x, strict=True))
        share = Fraction(int(rng.integers(0, 1025)), 1024)
        value = float(clean + Fraction(low) + share * (Fraction(high) - Fraction(low)))
        ends = (clean + Fraction(low), clean + Fraction(high))
        while Fraction(value) < ends[0]:
            value = float(np.nextafter(value, np.inf))
        while Fraction(value) > ends[1]:
            value = float(np.nextafter(value, -np.inf))
        values.append(value)
    return values


def _corner(lower: Matrix, upper: Matrix, rng: np.random.Generator) -> list[Fraction]:
    ends = np.where(rng.random(len(lower)) < 0.5, lower, upper)
    return [Fraction(end) for end in ends.tolist()]


def _rational(matrix: Matrix) -> list[list[Fraction]]:
    return [[Fraction(x) for x in row] for row in matrix.tolist()]


def feasible_bounds(problem: Problem, box: Matrix, samples: Sequence[Sample]) -> Matrix:
    """Bounds (2, n) of the state after the last row, by linear programs over all rows (HiGHS).

    box (2, n): before the first row; a plant without events, a row for some of its steps.
    """
    plant, n = problem.plant, problem.plant.n
    flow, dt, C = plant.flow, plant.flow.dt, plant.outputs.C
    assert dt is not None
    radius, columns = plant.outputs.noise_radius, flow.disturbance_columns
    assert radius is not None
    ends = [np.stack([box[0], box[1]], axis=1)]
    Z, known, rows, sides = np.eye(n), np.zeros(n), [], []
    u, t = np.zeros(0 if flow.B is None else flow.B.shape[1]), samples[0].t
    for sample in samples:
        for _ in range(round((sample.t - t) / dt)):
            Z = np.hstack([flow.A @ Z, columns])
            known = flow.A @ known + (0 if flow.B is None else flow.B @ u)
            ends.append(np.stack([flow.lower, flow.upper], axis=1))
        t, u = sample.t, u if sample.u is None else np.asarray(sample.u)
        y = np.full(len(C), np.nan) if sample.y is None else np.asarray(sample.y, dtype=float)
        for row, value, v in zip(C, y, radius, strict=True):
            if np.isfinite(value):
                rows.append(row @ Z)
                sides.append((value - v - row @ known, value + v - row @ known))
    size = Z.shape[1]
    H = np.array([np.pad(row, (0, size - len(row))) for row in rows])
    low, high = np.array(sides).T
    limits = {"A_ub": np.vstack([H, -H]), "b_ub": np.concatenate([high, -low])}
    limits["bounds"] = np.vstack(ends)
    lower = [linprog(row, **limits, method="highs").fun for row in Z]
    upper = [-linprog(-row, **limits, method="highs").fun for row in Z]
    return np.array([lower, upper]) + known
