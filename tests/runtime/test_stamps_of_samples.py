"""Samples that are not taken at their stamps: what the refusal of `time_error` says to state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import obsdesign
from obsdesign.problem.problem import Problem
from obsdesign.runtime import from_design
from obsdesign.runtime.base import rows_of

A = np.array([[-0.5, 1.0], [-1.0, -0.5]])
NOISE, ERROR = 0.01, 0.1
LARGEST_RATE = 1.3  # of x1 along the trajectory from (1, 0)


def problem(kind: str, noise_bound: float) -> Problem:
    """Two states, of which the first is read at irregular times."""
    sensor = {"name": "y", "C": [[1, 0]], "noise_bound": noise_bound, "every": [0.3, 0.5]}
    observer: dict[str, Any] = {"kind": kind}
    return Problem(flow={"A": A}, sensor=[sensor], observer=observer)


@pytest.mark.parametrize("kind", ["interval", "set_membership"])
def test_a_noise_bound_with_the_rate_of_the_reading_is_enough(kind: str) -> None:
    rng = np.random.default_rng(0)
    stamps = np.cumsum(rng.uniform(0.3, 0.5, 60))
    taken = stamps + ERROR * rng.choice([-1.0, 1.0], len(stamps))
    x, read = (np.array([expm(A * t) @ [1.0, 0.0] for t in times]) for times in (stamps, taken))
    assert (np.abs(read @ A[0]) <= LARGEST_RATE).all()
    y = read[:, :1] + NOISE * rng.choice([-1.0, 1.0], (len(stamps), 1))
    voids = []
    for noise_bound in (NOISE + ERROR * LARGEST_RATE, NOISE):
        design = obsdesign.design(problem(kind, noise_bound))
        observer: Any = from_design(design)
        state = observer.init(0.0, lower=[0.9, -0.1], upper=[1.1, 0.1])
        listed = list(observer.run(state, rows_of(stamps, y)))
        voids.append(sum(each.status != "ok" for each in listed))
        if noise_bound > NOISE:
            lower, upper = (
                np.array([getattr(e, end) for e in listed]) for end in ("lower", "upper")
            )
            assert (lower <= x + 1e-12).all()
            assert (x - 1e-12 <= upper).all()
    assert voids[0] == 0
    assert voids[1] > 0  # the twin: the noise alone contradicts them
