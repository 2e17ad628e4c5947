"""What synthesis chose itself refutes nothing: another choice may do, and here it does.

For each kind a problem for which the window, gain, coordinates or strategy that is chosen fails,
the entry with which the same problem is proved, and a twin that stays refuted.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

import obsdesign

Body = dict[str, Any]


def changed(body: Body, **entries: Any) -> Body:
    """A copy with entries `block__name` set, or dropped where they are None."""
    result = copy.deepcopy(body)
    for path, value in entries.items():
        block, _, name = path.partition("__")
        result.setdefault(block, {})[name] = value
        if value is None:
            del result[block][name]
    return result


def verdict(body: Body) -> str:
    return obsdesign.investigate(obsdesign.Problem.from_dict(body)).verdict


# a gain at rest that is placed in floats refutes nothing, the same gain as given does
PLACED: Body = {
    "flow": {"A": [[0, 0], [0, 0]]},
    "jump": {"G": [[0, 0], [0, 5]], "dwell_time": [1, 1]},
    "output": {"C": [[1, 0], [0, 1]]},
    "observer": {"kind": "luenberger", "poles": [-1, -2], "gains": {"M": [[0, 0], [0, 0]]}},
}
ONE_OUTPUT = {"output__C": [[0, 1]], "observer__poles": None,
              "observer__gains": {"L": [[2], [3]], "M": [[0], [0]]},
              "flow__A": [[0, 0], [1, 0]], "jump__G": [[9, 0], [0, 9]]}  # fmt: skip

# e^(A T) = e^((A + L C) T) at two samples, the window that is chosen, but not at three
TURNING: Body = {
    "flow": {"A": [[0, 1], [-1, 0]]},
    "output": {"C": [[1, 0]], "measured": "periodic", "period": math.pi / 2},
    "observer": {"kind": "finite_time", "method": "approximate", "gains": {"L": [[0], [-8]]}},
}

# the half turn hides the oscillation from windows on all three states, which all decay
DECAYING: Body = {
    "flow": {"A": [[-0.5, 0, 0], [0, -0.5, 1], [0, -1, -0.5]]},
    "jump": {"G": np.eye(3).tolist(), "dwell_time": [3, 3.3]},
    "output": {"C": [[1, 1, 0]], "measured": "at_jumps"},
    "observer": {"kind": "impulsive", "strategy": "subspace"},
}

# I - L C = P diag(size, -size) P^-1: its absolute value grows, but not in the coordinates P
OBLIQUE = np.array([[1.0, 1.0], [0.5, 1.0]])


def oblique(size: float) -> Body:
    K = OBLIQUE @ np.diag([size, -size]) @ np.linalg.inv(OBLIQUE)
    return {
        "flow": {
            "A": [[-1e-3, 0], [0, -1e-3]],
            "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]},
        },
        "output": {"C": [[1, 0], [0, 1]], "noise_bound": [0.1, 0.1], "measured": "periodic",
                   "period": 0.1},
        "observer": {"kind": "interval", "form": "coordinates",
                     "gains": {"L": (np.eye(2) - K).tolist()}},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("body", "cured", "twin"),
    [
        (PLACED, {"observer__poles": None,
                  "observer__gains": {"L": [[1, 0], [0, 2]], "M": [[0, 0], [0, 0]]}}, ONE_OUTPUT),
        (TURNING, {"observer__window": 3 * math.pi / 2}, {"observer__window": math.pi}),
        (TURNING, {"observer__method": "exact"}, {"observer__gains": {"L": [[0], [0]]}}),
        (DECAYING, {"observer__strategy": "auto"}, {"observer__strategy": "full"}),
        (DECAYING, {"observer__strategy": "quadratic"}, {"flow__A": np.eye(3).tolist()}),
    ],
    ids=["poles", "window", "method", "strategy", "subspace"],
)  # fmt: skip
def test_another_choice_does(body: Body, cured: Body, twin: Body) -> None:
    assert verdict(body) == "undecided"
    assert verdict(changed(body, **cured)) == "proved"
    assert verdict(twin if "flow" in twin else changed(body, **twin)) == "refuted"


def test_coordinates_are_chosen_where_they_are_open() -> None:
    assert verdict(oblique(0.9)) == "proved"
    assert verdict(oblique(1.1)) == "refuted"


def defective(size: float, rate: float = 0.9) -> Body:
    """Both eigenvalues -rate, one eigenvector: no basis of eigenvectors to choose."""
    return {
        "flow": {"A": [[size - rate, -size], [size, -size - rate]]},
        "output": {"C": [[1, 0]], "noise_bound": 0.1},
        "observer": {"kind": "interval", "gains": {"L": [[0], [0]]}},
    }


@pytest.mark.parametrize("size", [0.7, 3.0, 11.0])
def test_coordinates_are_open_where_eigenvectors_are_no_basis(size: float) -> None:
    assert verdict(defective(size)) == "proved"
    assert verdict(changed(defective(size), observer__form="split")) == "refuted"
    assert verdict(defective(size, -0.1)) == "refuted"


def resting(A: float, jump: Body | None, **observer: Any) -> Body:
    more = {} if jump is None else {"jump": jump}
    return {"flow": {"A": [[A]]}, "output": {"C": [[1]], "noise_bound": 0.1},
            "observer": {"kind": "interval", **observer}} | more  # fmt: skip


@pytest.mark.parametrize("A", [0.0, 1e-12, -1e-12])
@pytest.mark.parametrize("objective", ["feasible", "narrowest"])
def test_a_plant_at_rest_leaves_room_for_gains(A: float, objective: str) -> None:
    """Gains are large against the rate of the jumps, where the flow does next to nothing."""
    for jump in ({"G": [[-1]], "dwell_time": [1, "inf"]}, {"G": [[2]], "dwell_time": [0, 3]},
                 {"G": [[1]], "dwell_time": [1e-3, "inf"]}):  # fmt: skip
        body = resting(A, jump, objective=objective)
        assert verdict(body) == "proved"
        # the twin: without gains the width stays
        unmoved = changed(body, observer__gains={"L": [[0]], "M": [[0]]})
        assert A < 0 or verdict(unmoved) == "refuted"
    assert verdict(resting(0.0, None, objective=objective)) == "proved"


def empty_image(**more: Any) -> Body:
    """Each jump leaves zero, whatever was before it."""
    return {
        "flow": {"A": [[0, 3], [-3, 0]]},
        "jump": {"G": [[0, 0], [0, 0]], "dwell_time": [1, 2]},
        "output": {"C": [[1, 1]], "measured": "at_jumps", "jump_measurement": "after"},
        "observer": {"kind": "impulsive", **more},
    }


@pytest.mark.parametrize("more", [{"window": 3}, {"strategy": "compressed"}, {"window": 1}])
def test_no_state_after_a_jump_is_no_witness(more: Body) -> None:
    assert verdict(empty_image()) == "proved"
    assert verdict(empty_image(**more)) == "undecided"
    if "strategy" not in more:
        single = {"flow__A": [[-1.3]], "jump__G": [[0]], "output__C": [[-0.3]]}
        assert verdict(changed(empty_image(**more), **single)) == "undecided"
    # the twin: a jump that leaves one direction, and outputs that do not show it
    hidden = {"jump__G": [[1, 0], [0, 0]], "flow__A": [[1, 0], [0, 1]], "output__C": [[0, 1]]}
    assert verdict(changed(empty_image(**more), **hidden)) == "refuted"


# --- impulsive_input: window, K, exponents and operator ----------------------------------------------


def cascade(n: int, period: float = 0.02, dwell: float = 6.0, **observer: Any) -> Body:
    """A chain of compartments in which a few samples, close together, hardly show all states."""
    A = -np.diag(np.linspace(0.5, 2, n)) + np.diag(np.ones(n - 1), -1)
    return {
        "flow": {"A": A.tolist()},
        "jump": {"H": [[1]] + [[0]] * (n - 1), "dwell_time": [dwell, "inf"]},
        "output": {"C": [[1] * n], "measured": "periodic", "period": period, "noise_std": [0.01]},
        "observer": {"kind": "impulsive_input", **observer},
    }


@pytest.mark.parametrize(
    ("n", "operator"), [(6, {"operator": "samples"}), (10, {"operator": "samples"})]
)
def test_a_window_that_is_open_grows_until_it_shows_the_state(n: int, operator: Body) -> None:
    design = obsdesign.design(obsdesign.Problem.from_dict(cascade(n, **operator)))
    assert design.gains["operator"] == "samples"
    assert design.gains["window"] < 6
    assert obsdesign.verify(design).verdict == "proved"
    # the twins: a window that is given is judged by itself, and so is a state that is not seen
    assert verdict(cascade(n, operator="samples", window=0.1)) == "refuted"
    assert verdict(changed(cascade(n, **operator), output__C=[[1] + [0] * (n - 1)])) == "refuted"


def test_a_state_that_no_window_showed_is_undecided() -> None:
    # many compartments: too much alike for the windows tried, which is not proved of all of them
    assert verdict(cascade(15, operator="samples")) == "undecided"


def test_where_samples_show_the_interval_of_an_onset_alone_they_are_taken() -> None:
    one = cascade(1, period=0.2, dwell=2.0)
    design = obsdesign.design(obsdesign.Problem.from_dict(one))
    assert design.gains["operator"] == "samples"
    assert verdict(changed(one, observer__operator="integral")) == "proved"
    assert verdict(changed(one, observer__operator="samples")) == "proved"


def test_a_dwell_time_that_holds_no_window_is_refuted() -> None:
    for dwell, operator, expected in ((0.01, {}, "refuted"), (0.0, {}, "refuted"),
                                      (0.03, {"operator": "integral"}, "refuted"),
                                      (0.03, {}, "undecided")):  # fmt: skip
        assert verdict(cascade(2, dwell=dwell, **operator)) == expected


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"exponents": [-1.0, -3.0]}, "undecided"),  # the eigenvalue of A - K C, K chosen
        ({"exponents": [-1.0, -3.0], "gains": {"K": [[0.5]]}}, "refuted"),
        ({"exponents": [-3.0, -4.0]}, "proved"),
        ({"exponents": [-3.0]}, "refuted"),  # one feature for two unknowns, whatever K
    ],
)
def test_exponents_are_judged_with_the_gain_that_is_given(given: Body, expected: str) -> None:
    body = {
        "flow": {"A": [[-0.5]]},
        "jump": {"H": [[1]], "dwell_time": [3, "inf"]},
        "output": {"C": [[1]]},
        "observer": {"kind": "impulsive_input", "window": 1, **given},
    }
    assert verdict(body) == expected
