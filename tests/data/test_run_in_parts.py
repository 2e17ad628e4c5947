"""`run` on streams: parts of a record, lines that are none, data of another plant."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

import obsdesign
from obsdesign import InputError
from obsdesign.cli.commands import cli
from obsdesign.data.left_out import LEFT_OUT
from obsdesign.data.simulation import simulate
from obsdesign.document import digest
from obsdesign.input_files import MOST_BYTES
from tests.cli.test_commands import ROOT, command
from tests.systems.designs import designed

START = ("--initial", "0,2,0,2")
HEADER = "t,y1,jump\n"
RECORD = simulate(
    obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml").plant, until=3.0, step=0.25,
    initial=[1.0, 1.0],
).columns  # fmt: skip
LINES = [
    f"{t},{y},{jump}\n"
    for t, y, jump in zip(*(RECORD[name].tolist() for name in ("t", "y1", "jump")), strict=True)
]
OK = f"{len(LINES)} rows: {len(LINES)} ok"


def ran(*arguments: object, stdin: str | bytes | None = None) -> Result:
    return CliRunner().invoke(cli, [*map(str, arguments)], input=stdin, standalone_mode=False)


@pytest.fixture
def desk(academic_design: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A design, a record, its halves."""
    (tmp_path / "d.json").write_bytes(academic_design.read_bytes())
    for name, part in (("all", LINES), ("one", LINES[:7]), ("two", LINES[7:])):
        (tmp_path / f"{name}.csv").write_text(HEADER + "".join(part))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def halves(*, stdin: bool) -> list[str]:
    """Estimates of the halves, without their headers, through s.json."""
    lines = []
    for name, start in (("one", START), ("two", ())):
        if stdin:
            done = ran("run", "d.json", *start, "--state", "s.json",
                       stdin=Path(f"{name}.csv").read_text())  # fmt: skip
            text = done.stdout
        else:
            done = ran("run", "d.json", f"{name}.csv", *start, "--state", "s.json", "-o", "e.csv")
            text = Path("e.csv").read_text()
        assert (done.exception, done.return_value) == (None, 0)
        lines += text.splitlines()[1:]
    return lines


@pytest.mark.parametrize("stdin", [False, True])
def test_two_halves_are_one_record(desk: Path, stdin: bool) -> None:
    ran("run", "d.json", "all.csv", *START, "-o", "all_est.csv")
    assert halves(stdin=stdin) == (desk / "all_est.csv").read_text().splitlines()[1:]
    body = json.loads((desk / "s.json").read_text())
    assert (body["format"], body["version"]) == ("obsdesign/state", 9)
    assert body["design"] == json.loads((desk / "d.json").read_text())["digest"]


@pytest.mark.parametrize("name", ["luteinizing_hormone", "mattsson_medvedev"])
def test_what_is_not_decided_waits_for_the_next_part(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    body = obsdesign.load_problem(ROOT / "examples" / f"{name}.toml").to_dict()
    if name == "mattsson_medvedev":
        body["output"]["period"] = 0.1
    designed(body).save("d.json")
    ran("simulate", "d.json", "-o", "all.csv")
    header, *lines = Path("all.csv").read_text().splitlines(keepends=True)
    cut = len(lines) // 2
    for part, rows in (("one", lines[:cut]), ("two", lines[cut:])):
        Path(f"{part}.csv").write_text(header + "".join(rows))
    ran("run", "d.json", "all.csv", "-o", "all_est.csv", "--events", "all_ev.csv")
    estimates, events = [], []
    for part in ("one", "two"):
        done = ran("run", "d.json", f"{part}.csv", "--state", "s.json", "-o", "e.csv",
                   "--events", "ev.csv")  # fmt: skip
        assert done.exception is None
        estimates += Path("e.csv").read_text().splitlines()[1:]
        events += Path("ev.csv").read_text().splitlines()[1:]
    whole = Path("all_est.csv").read_text().splitlines()[1:]
    assert estimates == whole[: len(estimates)]
    assert all("unresolved" in line for line in whole[len(estimates) :])
    assert events == [e for e in Path("all_ev.csv").read_text().splitlines()[1:]
                      if "provisional" not in e]  # fmt: skip
    assert len(events) > 3


@pytest.mark.parametrize("rows", [1, 3])
def test_a_part_in_which_nothing_is_decided(
    rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "mattsson_medvedev.toml")).save(
        "d.json"
    )
    lines = [f"{0.18 * k!r},1.0\n" for k in range(rows)]
    Path("few.csv").write_text("t,y1\n" + "".join(lines))
    done = ran("run", "d.json", "few.csv", "--state", "s.json", "-o", "e.csv")
    assert (done.exception, done.return_value) == (None, 0)
    assert done.stderr == "0 rows\n"
    assert len(Path("e.csv").read_text().splitlines()) == 1


