"""Gains of named events and sensors in a problem file."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem
from tests.systems.clocks import DOSES, renamed, two_clocks


def problem(gains: Any, kind: str | None = "interval", **options: Any) -> Problem:
    observer = {"gains": gains, **options} | ({} if kind is None else {"kind": kind})
    return Problem.from_dict({**DOSES, "observer": observer})


@pytest.mark.parametrize(("gains", "text"), [
    ({"blood": {"L": [[0], [0], [0]]}}, r"gains.blood must be of an event or a sensor .*\(dose, bolus, plasma, tissue\)"),
    ({"dose": {"L": [[0], [0], [0]]}}, "gains.dose: an event has M; got L"),
    ({"plasma": {"M": [[0], [0], [0]]}}, "gains.plasma: a sensor has L; got M"),
    ({"plasma": {"K": [[0], [0], [0]]}}, "unknown key 'K' in .observer.gains.plasma"),
    ({"plasma": {"L": [[0, 0, 0]]}}, r"gains.plasma.L must be 3x1 .* got 1x3. Is it transposed\?"),
    ({"dose": {"M": [[0], [0], [0]]}}, "gains.dose.M must be 3x2 .n states, outputs of all sensors"),
    ({"dose": {"M": [[0, 1], [0, 0], [0, 0]]}}, "gains.dose.M must be zero in the columns of sensors that see"),
    ({"L": [[0, 0], [0, 0], [0, 0]]}, "gains.L is of one sensor; the plant has 2. Write observer.gains = { plasma"),
    ({"S": np.eye(3).tolist()}, "gains.S is not available with several clocks"),
    ({"plasma": [[0], [0], [0]]}, r"gains.plasma must be a table"),
    ({"l": [[0], [0], [0]]}, "unknown key 'l' in .observer.gains.: did you mean 'L'"),
])  # fmt: skip
def test_a_gain_of_nobody_is_refused(gains: Any, text: str) -> None:
    with pytest.raises(InputError, match=text):
        problem(gains)


@pytest.mark.parametrize(("options", "text"), [
    ({"form": "coordinates"}, "observer.form must be split with several clocks"),
    ({"objective": "shortest_dwell"}, "objective = 'shortest_dwell' is not available with several"),
    ({"width_weights": [1, 1, 1]}, "observer.width_weights is not available for kind 'interval' with"),
    ({"gain_limit": 0.5}, "observer.gains.plasma.L, row 1, column 1 must not exceed"),
])  # fmt: skip
def test_an_option_that_means_nothing_here_is_refused(options: Any, text: str) -> None:
    with pytest.raises(InputError, match=text):
        obsdesign.design(problem({"plasma": {"L": [[1], [0], [0]]}}, **options))


def test_gains_are_kept_without_a_kind_and_dropped_for_one_without_them() -> None:
    gains = {"plasma": {"L": [[1.0], [0.0], [0.0]]}}
    open_kind = problem(gains, None)
    assert open_kind.to_dict()["observer"]["gains"] == gains
    assert open_kind.for_kind("interval")[0].gains.keys() == {"plasma.L"}
    for written in (None, "interval"):
        other, dropped = problem(gains, written).for_kind("set_membership")
        assert dropped == ["gains.plasma"]
        assert not other.gains
    with pytest.raises(InputError, match=r"unknown key 'plasma' in .observer.gains."):
        problem(gains, "set_membership")


def test_names_of_one_event_and_one_sensor_are_those_of_the_plain_gains() -> None:
    plain = two_clocks()
    named = renamed(plain)
    L, M = [[0.1], [2.0]], [[0.0], [0.5]]
    first = Problem.from_dict(
        {**named, "observer": {"kind": "interval", "gains": {"L": L, "M": M}}}
    )
    tables = {"level": {"L": L}, "stroke": {"M": M}}
    second = Problem.from_dict({**named, "observer": {"kind": "interval", "gains": tables}})
    assert first == second
    irregular = copy.deepcopy(named)
    irregular["sensor"][0]["every"] = [0.5, 1]
    third = Problem.from_dict(
        {**irregular, "observer": {"kind": "interval", "gains": {"L": L, "M": M}}}
    )
    assert third.to_dict()["observer"]["gains"] == tables
    with pytest.raises(InputError, match=r"must be of an event or a sensor of the plant .none."):
        Problem.from_dict({**plain, "observer": {"kind": "interval", "gains": tables}})
