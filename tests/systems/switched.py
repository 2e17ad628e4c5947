"""Plants with modes for tests: the valve of the examples, and others."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np

import obsdesign
from obsdesign.problem.problem import Problem

VALVE = Path(__file__).parents[2] / "examples" / "valve.toml"


def valve(
    *, longest_closed: float = 10.0, strokes: bool = False, **observer: object
) -> Problem:  # fmt: skip
    """The valve, closed for at most so long; observer: entries of [observer] in place of its own.

    Gains of the modes are left out where the observer is replaced. strokes: with those of the pump.
    """
    body = copy.deepcopy(obsdesign.load_problem(VALVE).to_dict())
    if not strokes:
        del body["event"]
    body["mode"][1]["every"] = [1.0, longest_closed]
    if observer:
        body["observer"] = observer
        for mode in body["mode"]:
            del mode["gains"]
    return Problem.from_dict(body)


def random_strokes(rng: np.random.Generator, kind: str) -> Problem:
    """One of `random_switched` with one or two events, some of them in some of its modes alone.

    For point observers maps of events are the identity.
    """
    body = random_switched(rng, kind).to_dict()
    output, n, names = body.pop("output"), len(body["flow"]["A"]), [m["name"] for m in body["mode"]]
    sensor = {"name": "level", "C": output["C"], "noise_bound": output["noise_bound"]}
    body["sensor"] = [
        sensor | {"every": "continuous", "sees": str(rng.choice(["before", "after"]))}
    ]
    events: list[dict[str, Any]] = []
    for name in ("stroke", "refill")[: int(rng.integers(1, 3))]:
        event: dict[str, Any] = {
            "name": name,
            "every": [rng.uniform(0.3, 2), rng.choice([5.0, np.inf])],
        }
        if rng.random() < 0.6:
            event["modes"] = names[: int(rng.integers(1, len(names) + 1))]
        if rng.random() < 0.4 and kind == "interval":
            event["G"] = np.eye(n) + 0.1 * rng.normal(size=(n, n))
        if rng.random() < 0.5:
            event["E"] = rng.normal(size=(n, int(rng.integers(1, 3))))
        if rng.random() < 0.7:
            event["disturbance"] = {"lower": np.full(n, -0.1), "upper": np.full(n, 0.2)}
        events.append(event)
    return Problem.from_dict(body | {"event": events})


def random_switched(rng: np.random.Generator, kind: str) -> Problem:
    """A plant with two or three modes; some with maps on entry, outputs, inputs of their own."""
    n, count = int(rng.integers(1, 4)), int(rng.integers(2, 4))
    modes: list[dict[str, Any]] = []
    for name in ("fill", "heat", "drain")[:count]:
        A = rng.normal(size=(n, n))
        A -= (np.linalg.eigvals(A).real.max() + rng.uniform(0.1, 1)) * np.eye(n)
        mode = {"name": name, "A": A, "every": [rng.uniform(0.5, 1), rng.choice([3.0, np.inf])]}
        if rng.random() < 0.5:
            mode["G"] = np.eye(n) + 0.3 * rng.normal(size=(n, n))
        if rng.random() < 0.5:
            mode["C"] = rng.normal(size=(1, n))
        if rng.random() < 0.5:
            mode["disturbance"] = {"lower": np.full(n, -0.2), "upper": np.full(n, 0.1)}
        if rng.random() < 0.5:
            mode["B"] = rng.normal(size=(n, 1))
        modes.append(mode)
    box = {"lower": np.full(n, -0.1), "upper": np.full(n, 0.1)}
    noise = [[-0.01, 0.03]] if rng.random() < 0.3 else 0.02
    return Problem(
        flow={"A": modes[0]["A"], "B": np.ones((n, 1)), "disturbance": box},
        output={"C": rng.normal(size=(1, n)), "noise_bound": noise},
        mode=modes,
        observer={"kind": kind},
    )
