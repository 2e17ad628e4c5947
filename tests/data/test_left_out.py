"""Rows that are left out of a record: later bounds say what they may have missed."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.data.execution import execute
from obsdesign.data.left_out import LEFT_OUT

# a tank that is fed by pulses of u and filled at doses
TANK: dict[str, Any] = {
    "flow": {
        "A": [[-1.0]], "B": [[1.0]], "input_bound": [10],
        "disturbance": {"lower": [-0.1], "upper": [0.1]},
    },
    "event": [{"name": "dose", "E": [[1]], "input_bound": [5], "every": [1, 9]}],
    "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.1, "every": [0, 20], "report_delay": 0.5}],
    "observer": {"kind": "interval"},
}  # fmt: skip
ROWS = ["0,,0,", "1,,0,", "2,5,0,", "3,,0,", "4,,0,", "5,,0,"]
HEADER = "t,dose,u1,level"


@pytest.fixture
def tank(tmp_path: Path) -> Path:
    obsdesign.design(obsdesign.Problem.from_dict(TANK)).save(str(tmp_path / "d.json"))
    return tmp_path


def estimates(folder: Path, rows: list[str], header: str = HEADER, **options: Any) -> list[str]:
    """The lines of the estimate file behind its header."""
    (folder / "data.csv").write_text("\n".join([header, *rows]) + "\n")
    initial = None if options.pop("goes_on", False) else [0.0, 0.0]
    execute(str(folder / "d.json"), str(folder / "data.csv"), str(folder / "e.csv"), initial, None,
            **options)  # fmt: skip
    return (folder / "e.csv").read_text().splitlines()[1:]


@pytest.mark.parametrize("bad", ["2,five,0,", "2,5,0,oops", "2,5", "2,5,ten,"])
def test_bounds_behind_a_line_that_may_have_held_an_event_say_so(tank: Path, bad: str) -> None:
    lines = estimates(tank, [*ROWS[:2], bad, *ROWS[3:]], skip_bad=True)
    # it may have been late, by as much as report_delay
    assert [LEFT_OUT in line for line in lines] == [False, True, True, True, True]


def test_a_row_with_an_event_that_comes_too_late_is_named_likewise(tank: Path) -> None:
    rows = [f"{row}," for row in ROWS]
    whole = estimates(tank, rows, f"{HEADER},received")
    assert not any(LEFT_OUT in line for line in whole)
    rows[2] = f"{ROWS[2]},4.5"  # more than report_delay late
    late = estimates(tank, rows, f"{HEADER},received")
    assert [LEFT_OUT in line for line in late] == [False, False, True, True, True]


def test_a_row_that_never_comes_in_time_is_known_from_the_start_of_a_file(tank: Path) -> None:
    rows = [f"{row}," for row in ROWS]
    rows[2] = f"{ROWS[2]},100"
    late = estimates(tank, rows, f"{HEADER},received")
    assert [LEFT_OUT in line for line in late] == [False, False, True, True, True]


def test_rows_of_the_same_time_are_behind_it(tank: Path) -> None:
    rows = ["0,,0,", "2,,0,0.1", "2,five,0,", "2,,0,0.2", "3,,0,"]
    body = copy.deepcopy(TANK)
    del body["sensor"][0]["report_delay"]
    obsdesign.design(obsdesign.Problem.from_dict(body)).save(str(tank / "d.json"))
    lines = estimates(tank, rows, skip_bad=True)
    assert [LEFT_OUT in line for line in lines] == [False, True, True, True]


def test_a_part_of_nothing_but_bad_lines_is_remembered(tank: Path) -> None:
    body = copy.deepcopy(TANK)
    del body["sensor"][0]["report_delay"]
    obsdesign.design(obsdesign.Problem.from_dict(body)).save(str(tank / "d.json"))
    state = str(tank / "s.state")
    assert not any(LEFT_OUT in line for line in estimates(tank, ROWS[:2], state=state))
    assert estimates(tank, ["2,five,0,"], goes_on=True, skip_bad=True, state=state) == []
    later = estimates(tank, ROWS[3:], goes_on=True, state=state)
    assert all(LEFT_OUT in line for line in later)
    assert len(later) == 3


def test_a_late_measurement_alone_is_a_missing_sample(tank: Path) -> None:
    del_input = {**TANK, "flow": {key: TANK["flow"][key] for key in ("A", "disturbance")}}
    obsdesign.design(obsdesign.Problem.from_dict(del_input)).save(str(tank / "d.json"))
    rows = ["0,,,", "1,,0.1,4.5", "2,5,,", "3,,,", "4,,,", "5,,,"]
    lines = estimates(tank, rows, "t,dose,level,received")
    assert not any(LEFT_OUT in line for line in lines)
    assert len(lines) == 5


def test_a_later_part_knows_of_the_rows_that_were_left_out(tank: Path) -> None:
    state = str(tank / "s.state")
    rows = [*ROWS[:2], "2,five,0,", *ROWS[3:]]
    estimates(tank, rows[:4], skip_bad=True, state=state)
    later = estimates(tank, rows[4:], goes_on=True, state=state)
    assert later
    assert all(LEFT_OUT in line for line in later)


def test_a_plant_without_events_and_inputs_has_nothing_to_miss(tank: Path) -> None:
    body = {
        "flow": {"A": [[-1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "output": {"C": [[1.0]], "noise_bound": [0.1]}, "observer": {"kind": "interval"},
    }  # fmt: skip
    obsdesign.design(obsdesign.Problem.from_dict(body)).save(str(tank / "d.json"))
    lines = estimates(tank, ["0,0", "0.1,oops", "0.2,0"], "t,y1", skip_bad=True)
    assert not any(LEFT_OUT in line for line in lines)


@pytest.mark.parametrize("kind", ["set_membership"])
def test_other_kinds_with_bounds_do_likewise(tank: Path, kind: str) -> None:
    body = {**TANK, "observer": {"kind": kind}}
    obsdesign.design(obsdesign.Problem.from_dict(body)).save(str(tank / "d.json"))
    lines = estimates(tank, [*ROWS[:2], "2,five,0,", *ROWS[3:]], skip_bad=True)
    assert [LEFT_OUT in line for line in lines] == [False, True, True, True, True]