def refused(*arguments: object) -> str:
    done = ran("run", "d.json", *arguments)
    assert isinstance(done.exception, InputError), done.exception
    assert done.stdout == ""
    assert len(str(done.exception).splitlines()) == 1
    return str(done.exception)


def signed(body: dict[str, Any]) -> str:
    rest = {key: value for key, value in body.items() if key != "digest"}
    return json.dumps(rest | {"digest": digest(rest)})


def _field(name: str, value: Any) -> Any:
    return lambda body: body["progress"][0].__setitem__(name, value)


def _guard(**entries: Any) -> Any:
    return lambda body: body["progress"][0]["guard"].update(entries)


WRONG: dict[str, Any] = {
    "state.t must be float; got": _field("t", "soon"),
    "state.t must be float; got null": _field("t", None),
    "state.started must be bool; got 1.": _field("started", 1),
    "state.refutation must be str; got []": _field("refutation", []),
    "state.box must be an array; got": _field("box", [1.0, 2.0]),
    "state.u must be an array; got": _field("u", {"array": 99}),
    "state.guard must be DwellGuard with": _field("guard", {"type": "DwellGuard"}),
    'state.type must be IntervalState; got "LuenbergerState"': _field("type", "LuenbergerState"),
    'state.guard.type must be DwellGuard; got "Guard"': _guard(type="Guard"),
    "state.guard.shortest must be 0.7, that of the design; got 0.0": _guard(shortest=0.0),
    "state.guard.longest must be": _guard(longest=1e9),
    "state.guard.jitter must be inf, that of the design; got 0.5": _guard(jitter=0.5),
    'state.guard.longest must be float; got "nan"': _guard(longest="nan"),
    "state.guard.last_jump must be at most": _guard(last_jump=1e6),
    "state.guard.last_jump must be float": _guard(last_jump="soon"),
    "state.guard.last_dwell must be not negative": _guard(last_dwell=-1.0),
    'state.t must be float; got "nan"': _field("t", "nan"),
    "state.t must be finite; got": _field("t", "-inf"),
    'state.sampled must be float; got "nan"': _field("sampled", "nan"),
    "given must be at least 0; got -2": lambda body: body["progress"].__setitem__(2, -2),
    "state must be IntervalState with": lambda body: body["progress"].__setitem__(0, {}),
    "given must be int; got true": lambda body: body["progress"].__setitem__(2, True),
    "waiting must be a list": lambda body: body["progress"].__setitem__(1, "x"),
    "values must be of type float": lambda b: b["arrays"][0].__setitem__("values", [1, 2, 3, 4]),
    "shape must be that of 4 values": lambda b: b["arrays"][0].__setitem__("shape", [3]),
    "dtype must be one of": lambda b: b["arrays"][0].__setitem__("dtype", ["float"]),
    "state.box must be of shape (4); got [3]": lambda b: b["arrays"][0].update(
        shape=[3], values=[0.5, 0.5, 0.5]
    ),
}


