"""Gains and options against kind and plant: exact lines, exact round trips, and never a traceback."""

from __future__ import annotations

import copy
import json
import math
import pickle
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign
from docs import problem_schema
from obsdesign import Flow, InputError, Jump, Output, Problem
from obsdesign.kinds import GAINS, KINDS
from obsdesign.problem.option_table import OPTIONS
from obsdesign.problem.options import (
    ImpulsiveInputOptions,
    ImpulsiveOptions,
    IntervalOptions,
    LuenbergerOptions,
)
from obsdesign.problem.problem import load_for_kind

PLANT: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "D": [[1], [0]]},
    "jump": {"dwell_time": [0.7, "inf"]},
    "output": {"C": [[0, 1]]},
}
SCHEMA = json.loads(files("obsdesign").joinpath("problem/problem.schema.json").read_text("utf-8"))


def problem_of_kind(kind: str, plant: dict[str, Any] = PLANT, **observer: Any) -> Problem:
    return Problem.from_dict(copy.deepcopy(plant) | {"observer": {"kind": kind} | observer})


FAULTS: list[tuple[str, dict[str, Any], str]] = [
    ("interval", {"gain_limit": math.nan}, "observer.gain_limit must be a finite number; got nan."),
    ("interval", {"gain_limit": math.inf}, "observer.gain_limit must be a finite number; got inf."),
    ("interval", {"gain_limit": 10**400}, f"observer.gain_limit must be a finite number; got 1{'0' * 56}...."),
    ("interval", {"memory": 2.5}, 'observer.memory must be "auto" or a whole number >= 0; got 2.5.'),
    ("interval", {"memory": True}, 'observer.memory must be "auto" or a whole number >= 0; got True.'),
    ("interval", {"gains": {"S": [[1, 1], [1, 1]]}}, "observer.gains.S must be invertible; in floating point its rank is 1, of 2."),
    ("interval", {"gains": {"M": [[1, 2]]}}, "observer.gains.M must be 2x1 (n x p, n states, p outputs); got 1x2. Is it transposed?"),
    ("interval", {"gains": {"M": []}}, "observer.gains.M must be a matrix: a list of rows of numbers, all equally long; got []."),
    ("luenberger", {"poles": [-1, math.nan]}, "observer.poles, entry 2 must be a finite number; got nan."),
    ("luenberger", {"decay_rate": -1}, "observer.decay_rate must be a number >= 0; got -1."),
    ("luenberger", {"weights": {"output": [1, 1]}}, "observer.weights.output must have 1 entry, one per output; got 2."),
    ("luenberger", {"weights": {"state": [1]}}, "observer.weights.state must have 2 entries, one per state; got 1."),
    ("luenberger", {"schedule": [1, 1]}, "observer.schedule must be increasing; got [1.0, 1.0]."),
    ("impulsive", {"alpha": 1}, "observer.alpha must be a number > 1; got 1."),
    ("impulsive", {"window": 0}, "observer.window must be a whole number >= 1; got 0."),
    ("finite_time", {"window": 0}, "observer.window must be a positive number; got 0."),
    ("impulsive_input", {"exponents": [-1, 0.5, -1]}, "observer.exponents must differ; -1.0 stands twice."),
    ("impulsive_input", {"margin": 5, "window": 5}, "observer.margin must be less than observer.window = 5.0; got 5.0."),
    ("unknown_input", {"gains": {"L": [[]]}}, "observer.gains.T1 is required: L and T1 are given together; it is missing."),
    ("unknown_input", {"gains": {"L": [[1]], "T1": [[0, 1], [1, 0]]}}, "observer.gains.L must be 1x0 (n-q x p-q, n states, p outputs, q unknown inputs); got 1x1."),
    ("unknown_input", {"gains": {"L": [[]], "T1": [[1, 0], [0, 1]]}}, "observer.gains.T1 must end with the columns of flow.D, [[1.0], [0.0]]: T1 = [Ta, D]; got [[1.0, 0.0], [0.0, 1.0]]."),
    ("unknown_input", {"gains": {"L": [[]], "T1": [[1, 1], [0, 0]]}}, "observer.gains.T1 must be invertible; in floating point its rank is 1, of 2."),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "observer", "line"), FAULTS)
