"""Typical magnitudes that gains without a box are chosen for: the same in all units of a file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.analysis.nominal import nominal_problem
from obsdesign.problem.problem import Problem
from obsdesign.synthesis.interval.signal_sizes import SignalSizes
from tests.systems.parameters import Body, spring


def in_units(x: tuple[float, float], y: float, u: float, t: float, **observer: Any) -> Body:
    """A motor turns a spring whose sensor has a gain of 1 +- 5 %; units: x, y, u, t times larger.

    Numbers of a file are divided by these.
    """
    inward, sizes = 1 / np.array(x), np.array(x)

    def flow(A: Any) -> Any:
        return (np.array(A) * sizes * inward[:, None] * t).tolist()

    b, c = [np.array([0, size]) * inward for size in (0.05, 0.3)]
    body = spring(
        flow={
            "A": flow([[0, 1], [0, -0.4]]),
            "B": (np.array([[0.0], [0.2]]) * inward[:, None] * u * t).tolist(),
            "disturbance": {"lower": (-b * t).tolist(), "upper": (b * t).tolist()},
        },
        jump={
            "disturbance": {"lower": (-c).tolist(), "upper": c.tolist()},
            "dwell_time": [2 / t, 6 / t],
        },
        output={
            "C": (np.array([[1.0, 0]]) * sizes / y).tolist(),
            "C_radius": (np.array([[0.05, 0]]) * sizes / y).tolist(),
            "noise_bound": [0.01 / y],
        },
        parameter=[{"name": "stiffness", "range": [0.8, 1.2], "A": flow([[0, 0], [-1, 0]])}],
        observer={"kind": "interval", **observer},
    )
    del body["state"]
    return body


def sizes_of(body: Body) -> SignalSizes:
    problem = Problem.from_dict(body)
    return SignalSizes.from_problem(problem, nominal_problem(problem))


UNITS: list[tuple[tuple[float, float], float, float, float]] = [
    ((1, 1), 1024, 1, 1), ((1, 1), 1, 2.0**-10, 1), ((1, 1), 1, 1, 2.0**-10),
    ((16, 2.0**-7), 1, 1, 1), ((16, 2.0**-7), 1024, 8, 2.0**10),
]  # fmt: skip


@pytest.mark.parametrize(("x", "y", "u", "t"), UNITS)
@pytest.mark.parametrize("damping", [-0.4, 0.2])
def test_magnitudes_are_the_same_in_other_units(
    x: tuple[float, float], y: float, u: float, t: float, damping: float
) -> None:
    """Of a state that decays, and of one that grows, which has no size of its own."""
    plain, other = in_units((1, 1), 1, 1, 1), in_units(x, y, u, t)
    for body, unit in ((plain, 1.0), (other, t)):
        body["flow"]["A"][1][1] = damping * unit
    first, second = sizes_of(plain), sizes_of(other)
    np.testing.assert_allclose(second.x * x, first.x, rtol=1e-6)
    np.testing.assert_allclose(second.y * y, first.y, rtol=1e-6)
    np.testing.assert_allclose(second.u * u, first.u, rtol=1e-6)


def test_magnitudes_follow_what_acts_on_the_plant() -> None:
    plain, kicked = in_units((1, 1), 1, 1, 1), in_units((1, 1), 1, 1, 1)
    for body in (plain, kicked):
        body["flow"]["input_bound"] = [0.0]
    kicked["jump"]["disturbance"] = {"lower": [0, -3.0], "upper": [0, 3.0]}
    calm, driven = sizes_of(plain), sizes_of(kicked)
    assert (driven.x > 5 * calm.x).all()
    assert driven.y[0] > 5 * calm.y[0] > 0.05
    assert calm.u == pytest.approx([0.0])


def test_gains_are_the_same_in_other_units_of_the_output() -> None:
    gains = [
        obsdesign.design(Problem.from_dict(in_units((1, 1), y, 1, 1, form="split"))).gains
        for y in (1.0, 1e-3, 1e3)
    ]
    for own, y in zip(gains, (1.0, 1e-3, 1e3), strict=True):
        for name in ("L", "M", "flow_correction"):
            np.testing.assert_allclose(own[name] / y, gains[0][name], rtol=1e-6, atol=1e-9)
