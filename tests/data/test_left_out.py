"""Rows that are left out of a record: later bounds say what they may have missed."""

from __future__ import annotations

import copy
import os
from pathlib import Path
from typing import Any

import pytest

from obsdesign import InputError
from obsdesign.data.execution import execute
from obsdesign.data.left_out import LEFT_OUT
from tests.systems.designs import designed

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
    designed(TANK).save(str(tmp_path / "d.json"))
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
    designed(body).save(str(tank / "d.json"))
    lines = estimates(tank, rows, skip_bad=True)
    assert [LEFT_OUT in line for line in lines] == [False, True, True, True]


def test_a_part_of_nothing_but_bad_lines_is_remembered(tank: Path) -> None:
    body = copy.deepcopy(TANK)
    del body["sensor"][0]["report_delay"]
    designed(body).save(str(tank / "d.json"))
    state = str(tank / "s.state")
    assert not any(LEFT_OUT in line for line in estimates(tank, ROWS[:2], state=state))
    assert estimates(tank, ["2,five,0,"], goes_on=True, skip_bad=True, state=state) == []
    later = estimates(tank, ROWS[3:], goes_on=True, state=state)
    assert all(LEFT_OUT in line for line in later)
    assert len(later) == 3


def test_a_late_measurement_alone_is_a_missing_sample(tank: Path) -> None:
    del_input = {**TANK, "flow": {key: TANK["flow"][key] for key in ("A", "disturbance")}}
    designed(del_input).save(str(tank / "d.json"))
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
    designed(body).save(str(tank / "d.json"))
    lines = estimates(tank, ["0,0", "0.1,oops", "0.2,0"], "t,y1", skip_bad=True)
    assert not any(LEFT_OUT in line for line in lines)


@pytest.mark.parametrize("kind", ["set_membership"])
def test_other_kinds_with_bounds_do_likewise(tank: Path, kind: str) -> None:
    body = {**TANK, "observer": {"kind": kind}}
    designed(body).save(str(tank / "d.json"))
    lines = estimates(tank, [*ROWS[:2], "2,five,0,", *ROWS[3:]], skip_bad=True)
    assert [LEFT_OUT in line for line in lines] == [False, True, True, True, True]


# --- from when on it counts -----------------------------------------------------------------------


def marks(lines: list[str]) -> list[bool]:
    return [LEFT_OUT in line for line in lines]


def save_design(folder: Path, **blocks: Any) -> None:
    """A design of the tank with other blocks, none where they are None, as `d.json`."""
    body = {key: value for key, value in {**copy.deepcopy(TANK), **blocks}.items() if value}
    designed(body).save(str(folder / "d.json"))


LEVEL = {"name": "level", "C": [[1]], "noise_bound": 0.1, "every": [0, 20]}
STILL = {"A": [[-1.0]], "disturbance": {"lower": [-1.0], "upper": [1.0]}}
PLAIN = {"flow": STILL, "event": None, "sensor": None,
         "output": {"C": [[1.0]], "noise_bound": [0.1]}}  # fmt: skip


def test_a_line_that_is_out_of_order_counts_from_its_own_time(tank: Path) -> None:
    save_design(tank, sensor=[LEVEL])
    rows = ["0,,0,", "1,,0,", "4,,0,", "5,,0,", "3,5,0,", "6,,0,"]
    assert marks(estimates(tank, rows, skip_bad=True)) == [False, False, True, True, True]
    # the twin: a time that cannot be read is that behind the row before
    rows[4] = "x,5,0,"
    assert marks(estimates(tank, rows, skip_bad=True)) == [False, False, False, True, True]


def test_a_line_that_may_have_come_as_late_as_a_row(tank: Path) -> None:
    """0.9 - 0.3 is above 0.6: the next row, of the same time, is not too late either."""
    sensor = LEVEL | {"noise_bound": 9, "report_delay": 0.6}
    save_design(tank, flow=STILL, sensor=[sensor])
    rows = ["0,,0", "0.9,,", "0.3,5x,", "0.3,,5", "0.4,,", "3,,"]
    lines = estimates(tank, rows, "t,dose,level", skip_bad=True)
    assert marks(lines) == [False, True, True, True, True]


