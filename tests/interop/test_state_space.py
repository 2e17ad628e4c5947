"""State-space models of other packages become problems, or one line says why not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.signal

from obsdesign import InputError, Problem
from obsdesign.interop import from_state_space

A, B, C, D = [[-1.0, 0.0], [1.0, -2.0]], [[0.0], [1.0]], [[0.0, 1.0]], [[0.0]]


def test_a_state_space_is_a_problem() -> None:
    system = scipy.signal.StateSpace(A, B, C, D)
    problem = from_state_space(
        system, jump={"dwell_time": [1, 2]}, output={"noise_bound": [0.1]}, name="from scipy"
    )
    assert problem == Problem(
        flow={"A": A, "B": B}, jump={"dwell_time": [1, 2]},
        output={"C": C, "noise_bound": [0.1]}, name="from scipy",
    )  # fmt: skip
    control = pytest.importorskip("control", reason="the extra `interop` is not installed")
    assert problem == from_state_space(
        control.ss(A, B, C, D), jump={"dwell_time": [1, 2]}, output={"noise_bound": [0.1]},
        name="from scipy",
    )  # fmt: skip
    # control.StateSpace: dt is 0 in continuous time, matrices may have no columns
    alone = SimpleNamespace(
        A=np.array(A), B=np.zeros((2, 0)), C=np.array(C), D=np.zeros((1, 0)), dt=0
    )
    assert from_state_space(alone).plant.flow.B is None


def test_a_model_in_discrete_time_keeps_its_step() -> None:
    """From scipy, from python-control, and where the step is not stated with it."""
    output = {"noise_bound": [0.1]}
    wanted = Problem(flow={"A": A, "B": B, "dt": 0.1}, output={"C": C, **output})
    system = scipy.signal.StateSpace(A, B, C, D, dt=0.1)
    assert from_state_space(system, output=output) == wanted
    unstated = SimpleNamespace(A=A, B=B, C=C, D=D, dt=True)
    assert from_state_space(unstated, output=output, dt=0.1) == wanted
    for own in (system, scipy.signal.StateSpace(A, B, C, D)):
        with pytest.raises(InputError, match="dt is stated by the system"):
            from_state_space(own, dt=0.2)
    control = pytest.importorskip("control", reason="the extra `interop` is not installed")
    assert from_state_space(control.ss(A, B, C, D, 0.1), output=output) == wanted
    assert from_state_space(control.ss(A, B, C, D, True), output=output, dt=0.1) == wanted


def test_further_blocks_are_given_as_in_a_file() -> None:
    bounds = {"lower": [-1, -1], "upper": [1, 1]}
    problem = from_state_space(
        scipy.signal.StateSpace(A, B, C, D), flow={"D": [[1], [0]], "disturbance": bounds},
        observer={"kind": "unknown_input"}, output={"measured": "periodic", "period": 0.1},
    )  # fmt: skip
    assert problem == Problem(
        flow={"A": A, "B": B, "D": [[1], [0]], "disturbance": bounds},
        output={"C": C, "measured": "periodic", "period": 0.1}, observer={"kind": "unknown_input"},
    )  # fmt: skip
    for block, key in (("flow", "A"), ("flow", "B"), ("output", "C")):
        twice: Any = {block: {key: [[1]]}}
        with pytest.raises(InputError) as error:
            from_state_space(scipy.signal.StateSpace(A, B, C, D), **twice)
        assert str(error.value) == f"{block}.{key} is given by the system; give it once."


@pytest.mark.parametrize(
    ("system", "line"),
    [
        (
            SimpleNamespace(A=A, B=B, C=C, D=D, dt=True),
            "system is in discrete time and does not state its step (dt is True); give it as dt=.",
        ),
        (
            scipy.signal.StateSpace(A, B, C, [[1.0]]),
            "system must have no feedthrough, y = C x; its D is not zero. "
            "Subtract D u from the measurement and set D to zero.",
        ),
        (
            SimpleNamespace(num=[1], den=[1, 1]),
            "system must have matrices A, B, C, D; SimpleNamespace has no A. "
            "Convert a transfer function to a state space first.",
        ),
    ],
)
def test_models_that_are_no_problem(system: Any, line: str) -> None:
    with pytest.raises(InputError) as error:
        from_state_space(system)
    assert str(error.value) == line


def test_parameters_and_a_box_are_given_as_in_a_file() -> None:
    system = scipy.signal.StateSpace([[0, 1], [0, -0.4]], [[0], [0]], [[1, 0]], [[0]])
    stiffness = {"name": "stiffness", "range": [0.8, 1.2], "A": [[0, 0], [-1, 0]]}
    box = {"lower": [-1, -1], "upper": [1, 1]}
    problem = from_state_space(system, parameter=[stiffness], state=box)
    assert [parameter.entry for parameter in problem.plant.parameters] == ["parameter.stiffness"]
    assert problem.to_dict()["state"] == box
