"""Problems: every key is read, defaults are filled in, round trips are exact, values are frozen."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import obsdesign
from obsdesign import Flow, Jump, Output, Problem
from obsdesign.errors import InputError
from obsdesign.kinds import GAINS
from obsdesign.problem.option_table import OPTIONS
from obsdesign.problem.options import IntervalOptions

ROOT = Path(__file__).parents[2]

EVERY_KEY = """
name = "everything"

[flow]
A = [[-1, 0], [1, -2]]
B = [[0], [1]]
D = [[1], [0]]
disturbance = { lower = [-0.1, -0.1], upper = [0.1, 0.1] }

[jump]
G = [[2, 1], [1, 3]]
E = [[0], [1]]
H = [[1], [0]]
disturbance = { lower = [-0.3, -0.3], upper = [0.3, 0.3] }
dwell_time = [0.7, inf]
dwell_jitter = inf

[output]
C = [[0, 1]]
noise_bound = [0.03]
noise_std = [0.0]
noise_cv = [0.0]
measured = "continuous"
period = 0.05
jump_measurement = "before"

[observer]
"""

OBSERVERS = {
    "interval": 'form = "auto"\nobjective = "narrowest"\ngain_limit = 20\nmemory = "auto"\nwidth = "mean"\n'
    "width_weights = [1, 2]\ngain_norm = { M = 4 }\nstructure = { L = [[0], [1]] }\nregion = { decay = 0.1 }\n"
    "gains = { L = [[0], [1]], M = [[1], [2.8]], S = [[1, 0], [0, 1]] }",
    "set_membership": "window = 8\nsteps = 6\nfixed_lag = 2\ndirections = [[1, -1]]",
    "luenberger": "poles = [-1, [-2, 1]]\ndecay_rate = 0.1\nweights = { state = [1, 1] }\nmemory = 2\nschedule = 4\n"
    "gain_norm = { L = 2 }\nstructure = { L = [[1], [0]] }\nregion = { decay = 0.1, sector = 1 }",
    "impulsive": 'window = 3\nalpha = 1.5\nstrategy = "compressed"\ndecay_rate = 0.1\n'
    "noise_target = [0.1, 0.2]",
    "finite_time": 'window = 6\nmethod = "exact"\nobjective = "least_noise"\nhalf_sample_correction = false\n'
    "gains = { L = [[0], [0.1]] }",
    "impulsive_input": 'window = 20\nexponents = [-1, -2]\nmargin = 5\nratio = 0.1\nweighting = "gls"\n'
    'operator = "samples"\nstate_correction = true\nnonnegative = false\ninitial_std = [1, 0]\nthreshold = 1\nsmallest_weight = 1\nuncertainty = [[0, 1], [0, 0]]\npoles = [-1, -2]\nweights = { output = [1] }\ngains = { K = [[0], [1]] }',
    "unknown_input": 'poles = [-1]\nweights = { output = [1] }\ndifferentiator = "fixed_lag"\nlag = 5',
}


@pytest.mark.parametrize("kind", list(GAINS))
def test_every_key_of_every_kind_is_read(kind: str) -> None:
    body = tomllib.loads(EVERY_KEY + f'kind = "{kind}"\n' + OBSERVERS[kind])
    problem = Problem.from_dict(body)
    given = set(body["observer"]) - {"kind", "gains"}
    assert set(problem.options.to_document()) == given == set(OPTIONS[kind])
    assert Problem.from_dict(problem.to_dict()) == problem


def test_a_noise_bound_stays_as_absent_as_it_was() -> None:
    absent = Problem(flow={"A": [[-1]]}, output={"C": [[2]], "noise_std": [0.1]})
    assert absent.plant.output.noise_bound is None
    for again in (Problem.from_dict(absent.to_dict()), absent.for_kind("interval")[0]):
        assert again.plant.output.noise_bound is None
    assert absent != Problem.from_dict(
        absent.to_dict() | {"output": {"C": [[2]], "noise_bound": 0}}
    )


def test_one_number_serves_all_outputs() -> None:
    for name in ("noise_bound", "noise_std", "noise_cv"):
        problem = Problem(flow={"A": [[-1]]}, output={"C": [[2], [1]], name: 0.03})
        assert problem.to_dict()["output"][name] == [0.03, 0.03]
        assert Problem.from_dict(problem.to_dict()) == problem
    with pytest.raises(
        InputError, match=r"^output.noise_bound must be >= 0; got -0.03 for output 1"
    ):
        Problem(flow={"A": [[-1]]}, output={"C": [[2], [1]], "noise_bound": -0.03})


def test_the_normalised_problem_has_the_defaults() -> None:
    problem = Problem(flow={"A": [[-1]]}, jump={"dwell_time": [1, math.inf]}, output={"C": [[2]]})
    assert problem.to_dict() == {
        "name": "plant",
        "flow": {"A": [[-1.0]], "disturbance": {"lower": [0.0], "upper": [0.0]}},
        "jump": {
            "G": [[1.0]],
            "dwell_time": [1.0, "inf"],
            "dwell_jitter": "inf",
            "disturbance": {"lower": [0.0], "upper": [0.0]},
        },
        "output": {
            "C": [[2.0]],
            "noise_std": [0.0],
            "noise_cv": [0.0],
            "measured": "continuous",
            "jump_measurement": "before",
        },
    }


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.toml")), ids=lambda p: p.stem)
def test_toml_and_its_json_twin_are_one_problem(path: Path, tmp_path: Path) -> None:
    problem = obsdesign.load_problem(path)
    twin = tmp_path / "twin.json"
    twin.write_text(json.dumps(problem.to_dict(), allow_nan=False))
    assert obsdesign.load_problem(twin) == problem


def test_blocks_may_be_dataclasses_dicts_or_arrays() -> None:
    A, C = np.array([[-1.0, 0.5], [0, -2]]), np.array([[1.0, 0.0]])
    box = np.array([0.1, 0.2])
    plain = Problem(
        flow={"A": A, "disturbance": {"lower": -box, "upper": box}},
        jump={"G": np.eye(2), "dwell_time": (0.5, math.inf)},
        output={"C": C},
        observer={"kind": "interval", "gains": {"L": np.zeros((2, 1)), "M": np.zeros((2, 1))}},
    )
    made = Problem(
        flow=Flow(A, lower=-box, upper=box),
        jump=Jump(np.eye(2), dwell_time=(0.5, math.inf)),
        output=Output(C),
        observer={"kind": "interval", "gains": {"L": [[0], [0]], "M": [[0], [0]]}},
    )
    assert plain == made


def test_nothing_can_be_changed_afterwards() -> None:
    source = np.array([[-1.0]])
    problem = Problem(flow={"A": source}, output={"C": [[1.0]]})
    source[0, 0] = 5.0
    assert problem.plant.flow.A[0, 0] == -1.0
    with pytest.raises(ValueError, match="read-only"):
        problem.plant.flow.A[0, 0] = 1.0
    with pytest.raises(AttributeError):
        problem.name = "other"
    options = obsdesign.Problem(
        flow={"A": source}, output={"C": [[1.0]]}, observer={"kind": "interval"}
    ).options_as(IntervalOptions)
    with pytest.raises(AttributeError):
        options.form = "split"  # type: ignore[misc]


def large(x: float) -> float:
    """No magnitude below those of a problem."""
    return x if abs(x) >= 1e-150 else 0.0


numbers = st.floats(-1e6, 1e6).map(large)


@st.composite
def problems(draw: Any) -> Problem:
    n, p = draw(st.integers(1, 4)), draw(st.integers(1, 3))

    def matrix(rows: int, columns: int) -> Any:
        return draw(hnp.arrays(np.float64, (rows, columns), elements=numbers))

    lower = matrix(2, n)
    upper = lower + np.abs(matrix(2, n))
    low = draw(st.floats(0, 10).map(large))
    high = draw(st.floats(0.001, 10).map(lambda x: low + x) | st.just(math.inf))
    flow = {"A": matrix(n, n), "disturbance": {"lower": lower[0], "upper": upper[0]}}
    if draw(st.booleans()):
        flow["B"] = matrix(n, draw(st.integers(1, 2)))
    jump = {"G": matrix(n, n), "dwell_time": [low, high],
            "disturbance": {"lower": lower[1], "upper": upper[1]}}  # fmt: skip
    noise = np.abs(matrix(1, p))[0]
    return Problem(
        flow=flow, jump=draw(st.just(jump) | st.none()),
        output={"C": matrix(p, n), "noise_bound": noise},
        observer={"kind": "interval", "gains": {"L": matrix(n, p)}}, name=draw(st.text(max_size=5)),
    )  # fmt: skip


@settings(max_examples=20, deadline=None)
@given(problem=problems())
def test_json_round_trip_is_exact(problem: Problem) -> None:
    text = json.dumps(problem.to_dict(), allow_nan=False)
    again = Problem.from_dict(json.loads(text))
    assert again == problem
    assert json.dumps(again.to_dict(), allow_nan=False) == text


def test_for_kind_drops_what_belongs_to_another() -> None:
    body = tomllib.loads(EVERY_KEY + 'kind = "interval"\n' + OBSERVERS["interval"])
    other, dropped = Problem.from_dict(body).for_kind("luenberger")
    assert other.kind == "luenberger"
    assert not other.gains
    gains = ["gains.L", "gains.M", "gains.S"]
    own = ["form", "objective", "gain_limit", "memory", "width", "width_weights"]
    own += ["gain_norm", "structure", "region"]
    assert dropped == [*gains, *own]
    same, none = Problem.from_dict(body).for_kind("interval")
    assert (same.kind, none) == ("interval", [])