@pytest.mark.parametrize(("bounds", "counts"), [(",,", True), ("-0.1,0.1,", False)])
def test_a_late_row_that_declares_its_bounds_again(tank: Path, bounds: str, counts: bool) -> None:
    save_design(tank, flow=STILL, event=None, sensor=[LEVEL])
    rows = ["0,0,-0.1,0.1,", "1,0,-0.1,0.1,", f"2,,{bounds}50", "3,0,-0.1,0.1,"]
    lines = estimates(tank, rows, "t,level,b1_lo,b1_hi,received")
    assert marks(lines) == [False, False, counts]


@pytest.mark.parametrize(("end", "counts"), [("-0.1,0.1", True), (",", False)])
def test_narrow_bounds_do_not_run_on_over_a_bad_line(tank: Path, end: str, counts: bool) -> None:
    save_design(tank, **PLAIN)
    state = str(tank / "s.state")
    estimates(tank, ["0,0,-0.1,0.1", f"1,,{end}"], "t,y1,b1_lo,b1_hi", state=state)
    later = estimates(tank, ["2,oops,,", "8,,-0.1,0.1"], "t,y1,b1_lo,b1_hi", state=state,
                      goes_on=True, skip_bad=True)  # fmt: skip
    assert marks(later) == [counts]


@pytest.mark.parametrize(
    ("row", "counts"),
    [("1,,2,0.1,4.5", False), ("1,,,0.1,4.5", False), ("1,,3,0.1,4.5", True),
     ("1,0.5,2,,4.5", True)],
)  # fmt: skip
def test_a_late_row_that_changes_nothing(tank: Path, row: str, counts: bool) -> None:
    """The known input that holds anyway, as tables write it in every row."""
    rows = ["0,,2,0,", row, *(f"{t},,2,,{t}" for t in (2, 3, 4, 5))]
    lines = estimates(tank, rows, f"{HEADER},received")
    assert marks(lines) == [False, *[counts] * 4]


@pytest.mark.parametrize(("u", "counts"), [("0", True), ("2", False), ("", False)])
def test_a_late_row_behind_one_that_still_waits(tank: Path, u: str, counts: bool) -> None:
    """The input changes at 3, whose row waits when that of 5 comes: back to 0 is a change."""
    rows = ["0,,0,,0", "3,,2,,3", f"5,,{u},,9", "10,,,,10", "14,,,,14"]
    lines = estimates(tank, rows, f"{HEADER},received")
    assert marks(lines) == [False, False, counts, counts]


@pytest.mark.parametrize(("bounds", "counts"), [("-0.1,0.1", True), (",", False)])
def test_narrow_bounds_of_a_row_that_waits_in_a_state(
    tank: Path, bounds: str, counts: bool
) -> None:
    save_design(tank, flow=STILL, event=None, sensor=[LEVEL | {"report_delay": 2}])
    header, state = "t,level,b1_lo,b1_hi", str(tank / "s.json")
    estimates(tank, ["0,,,", "1,,,", f"3,,{bounds}"], header, state=state)
    later = estimates(tank, ["5,oops,,", "12,,-0.1,0.1", "20,,,"], header, state=state,
                      goes_on=True, skip_bad=True)  # fmt: skip
    assert any(marks(later)) is counts


def test_bounds_of_a_late_measurement_act_on_it_alone(tank: Path) -> None:
    save_design(tank, flow=STILL, sensor=[LEVEL])
    rows = ["0,,,,,", "1,,0.01,-0.05,0.05,9", "2,,0,-0.05,0.05,", "3,,,,,", "9,,,,,"]
    assert not any(marks(estimates(tank, rows, "t,dose,level,v1_lo,v1_hi,received")))