@pytest.mark.parametrize("reason", WRONG)
def test_a_signed_state_of_wrong_types_is_refused(desk: Path, reason: str) -> None:
    ran("run", "d.json", "one.csv", *START, "--state", "s.json", "-o", "e.csv")
    body = json.loads((desk / "s.json").read_text())
    WRONG[reason](body)
    (desk / "s.json").write_text(signed(body))
    before = (desk / "s.json").read_bytes()
    assert reason in refused("two.csv", "--state", "s.json", "-o", "two_est.csv")
    assert (desk / "s.json").read_bytes() == before
    assert not (desk / "two_est.csv").exists()


def test_what_a_signed_state_may_hold_is_resumed(desk: Path) -> None:
    """The twin: no jump yet, and NaN where nothing has happened yet."""
    ran("run", "d.json", "one.csv", *START, "--state", "s.json", "-o", "e.csv")
    body = json.loads((desk / "s.json").read_text())
    body["progress"][0]["phase"] = "nan"
    body["progress"][0]["guard"] |= {"last_jump": None, "last_dwell": None}
    (desk / "s.json").write_text(signed(body))
    done = ran("run", "d.json", "two.csv", "--state", "s.json", "-o", "e.csv")
    assert (done.exception, done.return_value) == (None, 0)


def test_states_that_cannot_be_resumed(desk: Path) -> None:
    ran("run", "d.json", "one.csv", *START, "--state", "s.json", "-o", "e.csv")
    text = (desk / "s.json").read_text()
    body = json.loads(text)
    for change, reason in (
        (text[:-40], "not a state file that can be resumed"),
        ("", "not a state file that can be resumed"),
        ("[" * 9999, "not a state file that can be resumed"),
        (signed(body | {"more": json.loads("[" * 60 + "]" * 60)}), "nested deeper than 50"),
        (text.replace('"started": true', '"started": false'), "digest does not match the content"),
        (signed(body | {"version": 1}), "version must be 9; got 1"),
        (signed(body | {"format": "x"}), "format must be 'obsdesign/state'"),
        (signed(body | {"design": "sha256:0"}), "Was it saved by another design?"),
        (signed(body | {"kind": "impulsive"}), "kind must be 'interval'; got 'impulsive'"),
        (signed(body | {"more": 1}), "its keys must be"),
    ):
        assert change != text
        (desk / "s.json").write_text(change)
        assert reason in refused("two.csv", "--state", "s.json")
    (desk / "s.json").write_bytes(b"\xff\xfe" + text.encode())
    assert "UTF-8 text is required; it is not" in refused("two.csv", "--state", "s.json")
    with (desk / "s.json").open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    assert "at most 64 MiB are read; it is larger" in refused("two.csv", "--state", "s.json")
    (desk / "s.json").write_text(text)
    assert "the run goes on from the state in s.json" in refused(
        "two.csv", "--state", "s.json", *START
    )
    again = refused("one.csv", "--state", "s.json")
    assert "line 2: t must increase; got 0.0 after " in again
    assert "is the estimate file" in refused("two.csv", "--state", "e.csv", "-o", "e.csv")
    assert "is the estimate file" in refused("two.csv", "-o", "e.csv", "--events", "./e.csv")
    assert "one of the files that are read" in refused("two.csv", "--state", "two.csv")
    assert "--initial must be" in refused("one.csv", "--state", "new.json")
    assert not (desk / "new.json").exists()
    assert (desk / "s.json").read_text() == text


def test_a_record_that_is_smoothed_has_no_parts(desk: Path) -> None:
    body = obsdesign.load_problem(ROOT / "examples" / "ahn_1.toml").to_dict()
    body["observer"]["differentiator"] = "batch"
    body["output"]["noise_std"] = [0.1] * len(body["output"]["C"])
    designed(body).save("d.json")
    assert "smooths a record as a whole" in refused("one.csv", "--state", "s.json")


# --- lines that are none --------------------------------------------------------------------------

NOISE = [
    b"0.3,oops,0\n",
    b"0.3,1\n",
    b'0.3,"1,0\n',
    b"\xff\xfe\x00,1,0\n",
    b"0.27,1,0\n",
    b"0.3,1,2\n",
]