def test_each_fault_has_its_line(kind: str, observer: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as error:
        problem_of_kind(kind, **observer)
    assert str(error.value) == line


def test_more_unknown_inputs_than_outputs_leave_no_size_for_a_gain() -> None:
    plant = PLANT | {"flow": {"A": [[-1, 0], [1, -2]], "D": [[1, 0], [0, 1]]}}
    with pytest.raises(InputError) as error:
        problem_of_kind("unknown_input", plant, gains={"L": [[]], "T1": [[1, 0], [0, 1]]})
    assert str(error.value) == (
        "observer.gains.L requires flow.D with at most as many columns as output.C has rows (1); "
        "D has 2."
    )


def test_as_many_outputs_as_unknown_inputs_leave_an_empty_gain() -> None:
    problem = problem_of_kind("unknown_input", gains={"L": [[]], "T1": [[0, 1], [1, 0]]})
    assert problem.gains["L"].shape == (1, 0)
    assert Problem.from_dict(json.loads(json.dumps(problem.to_dict()))) == problem
    square = PLANT | {"flow": {"A": [[-1]], "D": [[1]]}, "output": {"C": [[1], [2]]}}
    problem = problem_of_kind("unknown_input", square, gains={"L": [], "T1": [[1]]})
    assert problem.gains["L"].shape == (0, 1)
    assert Problem.from_dict(problem.to_dict()) == problem


def test_options_are_normalised_and_frozen() -> None:
    problem = problem_of_kind(
        "luenberger", poles=[-1, (-2 - 2j)], weights={"state": np.array([1, 2])}
    )
    options = problem.options_as(LuenbergerOptions)
    assert options.poles == (-1.0, (-2.0, -2.0))
    assert options.weights == {"state": (1.0, 2.0)}
    with pytest.raises(TypeError):
        options.weights["state"] = (1.0,)  # type: ignore[index]
    impulsive = problem_of_kind("impulsive", window=3.0).options_as(ImpulsiveOptions)
    assert type(impulsive.window) is int
    impulsive_input = problem_of_kind("impulsive_input", exponents=[0.05, -1])
    assert impulsive_input.options_as(ImpulsiveInputOptions).exponents == (
        0.05,
        -1.0,
    )


def test_copies_are_equal_and_read_only() -> None:
    problem = problem_of_kind("interval", gains={"L": [[0], [1]]})
    for twin in (pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):
        assert twin == problem
        assert not twin.gains["L"].flags.writeable
        assert not twin.plant.flow.A.flags.writeable


def test_blocks_compare_by_value() -> None:
    assert Flow([[1, 2], [3, 4]]) == Flow(np.array([[1.0, 2], [3, 4]]))
    assert Flow([[1]]) != Flow([[1]], B=[[1]])
    assert Jump([[1]], dwell_time=(1, 2)) != Jump([[1]], dwell_time=(1, 3))
    assert Output([[1, 2]]) != Output([[1], [2]])
    assert Output([[1]]) != "output"


def test_python_objects_are_read_as_strictly_as_files() -> None:
    with pytest.raises(InputError, match=r"flow.A must be a matrix: .* got \[\[True, 2\]\]\."):
        Flow([[True, 2]])
    with pytest.raises(InputError, match=r"flow.A must be a matrix"):
        Flow(np.array([[True]]))
    with pytest.raises(InputError, match=r"flow.disturbance.upper is required; it is missing\."):
        Flow([[1]], lower=[0])
    with pytest.raises(
        InputError, match=r"jump.dwell_jitter must fit a binary64 number; got an integer of"
    ):
        Jump(dwell_jitter=10**5000)
    with pytest.raises(InputError, match="an integer has thousands of digits"):
        Problem(flow={"A": 10**5000}, output={"C": [[1]]})
    assert Flow([[2**70]]).A[0, 0] == 2.0**70
    assert math.copysign(1, Flow([[-0.0]]).A[0, 0]) == 1


def test_a_measurement_that_never_happens() -> None:
    with pytest.raises(InputError) as error:
        Output([[1]], measured="at_jumps", jump_measurement="none")
    assert str(error.value) == (
        "output.jump_measurement must be before or after when measured = 'at_jumps'; "
        "got 'none', which leaves no measurement at all."
    )


@pytest.mark.parametrize(
    ("block", "key", "line"),
    [
        (None, "dwell_time", "unknown key 'dwell_time': it belongs in [jump]."),
        ("flow", "C", "unknown key 'C' in [flow]: it belongs in [output]."),
        ("observer", "L", "unknown key 'L' in [observer]: it belongs in [observer.gains]."),
        ("flow", 3, "unknown key '3' in [flow]: did you mean "),
    ],
)
def test_keys_that_stand_in_the_wrong_place(block: str | None, key: Any, line: str) -> None:
    body = copy.deepcopy(PLANT) | {"observer": {"kind": "interval"}}
    (body if block is None else body[block])[key] = [[1]]
    with pytest.raises(InputError) as error:
        Problem.from_dict(body)
    assert str(error.value).startswith(line)


def test_what_a_kind_requires() -> None:
    problem = problem_of_kind("unknown_input")
    assert np.array_equal(problem.require("flow.D"), [[1], [0]])
    for entry, line in {
        "jump.H": "jump.H is required by kind 'unknown_input'; it is missing.",
        "output.period": "output.period is required by kind 'unknown_input'; it is missing.",
    }.items():
        with pytest.raises(InputError) as error:
            problem.require(entry)
        assert str(error.value) == line
    still = problem_of_kind("luenberger", {key: PLANT[key] for key in ("flow", "output")})
    with pytest.raises(InputError) as error:
        still.require("jump.H")
    assert str(error.value) == "jump.H is required by kind 'luenberger'; [jump] is missing."
    assert still.reason_without("flow.A", "output.C") is None
    assert still.reason_without("flow.A", "jump", needed_by="this") == (
        "[jump] is required by this; it is missing."
    )
    problem.require_measured("periodic", "continuous")
    with pytest.raises(InputError) as error:
        problem.require_measured("periodic", "at_jumps")
    assert str(error.value) == (
        "output.measured must be periodic or at_jumps for kind 'unknown_input'; got 'continuous'."
    )


def test_a_file_for_several_kinds_is_read_for_one(tmp_path: Path) -> None:
    observer = {"kind": "interval", "form": "split", "alpha": 2, "window": 3,
                "gains": {"L": [[0], [1]], "K": [[1], [1]]}}  # fmt: skip
    path = tmp_path / "p.json"
    path.write_text(json.dumps(PLANT | {"observer": observer}))
    with pytest.raises(InputError, match=r"observer.alpha is an option of kind 'impulsive'"):
        obsdesign.load_problem(path)
    problem, dropped = load_for_kind(path, "impulsive")
    assert (problem.kind, problem.options.to_document()) == (
        "impulsive",
        {"alpha": 2.0, "window": 3},
    )
    assert dropped == ["gains.L", "gains.K", "form"]
    problem, dropped = load_for_kind(path, "interval")
    assert (set(problem.gains), problem.options.to_document()) == ({"L"}, {"form": "split"})
    assert dropped == ["gains.K", "alpha", "window"]
    # L of interval enters as A - L C, that of finite_time as A + L C
    assert "gains.L" in load_for_kind(path, "finite_time")[1]
    path.write_text(json.dumps(PLANT | {"observer": observer | {"alhpa": 2}}))
    with pytest.raises(
        InputError, match=r"unknown key 'alhpa' in \[observer\]: did you mean 'alpha'"
    ):
        load_for_kind(path, "impulsive")


TEXTS = {
    "json in toml": ("p.toml", '{"flow": 1}', " Is it JSON? Name it .json."),
    "toml in json": ("p.json", "[flow]\nA = [[1]]\n", " Is it TOML? Name it .toml."),
    "line and column": ("p.json", '{"flow":\n  {"A": }}', "Expecting value: line 2 column 9 (char 17)."),
    "line of toml": ("p.toml", "[flow]\n[flow]\n", "Cannot declare ('flow',) twice (at line 2, column 6)."),
    "digits": ("p.json", f'{{"flow": {"1" * 5000}}}', "not valid JSON: an integer has thousands of digits."),
    "deep": ("p.json", "[" * 100_000, "nested too deeply to be a problem file."),
    "a date": ("p.toml", "flow.A = [[2020-01-01]]\noutput.C = [[1]]\n",
               "flow.A, row 1, column 1 must be a number; got datetime.date(2020, 1, 1)."),
    "surrogate": ("p.json", '{"name": "\\ud800", "flow": {"A": [[1]]}, "output": {"C": [[1]]}}',
                  "name must be text that UTF-8 can hold; got '\\ud800'."),
    "option": ("p.toml", 'flow.A = [[1]]\noutput.C = [[1]]\nobserver = { kind = "interval", gain_limit = nan }\n',
               "observer.gain_limit must be a finite number; got nan."),
}  # fmt: skip


@pytest.mark.parametrize("fault", TEXTS)
def test_files_end_in_one_line_that_names_them(tmp_path: Path, fault: str) -> None:
    name, text, end = TEXTS[fault]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        obsdesign.load_problem(tmp_path / name)
    assert str(error.value).startswith(f"{tmp_path / name}: ")
    assert str(error.value).endswith(end)
    assert len(str(error.value).splitlines()) == 1


def test_the_stored_schema_is_the_one_of_the_dataclasses() -> None:
    stored = files("obsdesign").joinpath("problem/problem.schema.json").read_text("utf-8")
    assert stored == problem_schema.text()


def test_options_of_a_kind_are_attributes() -> None:
    options = problem_of_kind("luenberger", poles=[-1, [-2, -2]], memory=2).options_as(
        LuenbergerOptions
    )
    assert options.poles == (-1.0, (-2.0, -2.0))
    assert (options.memory, options.schedule, options.decay_rate) == (2, None, 0.0)
    assert options.is_stated("memory")
    assert not options.is_stated("decay_rate")
    assert options.to_document() == {"poles": (-1.0, (-2.0, -2.0)), "memory": 2}
    assert LuenbergerOptions(memory=3).to_document() == {"memory": 3}
    with pytest.raises(TypeError, match="a problem of kind 'luenberger' has no IntervalOptions"):
        problem_of_kind("luenberger").options_as(IntervalOptions)


def test_schema_and_tables_know_the_same_names() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    observer = SCHEMA["properties"]["observer"]
    assert SCHEMA["$defs"]["kind"]["enum"] == list(KINDS) == list(OPTIONS)
    assert set(observer["properties"]["gains"]["properties"]) == {
        g for t in GAINS.values() for g in t
    }
    for kind in KINDS:
        known = SCHEMA["$defs"][kind]["properties"]
        assert set(known) == {"kind", "gains", *OPTIONS[kind]}
        assert set(known["gains"]["properties"]) == set(GAINS[kind])
        assert all(known[name].get("description") for name in OPTIONS[kind])
    for block in SCHEMA["properties"].values():
        described = [
            entry.get("description") or "$ref" in entry
            for entry in block.get("properties", {}).values()
        ]
        assert all(described)


# Whatever stands anywhere in a file, the answer is a problem or one line; never another exception.
junk = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.integers(10**300, 10**400) | st.floats()
    | st.sampled_from(["inf", "-inf", "auto", "interval", "split", "periodic", "none", ""]) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=2),
    max_leaves=6,
)  # fmt: skip
EVERYTHING: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "D": [[1], [0]], "disturbance": {"lower": [0, 0], "upper": [1, 1]}},
    "jump": {"G": [[2, 1], [1, 3]], "H": [[1], [0]], "dwell_time": [0.7, "inf"], "dwell_jitter": 1},
    "output": {"C": [[0, 1]], "noise_bound": [0.1], "measured": "periodic", "period": 0.1},
}  # fmt: skip
OBSERVERS: dict[str, dict[str, Any]] = {
    "interval": {"gains": {"L": [[0], [1]], "S": [[1, 0], [0, 1]]}, "form": "auto", "gain_limit": 2, "memory": 1},
    "set_membership": {"window": 8, "steps": 6, "fixed_lag": 2, "directions": [[1, -1]]},
    "luenberger": {"poles": [[-1, 2], [-1, -2]], "weights": {"state": [1, 1]}, "schedule": [1, 2]},
    "impulsive": {"window": 3, "alpha": 2},
    "finite_time": {"gains": {"L": [[0], [1]]}, "window": 6},
    "impulsive_input": {"gains": {"K": [[0], [1]]}, "exponents": [-1, -2], "window": 3, "margin": 1},
    "unknown_input": {"gains": {"L": [[]], "T1": [[0, 1], [1, 0]]}, "poles": [-1]},
}  # fmt: skip