def test_provisional_estimates_say_so_too(tank: Path) -> None:
    rows = [f"{row}," for row in ROWS]
    rows[2] = f"{ROWS[2]},4.5"
    target = tank / "p.csv"
    estimates(tank, rows, f"{HEADER},received", provisional=str(target))
    lines = target.read_text().splitlines()[1:]
    assert marks(lines) == [not line.startswith(("0.0,", "1.0,")) for line in lines]
    assert sum(marks(lines)) >= 3


# --- the first row --------------------------------------------------------------------------------


def test_the_first_row_is_not_left_out(tank: Path) -> None:
    save_design(tank, **PLAIN)
    with pytest.raises(InputError, match=r"line 2: .*--skip-bad does not skip the first row"):
        estimates(tank, ["0,1 V", "1,0"], "t,y1", skip_bad=True)
    # the twins: a later line, and the first one of a later part
    state = str(tank / "s.state")
    assert not any(marks(estimates(tank, ["0,0", "1,x", "2,0"], "t,y1", skip_bad=True,
                                   state=state)))  # fmt: skip
    later = estimates(tank, ["3,x", "4,0"], "t,y1", skip_bad=True, state=state, goes_on=True)
    assert (len(later), any(marks(later))) == (1, False)


@pytest.mark.parametrize(("t", "counts"), [(0, True), (1.5, False)])
def test_a_row_that_comes_too_late_may_be_the_first(tank: Path, t: float, counts: bool) -> None:
    save_design(tank, flow=STILL, sensor=[LEVEL | {"report_delay": 1.0}])
    rows = [f"{t},,0.05,8", "1,,0,", "2,,0,", "9,,,"]
    rows.sort(key=lambda row: float(row.split(",")[0]))
    assert marks(estimates(tank, rows, "t,dose,level,received")) == [counts] * 3


@pytest.mark.parametrize(("t", "counts"), [(0, True), (1.5, False)])
def test_the_first_row_may_be_lost_in_a_later_part(tank: Path, t: float, counts: bool) -> None:
    """A line that is out of order, and a row that is too late."""
    save_design(tank, **PLAIN)
    state = str(tank / "bad.state")
    estimates(tank, ["1,0", "2,0"], "t,y1", state=state)
    rows = [f"{t},0", "6,0"]
    lines = estimates(tank, rows, "t,y1", state=state, skip_bad=True, goes_on=True)
    assert marks(lines) == [counts]
    save_design(tank, flow=STILL, event=None, sensor=[LEVEL | {"report_delay": 0.5}])
    state = str(tank / "late.state")
    estimates(tank, ["1,0,", "2,0,", "3,,"], "t,level,received", state=state)
    rows = [f"{t},0,4", "4,,", "5,,", "9,,"]
    lines = estimates(tank, rows, "t,level,received", state=state, goes_on=True)
    assert marks(lines) == [counts] * 3


def test_a_part_without_arrivals_has_a_time_too(tank: Path) -> None:
    """A row of the next part that is older than the last one is too late, whenever it came."""
    save_design(tank, flow=STILL, sensor=[LEVEL])
    state = str(tank / "s.state")
    estimates(tank, ["0,,0", "2,,0"], "t,dose,level", state=state)
    rows = ["1,,0,1", "1.5,5,0,1.5", "3,,0,3"]
    lines = estimates(tank, rows, "t,dose,level,received", state=state, goes_on=True)
    assert (len(lines), marks(lines)) == (1, [True])


def test_a_pipe_that_is_given_as_a_file_is_refused(tank: Path) -> None:
    os.mkfifo(tank / "pipe")
    with pytest.raises(InputError, match=r"pipe: .*give the rows on standard input"):
        execute(str(tank / "d.json"), str(tank / "pipe"), None, [0.0, 0.0], None)


# --- modes ----------------------------------------------------------------------------------------

