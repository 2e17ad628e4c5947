"""Units of states and outputs of an interval observer: widths are those of its own units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from obsdesign.problem.flow import Flow
from obsdesign.problem.output import Output
from obsdesign.problem.plant import Jump, Plant
from obsdesign.runtime import Sample, from_design
from tests.systems.designs import designed
from tests.systems.interval_runs import observer_for

A, G = np.array([[-0.23, 0.4], [-0.3, -0.74]]), np.array([[-0.35, -0.7], [0.6, -0.63]])
C, y = np.array([[-0.3, 0.42], [1.3, 3.7]]), np.array([0.1, -0.2])
L, M = np.array([[0.5, 0.1], [-0.2, 0.3]]), np.array([[0.1, -0.1], [0.05, 0.1]])


def bounds(states: Any, outputs: Any, h: float) -> tuple[np.ndarray, np.ndarray]:
    """(lower, upper) of five steps with a jump, x = states * x_own, y = outputs * y_own."""
    own, gain = states[:, None] / states, states[:, None] / outputs
    plant = Plant(
        Flow(A * own, lower=0.1 * states, upper=0.3 * states),
        Jump(G * own, lower=0.1 * states, upper=0.3 * states, dwell_time=(2 * h, 3 * h)),
        Output(C * outputs[:, None] / states, noise_bound=outputs, jump_measurement="before"),
    )
    observer = observer_for(plant, L * gain, M * gain)
    state, rows = observer.init(0.0, lower=-states, upper=states), []
    for k in range(1, 6):
        state, row = observer.step(state, Sample(k * h, y=outputs * y, jump=k == 3))
        assert row.status == "ok"
        rows.append((row.lower / states, row.upper / states))
    lower, upper = np.array(rows).transpose(1, 0, 2)
    return lower, upper


@settings(max_examples=16, deadline=None)
@given(
    powers=st.tuples(*[st.integers(-60, 60)] * 4), h=st.sampled_from([0.01, 0.3, 1.3, 6.0, 30.0])
)
def test_bounds_follow_units_that_are_powers_of_two(powers: tuple[int, ...], h: float) -> None:
    units = np.exp2(powers)
    lower, upper = bounds(np.ones(2), np.ones(2), h)
    scaled = bounds(units[:2], units[2:], h)
    np.testing.assert_allclose(scaled[1] - scaled[0], upper - lower, rtol=1e-9)
    np.testing.assert_allclose(scaled[0], lower, rtol=1e-9, atol=1e-9 * np.abs(lower).max())


# two tanks of 1e-4 and 1e-8, in a time unit of 1e-4, whose sensors read 1e-9 and 1e7
TANKS = {
    "flow": {"A": [[-2.3e-5, 0.32], [-3.3e-9, -7.4e-5]],
             "disturbance": {"lower": [1.1e-9, 0.0], "upper": [2.9e-9, 1e-14]}},
    "output": {"C": [[-3.1e-5, 0.42], [1.3e11, 3.7e15]], "measured": "continuous",
               "noise_bound": [[-1.4e-9, -1.4e-9], [1.6e7, 4.6e7]]},
    "jump": {"G": [[-0.35, -6800.0], [6.7e-5, -0.63]], "dwell_time": [4000.0, 8000.0],
             "disturbance": {"lower": [1.1e-5, 0.0], "upper": [2.9e-5, 1e-10]}},
    "observer": {"kind": "interval", "gains": {"L": [[0.0, 8.6486e-17], [0.0, 0.0]],
                                               "M": [[0.0, -1.83783784e-12], [0.0, 0.0]]}},
}  # fmt: skip


@pytest.mark.parametrize("h", [4000.0, 5000.0, 5488.858815315764, 5600.0, 6000.0])
def test_a_claimed_width_holds_in_any_units(h: float) -> None:
    design = designed(TANKS)
    (claim,) = (claim for claim in design.claims if claim.id == "sampled_width")
    width = np.array(claim.evidence["always"])
    observer = from_design(design)
    state = observer.init(0.0, lower=[-3.2e-5, -4.6e-9], upper=[5.2e-5, 8.0e-9])
    _, row = observer.step(state, Sample(h, y=[-1.67e-9, 3.72e7]))
    assert row.status == "ok"
    assert (row.upper - row.lower <= width).all()