def places(body: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    keys = (
        list(body) if isinstance(body, dict) else range(len(body)) if isinstance(body, list) else []
    )
    return [path, *(place for key in keys for place in places(body[key], (*path, key)))]


@settings(max_examples=120, deadline=None)
@given(kind=st.sampled_from(KINDS), data=st.data())
def test_any_value_anywhere_is_a_problem_or_one_line(kind: str, data: Any) -> None:
    body: Any = copy.deepcopy(EVERYTHING) | {
        "observer": {"kind": kind} | copy.deepcopy(OBSERVERS[kind])
    }
    before = Problem.from_dict(copy.deepcopy(body))
    assert Problem.from_dict(before.to_dict()) == before
    path = data.draw(st.sampled_from(places(body)))
    value = data.draw(junk)
    if not path:
        body = value
    else:
        block = body
        for key in path[:-1]:
            block = block[key]
        if isinstance(block, dict) and data.draw(st.booleans()):
            block[data.draw(st.text(max_size=6))] = value
        else:
            block[path[-1]] = value
    line = ""
    try:
        problem = Problem.from_dict(body)
    except InputError as error:
        line = str(error)
    if line:
        assert "\n" not in line
        return
    text = json.dumps(problem.to_dict(), allow_nan=False)
    again = Problem.from_dict(json.loads(text))
    assert json.dumps(again.to_dict(), allow_nan=False) == text
    jsonschema.validate(json.loads(text), SCHEMA)