MODES: dict[str, Any] = {
    "flow": {"A": [[-1.0]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
    "mode": [
        {"name": "open", "A": [[-1.0]], "every": [1, 9]},
        {"name": "closed", "A": [[-0.2]], "every": [1, 9]},
    ],
    "event": [{"name": "dose", "disturbance": {"lower": [5], "upper": [5]}, "every": [1, 20],
               "report_delay": 3}],
    "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.1, "every": "continuous"}],
    "observer": {"kind": "interval"},
}  # fmt: skip
IN_MODES = "t,dose,level,mode"


@pytest.fixture
def valve(tmp_path: Path) -> Path:
    designed(MODES).save(str(tmp_path / "d.json"))
    return tmp_path


@pytest.mark.parametrize(("mode", "counts"), [("open", False), ("", False), ("closed", True)])
def test_a_late_row_that_names_a_mode(valve: Path, mode: str, counts: bool) -> None:
    rows = ["0,,,open,", "1,,,,", f"2,,0,{mode},9", "3,,,,", "6,,,,", "7,,,,", "11,,,,"]
    lines = estimates(valve, rows, f"{IN_MODES},received")
    assert marks(lines) == [False, False, *[counts] * 4]


def test_the_mode_is_required_of_the_first_row_in_time(valve: Path) -> None:
    rows = ["1,,,", "0,,,open", "2,,,", "3,,,closed", "7,,,"]
    target = str(valve / "p.csv")
    lines = estimates(valve, rows, IN_MODES, provisional=target)
    assert [line.split(",")[0] for line in lines] == ["0.0", "1.0", "2.0", "3.0"]
    in_time = estimates(valve, sorted(rows), IN_MODES, provisional=target)
    assert lines == in_time
    # the twin: of a later line, the first in time has none
    for options in ({}, {"provisional": target}, {"state": str(valve / "no.state")}):
        with pytest.raises(InputError, match=r"mode is required in the first row, that of t = 0 "):
            estimates(valve, ["1,,,open", "0,,,", "2,,,"], IN_MODES, **options)


def test_the_first_row_may_wait_in_a_state(valve: Path) -> None:
    state = str(valve / "s.state")
    assert estimates(valve, ["0,,,open", "1,,,"], IN_MODES, state=state) == []
    assert estimates(valve, ["2,xx,,"], IN_MODES, state=state, goes_on=True, skip_bad=True) == []
    lines = estimates(valve, ["2,,,", "3,,,closed", "8,,,"], IN_MODES, state=state, goes_on=True)
    assert [line.split(",")[0] for line in lines] == ["0.0", "1.0", "2.0", "3.0"]
    # nothing of the first part is final: the lost line may have stood before all of it
    assert all(marks(lines))


# --- kinds whose point estimates have a claimed error ---------------------------------------------


def window_design(folder: Path, noise: float | None = 0.01) -> None:
    """Kind finite_time: an event may stand between samples, and a window takes 2."""
    output: dict[str, Any] = {"C": [[1.0]], "measured": "periodic", "period": 0.5}
    if noise is not None:
        output["noise_bound"] = [noise]
    body = {
        "flow": {"A": [[-0.1]]}, "jump": {"E": [[1]], "dwell_time": [1, 90]}, "output": output,
        "observer": {"kind": "finite_time", "window": 2.0},
    }  # fmt: skip
    designed(body).save(str(folder / "d.json"))


@pytest.mark.parametrize("bad", ["5.2,,,", "x,,1,", "1"])
@pytest.mark.parametrize(("noise", "counts"), [(0.01, True), (None, False)])
def test_point_estimates_with_a_claimed_error_count(
    tank: Path, bad: str, noise: float | None, counts: bool
) -> None:
    """In later parts too; the twin has no claimed error, and no bounds."""
    window_design(tank, noise)
    state, marked = str(tank / "s.state"), []
    first = [f"{k / 2},0,0,0" for k in range(11)] + [bad]
    for part in (first, [f"{k / 2},0,0,0" for k in range(11, 31)]):
        (tank / "data.csv").write_text("\n".join(["t,y1,jump,w1", *part]) + "\n")
        execute(str(tank / "d.json"), str(tank / "data.csv"), str(tank / "e.csv"), None, None,
                skip_bad=True, state=state)  # fmt: skip
        marked += marks((tank / "e.csv").read_text().splitlines()[1:])
    assert all(marked[11:]) == counts
    assert any(marked) == counts