def noisy() -> bytes:
    """The record with a bad line after its second row, and the others after its tenth."""
    clean = [line.encode() for line in LINES]
    return b"".join([HEADER.encode(), *clean[:2], NOISE[0], *clean[2:10], *NOISE[1:], *clean[10:]])


@pytest.mark.parametrize("stdin", [False, True])
def test_bad_lines_are_reported_and_left_out(desk: Path, stdin: bool) -> None:
    ran("run", "d.json", "all.csv", *START, "-o", "all_est.csv")
    (desk / "noisy.csv").write_bytes(noisy())
    source = () if stdin else ("noisy.csv",)
    text = noisy() if stdin else None
    done = ran("run", "d.json", *source, *START, "--skip-bad", "-o", "e.csv", stdin=text)
    assert (done.exception, done.return_value) == (None, 0)
    ours, clean = ((desk / name).read_text().splitlines() for name in ("e.csv", "all_est.csv"))
    assert ours[:3] == clean[:3]
    # what was left out may have held a jump
    assert ours[3:] == [f"{line.removesuffix(',ok')},{LEFT_OUT}" for line in clean[3:]]
    *remarks, counts = done.stderr.splitlines()
    assert [line.split("Line ")[1] for line in remarks] == [
        f"{number} is skipped." for number in (4, 13, 14, 15, 16, 17)
    ]
    assert "line 4: y1 must be a finite number or empty; got 'oops'." in remarks[0]
    assert LEFT_OUT in counts
    done = ran("run", "d.json", *source, *START, "-o", "e2.csv", stdin=text)
    assert isinstance(done.exception, InputError)
    assert "line 4: y1 must be" in str(done.exception)
    assert not (desk / "e2.csv").exists()


def test_a_pipe_is_answered_up_to_the_bad_line(desk: Path) -> None:
    done = command("run", "d.json", *START, cwd=desk, stdin=HEADER + LINES[0] + "0.1,x,0\n")
    assert done.returncode == 2
    assert len(done.stdout.splitlines()) == 2
    assert done.stderr == (
        "obsdesign: standard input line 3: y1 must be a finite number or empty; got 'x'.\n"
    )


# --- data of another plant ------------------------------------------------------------------------


def test_measurements_that_the_plant_does_not_have(desk: Path) -> None:
    rows = "".join(line.replace("\n", ",7,9\n") for line in LINES)
    (desk / "more.csv").write_text("t,y1,jump,y2,y10\n" + rows)
    done = ran("run", "d.json", "more.csv", *START, "-o", "e.csv")
    assert done.stderr.splitlines()[0] == (
        "obsdesign: more.csv: y2, y10 of the header are not used, since the design's plant has 1 "
        "output. Is it the data of another plant?"
    )
    assert done.return_value == 0
    done = ran("run", "d.json", "all.csv", *START, "-o", "e.csv")
    assert done.stderr == f"{OK}\n"


@pytest.mark.parametrize(("bad", "warned"), [(3, True), (10, False)])
def test_bounds_that_are_void_on_most_rows(desk: Path, bad: int, warned: bool) -> None:
    cells = [line.split(",") for line in LINES]
    rows = [f"{t},{float(y) + 99 * (k >= bad)},{jump}" for k, (t, y, jump) in enumerate(cells)]
    (desk / "other.csv").write_text(HEADER + "".join(rows))
    done = ran("run", "d.json", "other.csv", *START, "-o", "e.csv")
    void = sum("void" in line for line in (desk / "e.csv").read_text().splitlines())
    assert (void > len(LINES) / 2) is warned
    expected = f"obsdesign: other.csv: the bounds are void on {void} of {len(LINES)} rows:"
    assert done.stderr.startswith(expected) is warned
    assert done.return_value == 0
    strict = ran("run", "d.json", "other.csv", *START, "-o", "e.csv", "--strict")
    assert (strict.exception, strict.return_value) == (None, 4)
    fine = ran("run", "d.json", "all.csv", *START, "-o", "e.csv", "--strict")
    assert (fine.exception, fine.return_value) == (None, 0)


