"""Commands as a user types them: files, exit codes, one JSON object, nothing half-written."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import obsdesign
from obsdesign.cli import commands as cli
from obsdesign.document import digest
from tests.systems.command_line import command

ROOT = Path(__file__).parents[2]
ACADEMIC = ROOT / "examples" / "degue_4_1.toml"


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_whole_way(tmp_path: Path) -> None:
    done = command("design", ACADEMIC, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    reply = json.loads(done.stdout)
    assert set(reply) == {"command", "verdict", "kind", "claims", "result"}
    assert (reply["command"], reply["verdict"], reply["kind"]) == ("design", "proved", "interval")
    assert reply["result"]["file"] == "design.json"

    verified = command("verify", "design.json", "--json", cwd=tmp_path)
    assert verified.returncode == 0, verified.stderr
    assert json.loads(verified.stdout)["verdict"] == "proved"
    paranoid = command("verify", "design.json", "--paranoid", cwd=tmp_path)
    assert paranoid.returncode == 0, paranoid.stderr

    for disturbance in ("zero", "extreme", "random", "sine"):
        made = command(
            "simulate", "design.json", "--until", 9, "--initial", "1,1", "--seed", 3,
            "--disturbance", disturbance, "-o", "data.csv", cwd=tmp_path,
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        ran = command(
            "run", "design.json", "data.csv", "--initial", "0,2,0,2", "-o", "est.csv", cwd=tmp_path
        )
        assert ran.returncode == 0, ran.stderr
        data, estimates = rows(tmp_path / "data.csv"), rows(tmp_path / "est.csv")
        assert list(estimates[0]) == ["t", "x1_lo", "x1_hi", "x2_lo", "x2_hi", "status"]
        assert [row["t"] for row in estimates] == [row["t"] for row in data]
        assert {row["status"] for row in estimates} == {"ok"}
        assert ran.stderr == f"{len(data)} rows: {len(data)} ok\n"
        for truth, bounds in zip(data, estimates, strict=True):
            for i in (1, 2):
                assert (
                    float(bounds[f"x{i}_lo"]) <= float(truth[f"x{i}"]) <= float(bounds[f"x{i}_hi"])
                )

    streamed = command(
        "run", "design.json", "--initial", "0,2,0,2", cwd=tmp_path,
        stdin=(tmp_path / "data.csv").read_text(),
    )  # fmt: skip
    assert streamed.stdout == (tmp_path / "est.csv").read_text()

    for picture in ("fig.png", "fig.svg"):
        drawn = command("plot", "est.csv", "data.csv", "-o", picture, cwd=tmp_path)
        assert drawn.returncode == 0, drawn.stderr
        assert (tmp_path / picture).stat().st_size > 10_000
    alone = command("plot", "est.csv", cwd=tmp_path)
    assert alone.returncode == 0, alone.stderr
    assert (tmp_path / "estimate.png").exists()


def test_a_refuted_problem_writes_nothing_and_shows_the_witness(tmp_path: Path) -> None:
    text = ACADEMIC.read_text().replace("[0.7, inf]", "[0.658, inf]")
    (tmp_path / "p.toml").write_text(text)
    done = command("design", "p.toml", "--allow-undecided", cwd=tmp_path)
    assert done.returncode == 1
    assert "refuted" in done.stdout
    assert "0.658" in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["p.toml"]
    reply = json.loads(command("design", "p.toml", "--json", cwd=tmp_path).stdout)
    assert reply["verdict"] == "refuted"
    assert reply["result"]["file"] is None


def test_design_and_problem_match_their_published_schemas(tmp_path: Path) -> None:
    design = obsdesign.design(obsdesign.load_problem(ACADEMIC)).to_dict()
    schemas = {}
    for which in ("problem", "design"):
        done = command("schema", which, cwd=tmp_path)
        assert done.returncode == 0
        schemas[which] = json.loads(done.stdout)
        jsonschema.Draft202012Validator.check_schema(schemas[which])
    jsonschema.validate(design, schemas["design"])
    jsonschema.validate(design["problem"], schemas["problem"])
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(design | {"verdict": True}, schemas["design"])


def test_simulation_is_seeded(tmp_path: Path) -> None:
    texts = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        command("simulate", ACADEMIC, "--seed", seed, "-o", name, cwd=tmp_path)
        texts.append((tmp_path / name).read_text())
    assert texts[0] == texts[1] != texts[2]


# --- bad input: exit 2, one line on stderr, empty stdout, no file touched ----------------------


@pytest.fixture
def desk(tmp_path: Path, academic_design: Path) -> Path:
    """A folder with a design and a good data file."""
    (tmp_path / "d.json").write_bytes(academic_design.read_bytes())
    (tmp_path / "good.csv").write_text("t,y1,jump\n0,1,0\n0.1,0.9,0\n0.2,,1\n")
    return tmp_path


def refused(desk: Path, *arguments: object, line: str) -> None:
    before = {path: path.read_bytes() for path in desk.iterdir() if path.is_file()}
    done = command(*arguments, cwd=desk)
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr == f"obsdesign: {line}\n"
    assert {path: path.read_bytes() for path in desk.iterdir() if path.is_file()} == before


DATA_FAULTS = {
    "unsorted": (
        "t,y1,jump\n0,1,0\n0.2,1,0\n0.1,1,0\n",
        "bad.csv line 4: t must increase; got 0.1 after 0.2. Are the rows sorted, without repeats?"
        " A row that arrives late needs report_delay of its [[event]] or [[sensor]].",
    ),
    "repeated": (
        "t,y1,jump\n0,1,0\n0,1,0\n",
        "bad.csv line 3: t must increase; got 0.0 after 0.0. Are the rows sorted, without repeats?",
    ),
    "no y": ("t,jump\n0,0\n", "bad.csv: column 'y1' is required; the header has t, jump."),
    "no jump": ("t,y1\n0,0\n", "bad.csv: column 'jump' is required; the header has t, y1."),
    "text": (
        "t,y1,jump\n0,1,0\n0.1,high,0\n",
        "bad.csv line 3: y1 must be a finite number or empty; got 'high'.",
    ),
    "nan": (
        "t,y1,jump\n0,nan,0\n",
        "bad.csv line 2: y1 must be a finite number or empty; got 'nan'.",
    ),
    "time": ("t,y1,jump\nnoon,1,0\n", "bad.csv line 2: t must be a finite number; got 'noon'."),
    "flag": ("t,y1,jump\n0,1,2\n", "bad.csv line 2: jump must be 0 or 1; got '2'."),
    "short row": (
        "t,y1,jump\n0,1\n",
        "bad.csv line 2: 3 values are required, one per column; got 2.",
    ),
    "empty": (
        "",
        "bad.csv: a header line with column 't', ... is required; the file is empty.",
    ),
    "header only": (
        "t,y1,jump\n",
        "bad.csv: at least one row of data is required; there is only a header.",
    ),
    "doubled": (
        "t,y1,y1,jump\n0,1,1,0\n",
        "bad.csv: column 'y1' stands 2 times in the header.",
    ),
}


@pytest.mark.parametrize("fault", DATA_FAULTS)
def test_data_that_cannot_be_read(desk: Path, fault: str) -> None:
    text, line = DATA_FAULTS[fault]
    (desk / "bad.csv").write_text(text)
    refused(desk, "run", "d.json", "bad.csv", "--initial", "0,2,0,2", "-o", "est.csv", line=line)


def test_binary_data(desk: Path) -> None:
    (desk / "bad.csv").write_bytes(b"\xff\xfe\x00t")
    refused(
        desk, "run", "d.json", "bad.csv", "--initial", "0,2,0,2",
        line="bad.csv: UTF-8 text is required; it is not. Is it a binary file?",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("initial", "line"),
    [
        ((), "--initial must be the 4 numbers x1_lo,x1_hi,x2_lo,x2_hi; got nothing."),
        (("--initial", "0,2"), "--initial must be the 4 numbers x1_lo,x1_hi,x2_lo,x2_hi; got 2 numbers."),
        (("--initial", "0,2,3,2"), "--initial: initial bounds of x2: lower 3 exceeds upper 2."),
        (("--initial", "0,2,a,2"), "--initial must be numbers separated by commas; got '0,2,a,2'."),
        (("--initial", "0,inf,0,2"), "--initial: initial bounds of x1 must be finite numbers; got 0, inf."),
    ],
)  # fmt: skip
def test_initial_bounds_that_are_none(desk: Path, initial: tuple[str, ...], line: str) -> None:
    refused(desk, "run", "d.json", "good.csv", *initial, "-o", "est.csv", line=line)


def tampered(desk: Path, change: Any, sign: bool = False) -> None:
    body = json.loads((desk / "d.json").read_text())
    change(body)
    if sign:
        body["digest"] = digest(body)
    (desk / "d.json").write_text(json.dumps(body))


def test_a_design_with_a_changed_digit(desk: Path) -> None:
    original = json.loads((desk / "d.json").read_text())["digest"]
    tampered(desk, lambda body: body["gains"]["L"].__setitem__(1, [1.0000001]))
    changed = digest(json.loads((desk / "d.json").read_text()))
    line = (
        f"d.json: digest does not match the content ('{original}', content gives '{changed}'). "
        "The file was changed after it was written."
    )
    refused(desk, "verify", "d.json", line=line)
    refused(desk, "run", "d.json", "good.csv", "--initial", "0,2,0,2", line=line)


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("version", 2, "d.json: version must be 1; got 2. Was it written by a newer obsdesign?"),
        ("version", True, "d.json: version must be 1; got True. Was it written by a newer obsdesign?"),
        ("format", "x", "d.json: format must be 'obsdesign/design'; got 'x'."),
        ("extra", 1, "d.json: unknown key 'extra' in a design file."),
        ("claims", {}, "d.json: claims must be a list; got dict."),
    ],
)  # fmt: skip
def test_designs_of_another_make(desk: Path, key: str, value: Any, line: str) -> None:
    tampered(desk, lambda body: body.__setitem__(key, value), sign=True)
    refused(desk, "verify", "d.json", line=line)


def test_files_that_are_no_design(desk: Path) -> None:
    (desk / "empty.json").write_text("")
    refused(desk, "verify", "empty.json",
            line="empty.json: not a design file: not valid JSON (the file is empty).")  # fmt: skip
    refused(desk, "verify", "none.json",
            line="none.json: cannot be read: No such file or directory.")  # fmt: skip
    (desk / "cut.json").write_text((desk / "d.json").read_text()[:100])
    done = command("verify", "cut.json", cwd=desk)
    assert done.returncode == 2
    assert done.stderr.startswith("obsdesign: cut.json: not a design file: not valid JSON (")


def test_usage(desk: Path) -> None:
    refused(desk, "verify", line="Missing argument 'DESIGN'.")
    refused(desk, "plot", "good.csv", "-o", "fig.gif",
            line="fig.gif: a picture must end in .png, .svg or .pdf.")  # fmt: skip
    refused(desk, "design", ACADEMIC, "-o", "no/such/folder.json",
            line="no/such/folder.json: cannot be written: no such folder, or a folder itself.")  # fmt: skip
    refused(desk, "simulate", ACADEMIC, "--until", "-1",
            line="until must be a positive finite number; got -1.0.")  # fmt: skip
    refused(desk, "simulate", ACADEMIC, "--dwell", "often",
            line="--dwell must be shortest, random, a number or a file; got 'often'.")  # fmt: skip


# --- a design that was signed again after a change: false, not unreadable ----------------------


def _less(body: dict[str, Any]) -> None:
    body["problem"]["jump"]["dwell_time"][0] = 0.5


def _gain(body: dict[str, Any]) -> None:
    body["gains"]["L"][1][0] = 0.5


def _split(body: dict[str, Any]) -> None:
    body["gains"]["D1"][0][1] = 0.25


def _drop(body: dict[str, Any]) -> None:
    body["claims"] = [c for c in body["claims"] if c["id"] != "hurwitz"]


def _certificate(body: dict[str, Any]) -> None:
    claim = next(c for c in body["claims"] if c["id"] == "dwell_stability")
    claim["evidence"]["P"] = [[1.0, 0.0], [0.0, 1.0]]


def _promise(body: dict[str, Any]) -> None:
    body["guarantees"][0]["statement"] += " And it is always right."


def _rests_on(body: dict[str, Any]) -> None:
    body["guarantees"][0]["claims"] = ["consistent", "common_sense"]


def _rests_on_less(body: dict[str, Any]) -> None:
    body["guarantees"][0]["claims"].pop()


def _range(body: dict[str, Any]) -> None:
    body["problem"]["jump"]["dwell_time"][0] = 0.5
    body["gains"]["dwell_time"][0] = 0.5


def _twice(body: dict[str, Any]) -> None:
    true = next(c for c in body["claims"] if c["id"] == "dwell_stability")
    body["claims"].insert(0, true | {"statement": "stable for dwell times from 0"})


def _unknown_input(body: dict[str, Any]) -> None:
    body["problem"]["flow"]["D"] = [[1.0], [0.0]]


def _periodic(body: dict[str, Any]) -> None:
    body["problem"]["output"] |= {"measured": "periodic", "period": 0.1}


def _other_name(body: dict[str, Any]) -> None:
    body["name"] = "another plant"


def _coordinates(body: dict[str, Any]) -> None:
    body["problem"]["observer"]["form"] = body["gains"]["form"] = "coordinates"


def _lost(body: dict[str, Any]) -> None:
    body["gains"]["D0"] = body["gains"]["D1"] = [[1e20, 1e20], [1e20, 1e20]]


def _no_dwell(body: dict[str, Any]) -> None:
    del body["problem"]["jump"]["dwell_time"]


def _rate(body: dict[str, Any]) -> None:
    next(c for c in body["claims"] if c["id"] == "rates")["evidence"]["in_time"] = 0.5


LIES = [_rests_on, _rests_on_less, _rate, _less, _gain, _split, _drop, _certificate, _promise, _range, _twice, _unknown_input,
        _periodic, _other_name, _coordinates, _lost]  # fmt: skip

MALFORMED = {
    "dwell_time": _no_dwell,
    "evidence": lambda b: b["claims"][0].__setitem__("evidence", None),
    "id": lambda b: b["claims"][0].__setitem__("id", ["x"]),
    "huge": lambda b: b["gains"].__setitem__("D0", [[10**400, 0], [0, 0]]),
}


@pytest.mark.parametrize("fault", MALFORMED)
def test_a_signed_file_that_is_no_design(desk: Path, fault: str) -> None:
    tampered(desk, MALFORMED[fault], sign=True)
    done = command("verify", "d.json", cwd=desk)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("obsdesign: d.json: ")


CERTIFICATES = ["x", [], [[1]], [[1, 2], [3]], None, 7, {"a": 1}, [[1e308, 0], [0, 1e308]]]


@pytest.mark.parametrize("P", CERTIFICATES)
def test_certificates_of_any_kind_are_survived(desk: Path, P: Any) -> None:
    def change(body: dict[str, Any]) -> None:
        next(c for c in body["claims"] if c["id"] == "dwell_stability")["evidence"]["P"] = P

    tampered(desk, change, sign=True)
    done = command("verify", "d.json", "--json", cwd=desk)
    assert done.returncode in (1, 3), done.stderr
    assert json.loads(done.stdout)["verdict"] != "proved"


@pytest.mark.parametrize("gain", [None, "x", [[1.0]], [1.0, 2.0]])
@pytest.mark.parametrize("name", ["A", "D0", "L"])
def test_gains_that_cannot_run(desk: Path, name: str, gain: Any) -> None:
    def change(body: dict[str, Any]) -> None:
        if gain is None:
            del body["gains"][name]
        else:
            body["gains"][name] = gain

    tampered(desk, change, sign=True)
    done = command("run", "d.json", "good.csv", "--initial", "0,2,0,2", cwd=desk)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("obsdesign: d.json: gains.")
    assert len(done.stderr.splitlines()) == 1


def test_keys_that_stand_twice(desk: Path) -> None:
    text = (desk / "d.json").read_text()
    (desk / "d.json").write_text(text.replace('"version": 1', '"version": 1, "version": 1'))
    line = "d.json: not a design file: not valid JSON (key 'version' stands 2 times)."
    refused(desk, "verify", "d.json", line=line)


def test_links_and_devices_are_written_through(desk: Path) -> None:
    (desk / "real.csv").write_text("old")
    (desk / "link.csv").symlink_to("real.csv")
    run = ("run", "d.json", "good.csv", "--initial", "0,2,0,2")
    assert command(*run, "-o", "link.csv", cwd=desk).returncode == 0
    assert (desk / "link.csv").is_symlink()
    assert (desk / "real.csv").read_text().startswith("t,x1_lo")
    assert command(*run, "-o", "/dev/null", cwd=desk).returncode == 0
    assert not Path("/dev/null").is_file()


@pytest.mark.parametrize("change", LIES)
def test_a_signed_lie_is_not_verified(desk: Path, change: Any) -> None:
    tampered(desk, change, sign=True)
    done = command("verify", "d.json", "--json", cwd=desk)
    # a certificate that shows nothing leaves a claim open; everything else is plainly false
    expected = (3, "undecided") if change is _certificate else (1, "refuted")
    assert (done.returncode, json.loads(done.stdout)["verdict"]) == expected, done.stderr


def test_the_document_round_trips_exactly(academic_design: Path, tmp_path: Path) -> None:
    design = obsdesign.load_design(academic_design)
    design.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == academic_design.read_bytes()
    assert np.array_equal(design.gains["M"], [[1.0], [2.8]])


def test_check_answers_for_every_kind(tmp_path: Path) -> None:
    done = command("check", ACADEMIC, "--json", cwd=tmp_path)
    reply = json.loads(done.stdout)
    assert (done.returncode, reply["verdict"]) == (0, "proved")
    assert reply["result"]["interval"].items() >= {"verdict": "proved", "reasons": []}.items()
    kinds = {
        "interval",
        "set_membership",
        "luenberger",
        "impulsive",
        "finite_time",
        "impulsive_input",
        "unknown_input",
    }
    assert set(reply["result"]) == kinds
    (tmp_path / "p.toml").write_text(
        ACADEMIC.read_text().replace("[output]", "H = [[1], [0]]\n[output]")
    )
    reply = json.loads(command("check", "p.toml", "--json", cwd=tmp_path).stdout)
    assert reply["result"]["interval"]["verdict"] == "does_not_apply"
    assert reply["result"]["interval"]["reasons"][0].startswith(
        "jump.H is refused by kind 'interval'"
    )
    lines = command("check", ACADEMIC, cwd=tmp_path).stdout.splitlines()
    assert lines[0].split()[:4] == ["✓", "interval", "obsdesign", "design"]
    assert any(line.startswith("–  finite_time      does not apply: ") for line in lines)


def test_a_design_never_replaces_its_problem(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text(ACADEMIC.read_text())
    done = command("design", "p.toml", "-o", "./p.toml", cwd=tmp_path)
    assert done.returncode == 2
    assert (
        done.stderr
        == "obsdesign: ./p.toml: cannot be written: it is one of the files that are read.\n"
    )
    assert (tmp_path / "p.toml").read_text() == ACADEMIC.read_text()


def test_no_input_is_written_over(desk: Path) -> None:
    line = "cannot be written: it is one of the files that are read."
    start = ("--initial", "0,2,0,2")
    refused(desk, "run", "d.json", "good.csv", *start, "-o", "good.csv", line=f"good.csv: {line}")
    refused(desk, "run", "d.json", "good.csv", *start, "-o", "d.json", line=f"d.json: {line}")
    refused(desk, "simulate", "d.json", "-o", "d.json", line=f"d.json: {line}")


def test_likely_causes_of_a_missing_column(desk: Path) -> None:
    for text, hint in (("t;y1;jump\n", "Columns are separated by commas."),
                       ("T,Y1,jump\n", "Names of columns are in small letters.")):  # fmt: skip
        (desk / "bad.csv").write_text(text)
        titles = text.strip().replace(",", ", ")
        line = f"bad.csv: column 't' is required; the header has {titles}. {hint}"
        refused(desk, "run", "d.json", "bad.csv", "--initial", "0,2,0,2", line=line)


def test_every_reason_is_counted(desk: Path) -> None:
    (desk / "rows.csv").write_text("t,y1,jump\n0,1,1\n0.1,1,1\n0.2,,1\n")
    done = command("run", "d.json", "rows.csv", "--initial", "0,2,0,2", "-o", "e.csv", cwd=desk)
    assert (
        done.stderr == "3 rows: 2 dwell time below 0.7 (0.1; first at t = 0.1), 1 ok, "
        "1 y1 outside its bounds (at t = 0.1), 1 missing sample (at t = 0.2), "
        "1 bounds void (at t = 0.2)\n"
    )


def test_events_of_interval_bounds_go_to_a_file(desk: Path) -> None:
    (desk / "rows.csv").write_text("t,y1,jump\n0,1,0\n1,1,1\n1.5,1,1\n")
    done = command("run", "d.json", "rows.csv", "--initial", "0,2,0,2", "-o", "e.csv",
                   "--events", "log.csv", cwd=desk)  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = (desk / "log.csv").read_text().splitlines()
    assert lines[:2] == ["t,event", "1.0,jump"]
    assert "1.5,jump" in lines
    assert "1.5,dwell time 0.5 below 0.7" in lines


def test_output_that_cannot_be_written_is_no_verdict(desk: Path) -> None:
    import os

    if not os.path.exists("/dev/full"):
        pytest.skip("needs /dev/full")
    code = "from obsdesign.cli.main import main; main()"
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code, "verify", "d.json", "--json"],
            cwd=desk, stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "obsdesign: the output cannot be written: No space left on device.\n"


def test_a_jump_in_the_data_of_a_plant_without_jumps(tmp_path: Path) -> None:
    design = obsdesign.design(obsdesign.load_problem(ACADEMIC.parent / "ahn_1.toml"))
    design.save(tmp_path / "design.json")
    data = tmp_path / "data.csv"
    data.write_text("t,y1,y2,jump\n0,1,1,0\n0.1,1,1,1\n")
    done = command("run", "design.json", "data.csv", "-o", "est.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert "line 3: jump must be 0, since the design's plant has no [jump]" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "est.csv").exists()
    data.write_text("t,y1,y2,jump\n0,1,1,0\n0.1,1,1,0\n")
    assert command("run", "design.json", "data.csv", cwd=tmp_path).returncode == 0


def test_impulses_are_announced_to_kinds_that_cannot_find_them(tmp_path: Path) -> None:
    text = (
        "[flow]\nA = [[0, 1], [-1, -1]]\n[jump]\nH = [[0], [1]]\ndwell_time = [0.3, 1.2]\n"
        '[output]\nC = [[1, 0]]\n[observer]\nkind = "{kind}"\n'
    )
    for kind, announced in (("luenberger", True), ("impulsive_input", False)):
        problem, data = tmp_path / f"{kind}.toml", tmp_path / f"{kind}.csv"
        problem.write_text(text.replace("{kind}", kind))
        assert command("simulate", problem, "-o", data, cwd=tmp_path).returncode == 0
        assert ("jump" in data.read_text().splitlines()[0].split(",")) == announced
    design, estimate = tmp_path / "design.json", tmp_path / "estimate.csv"
    assert (
        command("design", tmp_path / "luenberger.toml", "-o", design, cwd=tmp_path).returncode == 0
    )
    assert (
        command("run", design, tmp_path / "luenberger.csv", "-o", estimate, cwd=tmp_path).returncode
        == 0
    )
    status = [line.rsplit(",", 1)[1] for line in estimate.read_text().splitlines()[1:]]
    assert status
    assert set(status) == {"ok"}


@pytest.mark.parametrize("link", ["__cause__", "__context__"])
def test_what_a_library_makes_of_an_interruption_is_one(
    link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A callback of matplotlib turns Ctrl-C into a ValueError; an error of our own ends with 70."""

    def interrupted(*_: object) -> None:
        error = ValueError("Invalid bounding box")
        setattr(error, link, KeyboardInterrupt())
        raise error

    def failing(*_: object) -> None:
        raise ValueError("Invalid bounding box")

    monkeypatch.setattr("sys.argv", ["obsdesign", "schema", "problem"])
    for body, code in ((interrupted, 130), (failing, 70)):
        monkeypatch.setattr(cli.cli, "invoke", body)
        with pytest.raises(SystemExit) as end:
            cli.main()
        assert end.value.code == code
