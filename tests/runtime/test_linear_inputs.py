"""Known inputs that are linear between rows: with u as a state whose slope is the input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import obsdesign
from lmi.arithmetic.exponential import expm
from obsdesign.runtime import Sample, from_design
from tests.systems.designs import designed

A, B = np.array([[0.0, 1.0], [-2.0, -0.5]]), np.array([[0.0], [1.0]])
C = np.array([[1.0, 0.0]])
G = np.diag([1.0, 0.2])
FINITE = {"measured": "periodic", "period": 0.1}, {"kind": "finite_time", "window": 0.5}
IMPULSIVE = {"measured": "at_jumps"}, {"kind": "impulsive"}


def design(case: tuple[dict[str, Any], dict[str, Any]], with_slope: bool) -> obsdesign.Design:
    """The observer of the plant; with_slope: of (x, u), whose known input is the slope of u."""
    output, observer = case
    flow, jump, rows = {"A": A, "B": B}, G, C
    if with_slope:
        flow = {"A": np.block([[A, B], [np.zeros((1, 3))]]), "B": np.array([[0.0], [0.0], [1.0]])}
        jump, rows = np.diag([1.0, 0.2, 1.0]), np.array([[1.0, 0, 0], [0, 0, 1.0]])
    body: dict[str, Any] = {
        "flow": {name: matrix.tolist() for name, matrix in flow.items()},
        "output": {"C": rows.tolist(), **output},
        "observer": observer,
    }
    if observer["kind"] == "impulsive":
        body["jump"] = {"G": jump.tolist(), "dwell_time": [0.3, 0.8]}
    return designed(body)


def late_error(case: tuple[dict[str, Any], dict[str, Any]], with_slope: bool) -> float:
    """The largest error of x over the last rows of an exact trajectory, u linear between rows."""
    kind, rng, rows = case[1]["kind"], np.random.default_rng(3), 60
    steps = rng.uniform(0.3, 0.8, rows) if kind == "impulsive" else np.full(rows, 0.1)
    t, u = np.concatenate([[0.0], np.cumsum(steps[1:])]), rng.standard_normal(rows)
    observer: Any = from_design(design(case, with_slope))
    x = np.array([1.0, -1.0])
    state = observer.init(t=0.0, x=np.zeros(2 + with_slope))
    chain = np.zeros((4, 4))
    chain[:2, :2], chain[:2, 2:3], chain[2, 3] = A, B, 1.0
    errors = []
    for k in range(rows):
        slope = 0.0 if k + 1 == rows else (u[k + 1] - u[k]) / (t[k + 1] - t[k])
        y = np.append(C @ x, u[k]) if with_slope else C @ x
        jumps = kind == "impulsive"
        x = G @ x if jumps else x
        known = np.array([slope if with_slope else u[k]])
        state, estimate = observer.step(state, Sample(t[k], y=y, u=known, jump=jumps))
        errors.append(float(np.abs(estimate.x[:2] - x).max()))
        if k + 1 < rows:
            x = (expm(chain * (t[k + 1] - t[k])) @ np.array([*x, u[k], slope]))[:2]
    return max(errors[rows // 2 :])


@pytest.mark.parametrize("case", [FINITE, IMPULSIVE], ids=lambda case: case[1]["kind"])
def test_inputs_linear_between_rows_are_exact_by_the_recipe(case: Any) -> None:
    assert late_error(case, with_slope=True) < 1e-9
    # the twin: the same u, held from row to row, is another input
    assert late_error(case, with_slope=False) > 1e-2