def test_rows_after_a_large_input_are_of_this_plant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What voids the bound of an error is a known input, no measurement."""
    monkeypatch.chdir(tmp_path)
    heater: dict[str, Any] = {
        "flow": {"A": [[-1]], "B": [[1]], "input_bound": [1]}, "output": {"C": [[1]]},
        "parameter": [{"name": "gain", "range": [-0.1, 0.1], "B": [[1]]}],
        "observer": {"kind": "luenberger", "gains": {"L": [[1]]}},
    }  # fmt: skip
    designed(heater).save("d.json")
    for part, rows in (("one", "0,0,0\n1,0,5\n"), ("two", "2,0,0\n3,0,0\n4,0,0\n")):
        Path(f"{part}.csv").write_text("t,y1,u1\n" + rows)
        done = ran("run", "d.json", f"{part}.csv", "--state", "s.json", "-o", "e.csv")
    assert "2 error bound void (first at t = 3)" in done.stderr
    assert "another plant" not in done.stderr


def test_a_design_with_an_unproved_claim_says_so(desk: Path) -> None:
    assert "not proved" not in ran("run", "d.json", "all.csv", *START).stderr
    design = obsdesign.load_design(desk / "d.json")
    claims = [replace(claim, verdict="undecided") for claim in design.claims[-2:]]
    replace(design, claims=(*design.claims[:-2], *claims)).save(desk / "d.json")
    done = ran("run", "d.json", "all.csv", *START)
    names = ", ".join(claim.id for claim in claims)
    assert f"d.json: {names} not proved: what rests on them is not guaranteed." in done.stderr
    assert done.return_value == 0


def test_a_design_without_warnings_keeps_its_digest(tmp_path: Path) -> None:
    """Files written before there were warnings are signed without them."""
    design = obsdesign.design(obsdesign.load_problem(ROOT / "examples" / "degue_4_1.toml"))
    body = {key: value for key, value in design.to_dict().items() if key != "warnings"}
    body["digest"] = digest({key: value for key, value in body.items() if key != "digest"})
    path = tmp_path / "older.json"
    path.write_text(json.dumps(body), encoding="utf-8")
    assert obsdesign.load_design(path).to_dict()["digest"] == body["digest"]
    assert design.to_dict()["digest"] != body["digest"]


@pytest.mark.parametrize("cut", [30, 61])
@pytest.mark.parametrize("options", [{}, {"operator": "samples"}], ids=["integral", "samples"])
def test_an_input_that_changed_behind_a_delayed_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], cut: int
) -> None:
    """The state of an observer that decides later is of an earlier time than the last input."""
    monkeypatch.chdir(tmp_path)
    body = {
        "flow": {"A": [[-1, 0], [1, -0.4]], "B": [[1], [0]]},
        "jump": {"H": [[1], [0]], "dwell_time": [5, "inf"]},
        "output": {"C": [[0, 1]], "noise_std": [0.01], "measured": "periodic", "period": 0.25},
        "observer": {"kind": "impulsive_input", **options},
    }
    obsdesign.design(obsdesign.Problem.from_dict(body)).save("d.json")
    rows = [f"{0.25 * k},0.0,{0.1 * (k // 12 % 2)}" for k in range(100)]
    written = []
    for k, part in enumerate((rows, rows[:cut], rows[cut:])):
        Path("a.csv").write_text("\n".join(["t,y1,u1", *part, ""]))
        state = ["--state", "s.json"] if k else []
        done = ran("run", "d.json", "a.csv", "-o", "e.csv", *state)
        assert done.exception is None, done.exception
        written.append(Path("e.csv").read_text().splitlines()[1:])
    whole, first, second = (
        [line for line in lines if "unresolved" not in line] for lines in written
    )
    assert [*first, *second] == whole
    stored = json.loads(Path("s.json").read_text())
    (in_force,) = (x for x in stored["progress"][1:] if isinstance(x, dict))
    in_force["since"] = 1e6
    Path("s.json").write_text(signed(stored))
    assert "in_force.since must be at most" in refused("a.csv", "--state", "s.json", "-o", "e.csv")
