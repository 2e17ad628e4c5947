"""Plants with measurements at impulses, for tests."""

from __future__ import annotations

from typing import Any

import numpy as np

import obsdesign
from obsdesign.workflow import Outcome


def chain(n: int, diagonal: float = 0.0) -> np.ndarray:
    """Integrators one after the other."""
    return np.diag(np.ones(n - 1), 1) + diagonal * np.eye(n)


def first(n: int) -> np.ndarray:
    return np.eye(n)[:1]


SPLINE = (chain(4), np.diag([1.0, 1.0, 1.0, 0.0]), first(4))
DOUBLE = (chain(2), np.eye(2), first(2))
# a turn per unit of time, measured in one coordinate: half a turn hides the other one
OSCILLATOR = (np.array([[0.0, 2 * np.pi], [-2 * np.pi, 0.0]]), np.eye(2), first(2))


def rebased(plant: Any, seed: int) -> tuple[Any, Any, Any]:
    """The plant in a random basis of moderate condition, in binary64."""
    rng = np.random.default_rng(seed)
    n = len(plant[0])
    while np.linalg.cond(T := rng.standard_normal((n, n))) > 50:
        pass
    back = np.linalg.inv(T)
    return T @ plant[0] @ back, T @ plant[1] @ back, plant[2] @ back


def impulsive_problem(
    plant: Any, dwell: Any, output: Any = None, jump: Any = None, **options: Any
) -> Any:
    A, G, C = (np.asarray(X, dtype=float).tolist() for X in plant)
    return obsdesign.Problem(
        flow={"A": A},
        jump={"G": G, "dwell_time": list(dwell), **(jump or {})},
        output={"C": C, "measured": "at_jumps", **(output or {})},
        observer={"kind": "impulsive", **options},
    )


def investigate(plant: Any, dwell: Any, **more: Any) -> Outcome:
    return obsdesign.investigate(impulsive_problem(plant, dwell, **more))


def plant_gains(A: Any, G: Any, C: Any, **more: Any) -> dict[str, Any]:
    zeros = np.zeros(len(A))
    base = {"A": A, "G": G, "C": C, "flow_lower": zeros, "flow_upper": zeros, "jump_lower": zeros,
            "jump_upper": zeros, "dwell_time": np.array([0.1, 0.8]), "jump_measurement": "before",
            "strategy": "full", "alpha": 1.4}  # fmt: skip
    return base | more


def verdicts(outcome: Outcome) -> dict[str, str]:
    return {claim.id: claim.verdict for claim in outcome.claims}


def claim(outcome: Outcome, name: str) -> Any:
    return next(c for c in outcome.claims if c.id == name)
