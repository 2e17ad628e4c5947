"""`run` on rows that arrive late: files, pipes, parts; what is final, what is provisional."""

from __future__ import annotations

import copy
import csv
import functools
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import obsdesign
from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.data.left_out import LEFT_OUT
from obsdesign.data.simulation import simulate
from obsdesign.document import Design
from obsdesign.problem.problem import Problem
from tests.cli.test_commands import ROOT
from tests.systems.clocks import DOSES
from tests.systems.designs import designed

LAG = 8.0
START = "--initial=-2,2,-2,2,-2,2"


def delayed(**changes: Any) -> dict[str, Any]:
    """The doses, reported within an hour, and assays that take a while."""
    body = copy.deepcopy(DOSES)
    body["event"][0]["report_delay"] = 1.0
    body["sensor"][0] |= {"report_delay": LAG, "every": [0.5, 3]}
    body["observer"] |= {"window": 4, "steps": 1}
    return body | changes


def ran(*arguments: object, stdin: str | None = None) -> Result:
    return CliRunner().invoke(cli, [*map(str, arguments)], input=stdin, standalone_mode=False)


def cells(path: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(Path(path).read_text())))


def text(titles: list[str], rows: list[list[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([titles, *rows])
    return out.getvalue()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder of a test is that of its commands."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A design; a record in the order of time, of arrival, and without arrivals; its estimates."""
    monkeypatch.chdir(tmp_path)
    designed(delayed()).save("d.json")
    (tmp_path / "p.json").write_text(json.dumps(delayed()), encoding="utf-8")
    assert ran("simulate", "p.json", "--until", 40, "-o", "time.csv").exception is None
    titles, *rows = cells("time.csv")
    k = titles.index("received")
    arrived = sorted(rows, key=lambda row: float(row[k]))
    assert arrived != rows
    Path("arrived.csv").write_text(text(titles, arrived))
    cut = [row[:k] + row[k + 1 :] for row in (titles, *rows)]
    Path("in_time.csv").write_text(text(cut[0], cut[1:]))
    done = ran("run", "d.json", "time.csv", START, "-o", "e.csv")
    assert (done.exception, done.return_value) == (None, 0)
    return tmp_path


def test_final_rows_are_those_of_rows_in_time(desk: Path) -> None:
    ran("run", "d.json", "in_time.csv", START, "-o", "whole.csv")
    ran("run", "d.json", "arrived.csv", START, "-o", "arrived_est.csv")
    piped = ran("run", "d.json", START, stdin=Path("arrived.csv").read_text())
    lines = Path("e.csv").read_text().splitlines()
    assert piped.stdout.splitlines() == lines
    assert Path("arrived_est.csv").read_text().splitlines() == lines
    whole = Path("whole.csv").read_text().splitlines()
    assert [line.rsplit(",", 1)[0] for line in whole] == [x.rsplit(",", 1)[0] for x in lines]
    assert sum(line.endswith("provisional") for line in lines) < len(lines) / 2


def test_provisional_rows_have_a_file_of_their_own(desk: Path) -> None:
    done = ran("run", "d.json", "time.csv", START, "-o", "f.csv", "--provisional", "p.csv")
    assert done.exception is None
    lines = Path("e.csv").read_text().splitlines()
    final = Path("f.csv").read_text().splitlines()
    others = Path("p.csv").read_text().splitlines()[1:]
    assert final == [line for line in lines if not line.endswith("provisional")]
    assert all(",provisional" in line for line in others)
    latest = {line.split(",")[0]: line.rsplit(",", 1)[0] for line in others}
    assert list(latest.values()) != [line.rsplit(",", 1)[0] for line in others]
    for line in lines[1:]:
        assert latest[line.split(",")[0]] == line.rsplit(",", 1)[0]


@pytest.mark.parametrize("cuts", [(1,), (3, 20), (10, 11, 12)])
def test_parts_are_one_record(desk: Path, cuts: tuple[int, ...]) -> None:
    titles, *rows = Path("arrived.csv").read_text().splitlines()
    lines, others = [], []
    for k, part in enumerate(np.split(np.arange(len(rows)), cuts)):
        Path("part.csv").write_text("\n".join([titles, *(rows[i] for i in part)]) + "\n")
        start = [START] if k == 0 else []
        done = ran("run", "d.json", "part.csv", *start, "--state", "s.json", "-o", "part_est.csv",
                   "--provisional", "part_prov.csv")  # fmt: skip
        assert (done.exception, done.return_value) == (None, 0)
        lines += Path("part_est.csv").read_text().splitlines()[1:]
        others += Path("part_prov.csv").read_text().splitlines()[1:]
    ran("run", "d.json", "arrived.csv", START, "-o", "f.csv", "--provisional", "p.csv")
    assert lines == Path("f.csv").read_text().splitlines()[1:]
    assert others == Path("p.csv").read_text().splitlines()[1:]
    ran("run", "d.json", "arrived.csv", START, "--state", "whole.json", "-o", "whole.csv")
    assert Path("s.json").read_text() == Path("whole.json").read_text()


def _field(place: int, value: Any) -> Any:
    return lambda body: body["progress"].__setitem__(place, value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_field(4, "inf"), "now must be finite"),
        (_field(5, "x"), "initial must be"),
        (lambda body: body["progress"][3][0].__setitem__("t", -5.0), "late[0].t must be"),
        (lambda body: body["progress"][3][0].__setitem__("bounds", [None] * 4), "b, c and v"),
        (lambda body: body["progress"].pop(), "progress must be a list of 9"),
        (
            lambda body: body["progress"][3].append(body["progress"][3][-1] | {"events": [7]}),
            "not a state of this design",
        ),
    ],
)
def test_a_state_whose_late_rows_are_none_is_refused(desk: Path, change: Any, words: str) -> None:
    from tests.data.test_run_in_parts import signed

    ran("run", "d.json", "arrived.csv", START, "--state", "s.json", "-o", "f.csv")
    body = json.loads(Path("s.json").read_text())
    change(body)
    Path("s.json").write_text(signed(body))
    done = ran("run", "d.json", "arrived.csv", "--state", "s.json", "-o", "g.csv")
    assert isinstance(done.exception, InputError)
    assert words in str(done.exception)
    assert not Path("g.csv").exists()


@pytest.mark.parametrize("stdin", [False, True])
def test_a_row_older_than_the_buffer_is_skipped(desk: Path, stdin: bool) -> None:
    titles, *rows = cells("arrived.csv")
    t = float(rows[20][0])
    late = [str(t - LAG - 20.0), "0.5", *[""] * 3, str(float(rows[20][5])), *[""] * 3]
    Path("late.csv").write_text(text(titles, [*rows[:21], late, *rows[21:]]))
    source = [] if stdin else ["late.csv"]
    done = ran("run", "d.json", *source, START, "-o", "f.csv",
               stdin=Path("late.csv").read_text() if stdin else None)  # fmt: skip
    assert (done.exception, done.return_value) == (None, 0)
    assert Path("f.csv").read_bytes() == Path("e.csv").read_bytes()
    first, *_ = done.stderr.splitlines()
    assert f"the row of t = {float(late[0]):.9g} arrived at" in first
    assert first.endswith("more than report_delay 8 later; it is skipped.")
    assert len(done.stderr.splitlines()) == 2


def test_without_report_delay_rows_that_go_back_are_refused(desk: Path) -> None:
    """The twin: no delay is stated, and nothing says when rows arrived."""
    designed(DOSES).save("d0.json")
    titles, *rows = cells("arrived.csv")
    k = titles.index("received")
    Path("back.csv").write_text(text(titles[:k], [row[:k] for row in rows]))
    done = ran("run", "d0.json", "back.csv", START, "-o", "f.csv")
    assert "t must increase" in str(done.exception)
    done = ran("run", "d.json", "back.csv", START, "-o", "f.csv")
    assert done.exception is None
    done = ran("run", "d0.json", "in_time.csv", START, "-o", "f.csv", "--provisional", "p.csv")
    assert "--provisional: report_delay of an event or a sensor is required" in str(done.exception)
    # a column of arrivals is believed: what is late is skipped, the others are as in time
    done = ran("run", "d0.json", "time.csv", START, "-o", "f.csv")
    assert done.exception is None
    assert done.stderr.count("more than report_delay 0 later") > 5
    assert "provisional" not in Path("f.csv").read_text()


@pytest.mark.parametrize("stdin", [False, True])
def test_a_record_of_rows_that_are_all_late_is_refused(desk: Path, stdin: bool) -> None:
    designed(DOSES).save("d0.json")
    titles, *rows = cells("time.csv")
    k = titles.index("received")
    late = [[*row[:k], str(float(row[0]) + 2 + 0.01 * i), *row[k + 1 :]]
            for i, row in enumerate(rows)]  # fmt: skip

    def run(rows: list[list[str]], *options: str) -> Result:
        record = text(titles, rows)
        Path("late.csv").write_text(record)
        source = ["d0.json"] if stdin else ["d0.json", "late.csv"]
        return ran("run", *source, "-o", "f.csv", *options, stdin=record if stdin else None)

    done = run(late, START)
    assert str(done.exception) == (
        f"{'standard input' if stdin else 'late.csv'}: rows at most report_delay 0 late are "
        f"required; all {len(rows)} are later, by {2 + 0.01 * (len(rows) - 1):.9g} at most. Is "
        "report_delay of the events and sensors stated?"
    )
    assert not Path("f.csv").exists()
    # the twins: one row on time, and a further part of a record
    assert run([*late, [str(float(late[-1][k]) + 1), *rows[-1][1:k], "", *rows[-1][k + 1 :]]],
               START).exception is None  # fmt: skip
    assert run([[*row[:k], "", *row[k + 1 :]] for row in rows[:9]], START, "--state",
               "s.json").exception is None  # fmt: skip
    done = run(late[:2], "--state", "s.json")
    assert (done.exception, done.return_value) == (None, 0)
    assert done.stderr.count("it is skipped") == 2


@pytest.mark.parametrize("delay", [-1, "inf", "soon"])
def test_a_delay_that_is_none_is_refused(delay: Any) -> None:
    body = delayed()
    body["sensor"][1]["report_delay"] = delay
    with pytest.raises(InputError, match=r"report_delay.* must be a number"):
        Problem.from_dict(body)


def test_an_arrival_before_its_row_is_refused(desk: Path) -> None:
    Path("bad.csv").write_text("t,plasma,tissue,dose,bolus,received\n3,,,,,2\n")
    done = ran("run", "d.json", "bad.csv", START, "-o", "f.csv")
    assert "line 2: received must be at least t, 3.0; got 2.0." in str(done.exception)


def test_simulations_draw_delays() -> None:
    def run(body: dict[str, Any]) -> dict[str, Any]:
        return simulate(Problem.from_dict(body).plant, until=200.0,
                        rng=np.random.default_rng(1)).columns  # fmt: skip

    columns, body = run(delayed()), delayed()
    for block in (*body["event"], *body["sensor"]):
        block.pop("report_delay", None)
    plain = run(body)
    assert "received" not in plain
    for name, own in plain.items():
        assert np.array_equal(own, columns[name], equal_nan=True)
    waits = columns["received"] - columns["t"]
    plasma, dose = np.isfinite(columns["plasma"]), np.isfinite(columns["dose"])
    assert (waits[~plasma & ~dose] == 0).all()
    assert (waits[plasma] <= LAG + 1e-9).all()
    assert (waits[dose & ~plasma] <= 1.0 + 1e-9).all()
    assert waits[plasma].max() > 0.8 * LAG
    assert 0.4 < waits[plasma].mean() / LAG < 0.6


def test_comparisons_and_pictures_take_rows_in_the_order_of_time(desk: Path) -> None:
    tables = []
    for name in ("time", "arrived"):
        done = ran("compare", "p.json", "--data", f"{name}.csv", "--kinds", "set_membership",
                   "--time", 5)  # fmt: skip
        assert done.exception is None
        words = [line.split()[:-1] for line in done.stdout.splitlines()]  # without the time taken
        tables.append([own for own in words if own[:1] in (["set"], ["Kalman"])])
        ran("plot", "e.csv", f"{name}.csv", "-o", f"{name}.svg")
    assert tables[0] == tables[1]
    assert len(tables[0]) == 2
    drawings = [Path(f"{name}.svg").read_text() for name in ("time", "arrived")]
    assert drawings[0] == drawings[1]


# --- kinds whose rows are decided later -------------------------------------------------------------


def unknown_input(differentiator: str) -> dict[str, Any]:
    body = obsdesign.load_problem(ROOT / "examples" / "ahn_1.toml").to_dict()
    output = body.pop("output")
    body["sensor"] = [{"name": "arm", "C": output["C"], "every": 0.1, "report_delay": 0.5,
                       "noise_std": [0.01, 0.01]}]  # fmt: skip
    body["observer"] = {"kind": "unknown_input", "differentiator": differentiator}
    return body


def test_rows_that_are_decided_later_are_as_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    problem = Problem.from_dict(unknown_input("fixed_lag"))
    obsdesign.design(problem).save("d.json")
    problem_file = tmp_path / "p.json"
    problem_file.write_text(json.dumps(problem.to_dict()))
    ran("simulate", "p.json", "--until", 6, "-o", "time.csv")
    titles, *rows = cells("time.csv")
    k = titles.index("received")
    Path("plain.csv").write_text(text(titles[:k], [row[:k] for row in rows]))
    rows.sort(key=lambda row: float(row[k]))
    Path("arrived.csv").write_text(text(titles, rows))
    body = problem.to_dict()
    del body["sensor"][0]["report_delay"]
    designed(body).save("d0.json")
    ran("run", "d0.json", "plain.csv", "-o", "whole.csv")
    done = ran("run", "d.json", "arrived.csv", "-o", "f.csv", "--provisional", "p.csv")
    assert done.exception is None
    final = Path("f.csv").read_text().splitlines()
    assert final == Path("whole.csv").read_text().splitlines()[: len(final)]
    assert 30 < len(final) < 55
    ran("run", "d.json", "arrived.csv", "-o", "g.csv")
    lines = Path("g.csv").read_text().splitlines()
    assert len(lines) == 62
    assert lines[: len(final)] == final
    assert all("provisional" in line for line in lines[len(final) :])
    # all rows are there by then: the numbers, too, are those of the whole record
    whole = Path("whole.csv").read_text().splitlines()
    assert [line.rpartition(",")[0] for line in lines] == [x.rpartition(",")[0] for x in whole]


def test_a_record_that_is_smoothed_as_a_whole_has_no_late_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    designed(unknown_input("batch")).save("d.json")
    Path("a.csv").write_text("t,arm1,arm2\n0,0,0\n")
    done = ran("run", "d.json", "a.csv", "-o", "f.csv")
    assert str(done.exception).startswith("report_delay: observer.differentiator 'batch'")


@pytest.mark.parametrize("sees", ["before", "after"])
@pytest.mark.parametrize("stdin", [False, True])
def test_late_rows_of_one_time_act_as_sees_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sees: str, stdin: bool
) -> None:
    """A dose of 0.5 and a sample at t = 5; with both in one row, and in any order of arrival."""
    monkeypatch.chdir(tmp_path)
    body = {
        "flow": {"A": [[-0.1]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "event": [{"name": "dose", "E": [[1]], "every": [1, 20], "report_delay": 2}],
        "sensor": [{"name": "level", "C": [[1]], "noise_bound": 0.1, "every": [0, 9],
                    "sees": sees}],
        "observer": {"kind": "interval"},
    }  # fmt: skip
    designed(body).save("d.json")

    def bounds(*rows: str) -> list[str]:
        record = "\n".join(["t,dose,level", "0,,", *rows, "9,,", ""])
        Path("a.csv").write_text(record)
        source = ["d.json"] if stdin else ["d.json", "a.csv"]
        done = ran("run", *source, "--initial=-1,1", "-o", "e.csv", stdin=record if stdin else None)
        assert done.exception is None
        lines = [line.rsplit(",", 1)[0] for line in Path("e.csv").read_text().splitlines()]
        return [line for line in lines if line.startswith(("6.0,", "9.0,"))]

    whole = bounds("5,0.5,1", "6,,")
    dose, sample = "5,0.5,", "5,,1"
    assert bounds(dose, "6,,", sample) == bounds(sample, "6,,", dose)
    in_time = (sample, dose) if sees == "before" else (dose, sample)
    assert bounds(*in_time, "6,,") == bounds(sample, "6,,", dose)
    ends = [[float(x) for x in line.split(",")] for line in (*whole, *bounds(sample, "6,,", dose))]
    assert np.allclose(ends[:2], ends[2:], rtol=1e-9)


@functools.cache
def of_both_stages(kind: str) -> Design:
    """A design of two events, with a sensor on each side of them."""
    sensor = {"C": [[1]], "noise_bound": 0.1, "every": [0, 9]}
    body = {
        "flow": {"A": [[-0.1]], "disturbance": {"lower": [-0.1], "upper": [0.1]}},
        "event": [
            {"name": name, "E": [[1]], "every": [1, 20], "report_delay": 2}
            for name in ("dose", "feed")
        ],
        "sensor": [{"name": "level", "sees": "after"} | sensor, {"name": "early"} | sensor],
        "observer": {"kind": kind},
    }
    return designed(body)


@pytest.mark.parametrize(
    ("row", "late", "ahead"),
    [  # sensor level (sees after), sensor early (sees before), events dose and feed
        (".5,.4,,", ",,,.3", None),  # an event between two samples of one row
        (",.4,.2,", ",,,.3", [",.4,.2,", ",,,.3"]),
        (".5,,.2,", ",,,.3", None),  # ... between an event and a sample: events keep their order
        (",,.2,", ",.4,,.3", None),  # the late row itself is on both sides
        (",,.2,", ".5,.4,,", None),
        (",,.2,", ".5,,,", [",,.2,", ".5,,,"]),
        (".5,,,", ",.4,,.3", [",.4,,.3", ".5,,,"]),
    ],
)
@pytest.mark.parametrize("kind", ["interval", "set_membership"])
def test_a_late_row_that_belongs_inside_one_of_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, row: str, late: str,
    ahead: list[str] | None,
) -> None:  # fmt: skip
    """In its place where it has one; otherwise bounds from its time on miss what it held."""
    monkeypatch.chdir(tmp_path)
    of_both_stages(kind).save("d.json")

    def lines(*rows: str) -> list[str]:
        Path("a.csv").write_text(
            "\n".join(["t,level,early,dose,feed", "0,,,,", *rows, "9,,,,", ""])
        )
        done = ran("run", "d.json", "a.csv", "--initial=-1,1", "-o", "e.csv")
        assert done.exception is None
        return Path("e.csv").read_text().splitlines()

    result, acts = lines(f"5,{row}", "6,,,,", f"5,{late}"), late.endswith(".3")
    if ahead is not None:
        assert result == lines(*(f"5,{each}" for each in ahead), "6,,,,")
        return
    assert [LEFT_OUT in line for line in result[1:]] == [False, acts, acts, acts]
    in_time = lines(f"5,{row}", "6,,,,")
    assert [x.split(",")[:3] for x in result] == [x.split(",")[:3] for x in in_time]


def of_one_dose(kind: str = "interval", **discrete: float) -> dict[str, Any]:
    """A store that a dose fills, its level read now and then, both reported within 2."""
    return {
        "flow": {"A": [[0.9]] if discrete else [[-0.1]], **discrete},
        "event": [{"name": "dose", "E": [[1]], "every": [1, 20], "report_delay": 2}],
        "sensor": [
            {"name": "level", "C": [[1]], "noise_bound": 0.1, "every": [0, 9], "report_delay": 2}
        ],
        "observer": {"kind": kind},
    }


def estimates(body: dict[str, Any], *rows: str, options: tuple[str, ...] = ()) -> list[str]:
    """Lines of the estimates of a record whose rows may state when they were received."""
    designed(body).save("d.json")
    Path("a.csv").write_text("\n".join(["t,level,dose,received", *rows, ""]))
    done = ran("run", "d.json", "a.csv", "--initial=-1,1", "-o", "e.csv", *options)
    assert done.exception is None, done.output
    return Path("e.csv").read_text().splitlines()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("options", [(), ("--provisional", "p.csv")])
def test_a_row_that_is_too_late_lets_rows_become_final(options: tuple[str, ...]) -> None:
    """At 20 nothing before 18 can come any more: what arrived then was left out, and ends waits."""
    rows = ["0,.5,,", "1,.5,,", "2,.4,,", "3,.3,,"]
    lines = estimates(of_one_dose(), *rows, ".5,.4,,20", options=options)
    assert [line.split(",")[0] for line in lines[1:]] == ["0.0", "1.0", "2.0", "3.0"]
    assert not any("provisional" in line for line in lines)
    in_time = estimates(of_one_dose(), *rows, "4,,,20")
    assert [x.split(",")[:3] for x in lines] == [x.split(",")[:3] for x in in_time[:5]]


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("lines", [(".2,.1,,1", ".2,,.5,"), (".2,,.5,", ".2,.1,,1")])
def test_rows_of_one_step_fill_each_other_in_any_order_of_lines(lines: tuple[str, str]) -> None:
    """The line that arrives later may stand before the other one in the file."""
    body = of_one_dose(dt=0.1)
    filled = estimates(body, "0,.1,,", *lines, "1,,,")
    assert filled == estimates(body, "0,.1,,", ".2,.1,.5,1", "1,,,")


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("ulps", [1, 4])
def test_a_row_less_than_the_rounding_of_stamps_before_a_final_one(ulps: int) -> None:
    body = of_one_dose()
    body["event"][0]["report_delay"] = body["sensor"][0]["report_delay"] = 0.0
    late = 1.0 - ulps * 2.0**-53
    rows = ["0,.1,,", "1,.1,,1", "2,.1,,2"]
    skipped = estimates(body, *rows[:2], f"{late!r},.1,,1", rows[2])
    assert [line.split(",")[0] for line in skipped[1:]] == ["0.0", "1.0", "2.0"]
    assert [x.split(",")[:3] for x in skipped] == [x.split(",")[:3] for x in estimates(body, *rows)]


@pytest.mark.usefixtures("here")
def test_two_events_of_one_time_end_a_part() -> None:
    body = of_one_dose("set_membership")
    body["event"][0]["every"] = [0, 20]
    rows = ["0,.1,,", "1,,.5,", "1,,.5,", "5,.4,,"]
    whole = estimates(body, *rows)
    first = estimates(body, *rows[:3], options=("--state", "s.json"))
    Path("b.csv").write_text("\n".join(["t,level,dose,received", rows[3], ""]))
    done = ran("run", "d.json", "b.csv", "--state", "s.json", "-o", "f.csv")
    assert done.exception is None
    parts = [*first[1:], *Path("f.csv").read_text().splitlines()[1:]]
    final = [line for line in parts if "provisional" not in line]
    assert final == [line for line in whole[1:] if "provisional" not in line]


@pytest.mark.usefixtures("here")
def test_rows_that_are_all_too_late_name_what_the_lag_comes_from() -> None:
    body = of_one_dose()
    body["event"][0]["time_error"] = 0.25
    designed(body).save("d.json")
    Path("a.csv").write_text("t,level,dose,received\n0,.5,,30\n1,.5,,31\n")
    done = ran("run", "d.json", "a.csv", "--initial=-1,1", "-o", "e.csv")
    assert "at most report_delay and time_error 2.25 late are required" in str(done.exception)
