"""`obsdesign sweep`: neither order, workers nor interruptions change what it finds."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import obsdesign
from obsdesign import InputError
from obsdesign.document import jsonable
from obsdesign.pages.plotting.sweep import plot_sweep
from obsdesign.studies.search.search import search
from obsdesign.studies.sweep import workers
from obsdesign.studies.sweep.axes import Axis, changed, entries, parse_axis, require_number
from obsdesign.studies.sweep.point import Plan, SweepPoint, evaluate, plan_sweep
from obsdesign.studies.sweep.record import SweepHeader, read_sweep
from obsdesign.studies.sweep.run import run_sweep
from tests.cli.test_commands import ROOT, command

ACADEMIC = ROOT / "examples" / "degue_4_1.toml"
DIED = "the process that worked on this point died more than once; was it out of memory?"


def stability(name: str = "plant") -> obsdesign.Problem:
    """Of a plant alone: quick, with a longest dwell time of ln 2 / 1.2 at G[1][1] = 0.5."""
    return obsdesign.Problem(
        flow={"A": [[-1, 0.1], [0, 1.2]]}, output={"C": [[1, 0]]}, name=name,
        jump={"G": [[0.5, 0], [0, 0.5]], "dwell_time": [0.01, 0.1]},
        observer={"kind": "luenberger", "gains": {"L": [[0], [0]], "M": [[0], [0]]}},
    )  # fmt: skip


def plan(*over: str, what: str = "verdict", name: str = "plant") -> Plan:
    return plan_sweep(stability(name), [parse_axis(text) for text in over], what, 1e-6)


def dies(plan: Plan, index: int) -> SweepPoint:
    """Point 1 kills its process: the first time if a flag can be raised, else every time."""
    flag = Path(plan.body["name"])
    if index == 1 and not flag.exists():
        if flag.parent.exists():
            flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return evaluate(plan, index)


DWELL = "jump.dwell_time[1]=0.1:1:7"


def test_a_point_is_what_a_search_says_alone(tmp_path: Path) -> None:
    sweep_plan = plan("jump.G[1][1]=0.2:0.8:3", "flow.A[1][1]=1.2:-1:2", what="longest_dwell")
    rows = run_sweep(sweep_plan, str(tmp_path / "s.jsonl"))
    assert [row.at for row in rows] == [(g, a) for g in (0.2, 0.5, 0.8) for a in (1.2, -1.0)]
    for row in rows:
        body = stability().to_dict()
        body["jump"]["G"][1][1], body["flow"]["A"][1][1] = row.at
        alone = search(obsdesign.Problem.from_dict(body), "longest_dwell")
        assert row.verdict == alone.verdict
        assert row.value == jsonable(alone.result["proved"])
        assert row.answer.limit[0] == jsonable(alone.result["not_proved"])
        grows = row.at[1] > 0
        limit = -np.log(row.at[0]) / 1.2 if grows else np.inf
        assert float(row.value) == pytest.approx(limit, rel=2e-6)


@pytest.mark.parametrize(
    ("what", "claim", "entry"), [("width", "width", "always"), ("decay_rate", "rates", "in_time")]
)
def test_a_point_is_what_a_design_says_alone(what: str, claim: str, entry: str) -> None:
    problem = obsdesign.load_problem(ACADEMIC)
    sweep_plan = plan_sweep(problem, [parse_axis("jump.dwell_time[0]=0.6:0.8:2")], what, 1e-6)
    refuted, proved = (evaluate(sweep_plan, index) for index in (0, 1))
    design = obsdesign.design(problem.with_dwell_time(0.8, float("inf")))
    evidence = {c.id: c.evidence for c in design.claims}[claim]
    assert proved.value == np.max(evidence[entry])
    assert (proved.verdict, refuted.verdict) == ("proved", "refuted")
    assert refuted.value is None
    assert refuted.answer.reason.startswith("dwell_stability: ")


def test_the_error_of_samples_grows_with_their_noise() -> None:
    problem = obsdesign.Problem(
        flow={"A": [[0, 1], [-1, 0]]}, observer={"kind": "finite_time", "window": 0.8},
        output={"C": [[1, 0]], "measured": "periodic", "period": 0.2, "noise_bound": [0.1]},
    )  # fmt: skip
    sweep_plan = plan_sweep(problem, [parse_axis("output.noise_bound[0]=0.1:0.2:2")], "error", 1e-6)
    one, two = (evaluate(sweep_plan, index).value for index in (0, 1))
    assert two == pytest.approx(2 * one, rel=1e-6)


@pytest.mark.parametrize("jobs", [None, 1, 2])
def test_neither_workers_nor_order_change_the_file(tmp_path: Path, jobs: int | None) -> None:
    sweep_plan = plan(DWELL)
    expected = [evaluate(sweep_plan, index) for index in range(len(sweep_plan))]
    assert {row.verdict for row in expected} == {"proved", "refuted"}
    rows = run_sweep(sweep_plan, str(tmp_path / "s.jsonl"), jobs=jobs)
    assert rows == expected
    shuffled = random.Random(3).sample(range(len(sweep_plan)), len(sweep_plan))
    points = list(workers.evaluate_all(sweep_plan, shuffled, jobs))
    assert sorted(points, key=lambda row: row.index) == expected
    text = [json.loads(line) for line in (tmp_path / "s.jsonl").read_text("utf-8").splitlines()]
    signatures = [line.pop("digest") for line in text[1:]]
    assert text == [
        SweepHeader.from_plan(sweep_plan).to_dict(),
        *(point.to_dict() for point in expected),
    ]
    assert len(set(signatures)) == len(sweep_plan)


@pytest.mark.parametrize("cut", [0, 1, 40, -1, -2, -60, -200])
def test_an_interrupted_sweep_goes_on(tmp_path: Path, cut: int) -> None:
    sweep_plan, path = plan(DWELL), tmp_path / "s.jsonl"
    run_sweep(sweep_plan, str(path))
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    stopped = b"".join([lines[0], *random.Random(cut).sample(lines[1:], len(lines) - 1)])
    path.write_bytes(stopped[:cut])
    kept = max(stopped[:cut].count(b"\n") - 1, 0)
    steps: list[int] = []
    run_sweep(sweep_plan, str(path), progress=lambda done, total: steps.append(done))
    assert path.read_bytes() == whole
    assert steps == list(range(kept, len(sweep_plan) + 1))


@pytest.mark.parametrize(
    "edit",
    [
        lambda line, other: line.replace(b'"refuted"', b'"proved"'),
        lambda line, other: line.replace(b'"point": 6', b'"point": 5'),
        lambda line, other: line.replace(b"sha256:", b"sha256:0"),
        lambda line, other: line.replace(b'"at": [1.0]', b'"at": [NaN]'),
        lambda line, other: other,
    ],
)
def test_a_point_that_was_edited_or_is_of_another_sweep(tmp_path: Path, edit: Any) -> None:
    paths = tmp_path / "s.jsonl", tmp_path / "other.jsonl"
    for path, name in zip(paths, ("plant", "another plant"), strict=True):
        run_sweep(plan(DWELL, name=name), str(path), jobs=1)
    lines, others = (path.read_bytes().splitlines(keepends=True) for path in paths)
    assert json.loads(lines[7])["verdict"] == "refuted"
    changed_line = edit(lines[7], others[7])
    assert changed_line != lines[7]
    paths[0].write_bytes(b"".join([*lines[:7], changed_line]))
    before = paths[0].read_bytes()
    for use in (lambda: run_sweep(plan(DWELL), str(paths[0])),
                lambda: plot_sweep(str(paths[0]), str(tmp_path / "s.png"))):  # fmt: skip
        with pytest.raises(InputError) as error:
            use()
        assert str(error.value) == (
            f"{paths[0]} line 8: digest does not match the point and the first line. Is it of "
            "another sweep, or was it edited? Remove the line to have it done again."
        )
    assert paths[0].read_bytes() == before
    assert not (tmp_path / "s.png").exists()


def test_a_complete_sweep_is_not_done_again(tmp_path: Path, monkeypatch: Any) -> None:
    sweep_plan, path = plan(DWELL), str(tmp_path / "s.jsonl")
    rows = run_sweep(sweep_plan, path)
    monkeypatch.setattr(workers, "evaluate", None)
    assert run_sweep(sweep_plan, path) == rows


def test_a_dead_process_loses_nothing(tmp_path: Path, monkeypatch: Any) -> None:
    sweep_plan = plan(DWELL, name=str(tmp_path / "flag"))
    expected = [evaluate(sweep_plan, index) for index in range(len(sweep_plan))]
    monkeypatch.setattr(workers, "evaluate", dies)
    assert run_sweep(sweep_plan, str(tmp_path / "s.jsonl"), jobs=2) == expected
    assert (tmp_path / "flag").exists()


def test_a_point_that_kills_its_process_is_told(tmp_path: Path, monkeypatch: Any) -> None:
    sweep_plan = plan("jump.dwell_time[1]=0.1:1:3", name="no/such/folder/flag")
    expected = [evaluate(sweep_plan, index) for index in range(len(sweep_plan))]
    expected[1] = SweepPoint(1, (0.55,), error=DIED)
    monkeypatch.setattr(workers, "evaluate", dies)
    assert run_sweep(sweep_plan, str(tmp_path / "s.jsonl"), jobs=2) == expected


def test_errors_are_kept_and_the_sweep_goes_on(tmp_path: Path, monkeypatch: Any) -> None:
    sweep_plan = plan("jump.dwell_time[0]=-0.05:0.15:3")
    rows = run_sweep(sweep_plan, str(tmp_path / "s.jsonl"))
    assert (
        rows[0].error == "jump.dwell_time: the shortest dwell time must be >= 0; got [-0.05, 0.1]."
    )
    assert rows[1].verdict == "proved"
    assert rows[2].error.endswith("got [0.15, 0.1]. Is it reversed?")
    broken = "obsdesign.studies.sweep.point.workflow.investigate"
    monkeypatch.setattr(broken, lambda problem, **_: [][1])  # a mistake of ours costs one point
    assert evaluate(sweep_plan, 1).error == "IndexError: list index out of range"


@pytest.mark.parametrize("what", ["verdict", "longest_dwell"])
def test_a_point_that_is_too_large_is_told_like_any_refusal(what: str) -> None:
    n = 66
    large = obsdesign.Problem(
        flow={"A": -np.eye(n) - 0.1 * np.eye(n, k=1)}, output={"C": np.eye(1, n)},
        jump={"G": 0.5 * np.eye(n), "dwell_time": [0.1, 1]},
        observer={"kind": "luenberger", "gains": {"L": np.zeros((n, 1)), "M": np.zeros((n, 1))}},
    )  # fmt: skip
    sweep_plan = plan_sweep(large, [parse_axis("jump.dwell_time[0]=0.1:0.2:2")], what, 1e-3)
    row = evaluate(sweep_plan, 1)
    assert row.at == (0.2,)
    assert re.match(r"a search for \d+ matrices of 66 states with .* GiB of memory", row.error)


def test_another_sweep_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.jsonl"
    run_sweep(plan(DWELL), str(path))
    before = path.read_bytes()
    others = {
        "--over: jump.dwell_time[1]=0.1:1:7 there, jump.dwell_time[1]=0.1:1:8 here": plan(DWELL.replace(":7", ":8")),
        "--for: verdict there, decay_rate here": plan(DWELL, what="decay_rate"),
        "problem": plan(DWELL, name="another"),
    }  # fmt: skip
    for word, other in others.items():
        with pytest.raises(InputError) as error:
            run_sweep(other, str(path))
        assert str(error.value) == (
            f"{path}: holds a sweep with another {word}. Name another file with -o, or remove this one."
        )
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (b"t,x1\n0,1\n", "line 1: one JSON object is required."),
        (b'{"format": "obsdesign/design"}\n', "a sweep file is required; its first line is not"),
        (b"a picture without lines", "a sweep file is required; its first line is not"),
        (b'HEAD\n{"point": 99, "at": [1]}\n', "line 2: a point of this sweep is required."),
        (
            b'{"format": "obsdesign/sweep", "version": 1, "over": 3}\n',
            "line 1: over must be a list of axes.",
        ),
        (
            b'{"format": "obsdesign/sweep", "version": 1, "over": [{"key": "a"}]}\n',
            "line 1: over must be a list of axes.",
        ),
        (
            b'{"format": "obsdesign/sweep", "version": 1, "over": []}\n',
            "line 1: over must be one or two axes",
        ),
        (b'HEAD\n{"point": 0, "a\n{}\n', "line 2: one JSON object is required."),
    ],
)
def test_files_that_are_no_sweep(tmp_path: Path, text: bytes, complaint: str) -> None:
    sweep_plan, path = plan(DWELL), tmp_path / "s.jsonl"
    path.write_bytes(
        text.replace(b"HEAD", json.dumps(SweepHeader.from_plan(sweep_plan).to_dict()).encode())
    )
    before = path.read_bytes()
    with pytest.raises(InputError) as error:
        run_sweep(sweep_plan, str(path))
    assert complaint in str(error.value)
    assert path.read_bytes() == before
    with pytest.raises(InputError):
        plot_sweep(str(path), str(tmp_path / "s.png"))
    assert not (tmp_path / "s.png").exists()


FORM = "--over must be key=first:last:count, such as jump.dwell_time[0]=0.5:2:16"
BAD_AXES = [
    ("flow.A[0][0]=0:1", f"{FORM}; got 'flow.A[0][0]=0:1'."),
    ("flow.A[0][0]", f"{FORM}; got 'flow.A[0][0]'."),
    ("flow..A=0:1:2", f"{FORM}; got 'flow..A=0:1:2'."),
    ("flow.A[0][0]=0:x:2", f"{FORM}; '0' and 'x' are not both numbers."),
    ("flow.A[0][0]=0:inf:2", f"{FORM}; both ends must be finite, got 0 and inf."),
    ("flow.A[0][0]=0:1:0", f"{FORM}; count must be an integer >= 1, got '0'."),
    ("flow.A[0][0]=0:1:2.5", f"{FORM}; count must be an integer >= 1, got '2.5'."),
]
BAD_ENTRIES = [
    ("flw.A[0][0]", "the problem has no 'flw'; it has name, flow, jump, output, observer. Did you mean 'flow'?"),
    ("flow.a[0][0]", "flow has no 'a'; it has A, disturbance. Did you mean 'A'?"),
    ("flow.A[2][0]", "flow.A has entries [0] to [1]; got [2]. The first one is [0]."),
    ("flow.A", "it is a 2x2 matrix, not one number. Choose one of flow.A[0][0], flow.A[0][1], flow.A[1][0], flow.A[1][1]."),
    ("flow.A[0][0][0]", "flow.A[0][0] has no entries [0], [1], ...; it is -1.0."),
    ("flow[0]", "flow has no entries [0], [1], ...; it is a table."),
    ("jump.dwell_time.low", "jump.dwell_time has no 'low'; it is a list of 2."),
    ("output.measured", "it is 'continuous', not a number. Numbers there: output.C[0][0], output.C[0][1], output.noise_std[0], output.noise_cv[0]."),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line"), BAD_AXES)
def test_axes_that_are_none(text: str, line: str) -> None:
    with pytest.raises(InputError) as error:
        parse_axis(text)
    assert str(error.value) == line


@pytest.mark.parametrize(("key", "line"), BAD_ENTRIES)
def test_entries_that_are_not_there(key: str, line: str) -> None:
    with pytest.raises(InputError) as error:
        plan(f"{key}=0:1:2")
    assert str(error.value) == f"--over {key}: {line}"


def test_what_cannot_be_asked() -> None:
    problem, axis = stability(), parse_axis(DWELL)
    for arguments, line in (
        (([axis], "peace", 1e-6), "--for must be one of shortest_dwell, longest_dwell, longest_period, shortest_window, largest_time_error, largest_uncertainty, verdict, width, decay_rate, error; got 'peace'."),
        (([axis], "width", 1e-6), "--for width is a number of kind 'interval'; this problem is of 'luenberger'."),
        (([axis], "longest_period", 1e-6), "--for longest_period is not available for kind 'luenberger' in this version."),
        (([axis], "longest_dwell", 0.0), "--accuracy must be a number from 1e-12 to 1; got 0.0."),
        (([axis] * 2, "verdict", 1e-6), "--over: jump.dwell_time[1] is given twice; a map needs two entries."),
        (([axis] * 3, "verdict", 1e-6), "--over must be given once or twice; got 3 of them."),
    ):  # fmt: skip
        with pytest.raises(InputError) as error:
            plan_sweep(problem, *arguments)
        assert str(error.value) == line


def test_axes_are_decimal_and_end_where_they_say() -> None:
    assert Axis("a", 0.0, 0.3, 4).values == (0.0, 0.1, 0.2, 0.3)
    assert Axis("a", 2.0, -1.0, 4).values == (2.0, 1.0, 0.0, -1.0)
    assert Axis("a", 5.0, 7.0, 1).values == (5.0,)
    assert parse_axis(" jump.dwell_time[0] = 1e-3:2:5").path == ("jump", "dwell_time", 0)


def test_every_entry_that_is_offered_can_be_swept() -> None:
    body = obsdesign.load_problem(ACADEMIC).to_dict()
    offered = entries(body)
    assert {"flow.A[1][0]", "jump.dwell_time[1]", "observer.gains.M[1][0]"} <= set(offered)
    for key in offered:
        axis = Axis(key, 1.25, 1.25, 1)
        require_number(body, axis)
        after = flat(changed(body, axis.path, 1.25))
        assert [b for a, b in zip(flat(body), after, strict=True) if a != b] == [1.25], key


def flat(body: Any) -> list[Any]:
    if isinstance(body, dict):
        return [leaf for value in body.values() for leaf in flat(value)]
    if isinstance(body, list):
        return [leaf for value in body for leaf in flat(value)]
    return [body]


def test_from_the_command_line(tmp_path: Path) -> None:
    arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.6:0.8:3", "--for", "width")
    done = command(*arguments, "-o", "s.jsonl", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "written: s.jsonl, 3 points: 2 proved, 1 refuted\n"
    again = command("--quiet", *arguments, "-o", "s.jsonl", "--jobs", 2, cwd=tmp_path)
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    drawn = command("plot", "s.jsonl", "-o", "s.png", cwd=tmp_path)
    assert (drawn.returncode, drawn.stdout) == (0, "written: s.png\n")
    refused = command("plot", "s.jsonl", "data.csv", cwd=tmp_path)
    assert (
        refused.stderr == "obsdesign: data.csv: belongs to an estimate file; s.jsonl is a sweep.\n"
    )


def on_a_terminal(*arguments: object, cwd: Path, **environment: str) -> str:
    """What a command says on a terminal of 80 columns."""
    import pty

    code = f"import sys; sys.argv[1:] = {list(map(str, arguments))!r}; from obsdesign.cli.main import main; main()"
    ours, theirs = pty.openpty()
    variables = {**os.environ, "COLUMNS": "80", "TERM": "xterm", **environment}
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=cwd, env=variables, stderr=theirs, stdout=theirs
    ) as run:
        os.close(theirs)
        text = b""
        with contextlib.suppress(OSError):  # the other end closed
            while piece := os.read(ours, 4096):
                text += piece
    os.close(ours)
    assert run.returncode == 0, text
    return text.decode()


def test_progress_is_for_terminals_that_want_it(tmp_path: Path) -> None:
    arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.8:0.9:2", "--jobs", 1)
    assert "2/2" in on_a_terminal(*arguments, "-o", "a.jsonl", cwd=tmp_path)
    assert on_a_terminal("--quiet", *arguments, "-o", "b.jsonl", cwd=tmp_path) == ""
    output = on_a_terminal(*arguments, "-o", "c.jsonl", cwd=tmp_path, NO_COLOR="1")
    assert output == "written: c.jsonl, 2 points: 2 proved\r\n"


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_goes_on(tmp_path: Path, how: int) -> None:
    arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.6:1.4:9", "--jobs", 1)
    path = tmp_path / "sweep.jsonl"
    # a run in the background of a shell ignores SIGINT, and so would its children
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        f"sys.argv[1:] = {list(map(str, arguments))!r}; from obsdesign.cli.main import main; main()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stderr=subprocess.PIPE
    ) as run:
        while not path.exists() or path.read_bytes().count(b"\n") < 4:
            assert run.poll() is None
        run.send_signal(how)
        err = run.stderr.read() if run.stderr else b""
    assert (run.returncode, err) == ((130, b"") if how == signal.SIGINT else (-how, b""))
    there = path.read_bytes().count(b"\n")
    assert 4 <= there < 10
    assert (
        command(*arguments, cwd=tmp_path).stdout
        == "written: sweep.jsonl, 9 points: 8 proved, 1 refuted\n"
    )
    whole = plan_sweep(
        obsdesign.load_problem(ACADEMIC), [parse_axis(arguments[3])], "verdict", 1e-6
    )
    run_sweep(whole, str(tmp_path / "whole.jsonl"), jobs=1)
    assert path.read_bytes() == (tmp_path / "whole.jsonl").read_bytes()


def test_exit_codes(tmp_path: Path) -> None:
    wrong = command("sweep", ACADEMIC, "--over", "jump.dwell[0]=1:2:2", cwd=tmp_path)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert (
        wrong.stderr
        == f"obsdesign: {ACADEMIC}: --over jump.dwell[0]: jump has no 'dwell'; it has G, dwell_time, dwell_jitter, disturbance. Did you mean 'dwell_time'?\n"
    )
    assert not list(tmp_path.iterdir())
    none = command("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=-1:-2:2", cwd=tmp_path)
    assert none.returncode == 3
    assert (
        none.stderr
        == "obsdesign: 2 without an answer; at jump.dwell_time[0] = -1: jump.dwell_time: the shortest dwell time must be >= 0; got [-1, inf].\n"
    )


GREEN, VERMILION, GREY = (0, 158, 115), (213, 94, 0), (187, 187, 187)


def has_colour(path: Path, colour: tuple[int, int, int]) -> bool:
    wanted = 1 - 0.75 * (1 - np.array(colour) / 255)
    return bool((np.abs(imread(path)[..., :3] - wanted).max(axis=2) < 0.02).mean() > 0.01)


@pytest.mark.parametrize(
    ("over", "what", "there", "absent"),
    [
        ((DWELL,), "verdict", (GREEN, VERMILION), (GREY,)),
        ((DWELL, "flow.A[1][1]=0.6:1.2:2"), "decay_rate", (VERMILION,), (GREEN, GREY)),
        (("flow.A[1][1]=-1:1:5",), "longest_dwell", (GREEN,), (VERMILION, GREY)),
        (("jump.G[0][0]=0.5:0.5:2", "jump.dwell_time[1]=0.1:0.1:1"), "verdict", (GREEN,), (GREY,)),
    ],
)
def test_points_without_a_number_have_their_colour(
    tmp_path: Path, over: tuple[str, ...], what: str, there: Any, absent: Any
) -> None:
    path = str(tmp_path / "s.jsonl")
    run_sweep(plan(*over, what=what), path)
    plot_sweep(path, str(tmp_path / "s.png"))
    assert all(has_colour(tmp_path / "s.png", colour) for colour in there)
    assert not any(has_colour(tmp_path / "s.png", colour) for colour in absent)
    lines = Path(path).read_bytes().splitlines(keepends=True)
    Path(path).write_bytes(b"".join(lines[:-1]))  # interrupted: what there is can be seen
    assert len(read_sweep(path).points) == len(lines) - 2
    plot_sweep(path, str(tmp_path / "part.svg"))


def test_a_sweep_that_is_ended_takes_its_processes_along(tmp_path: Path) -> None:
    """Workers that went on would hold the pipe open: its reader sees the end at once."""
    code = "from obsdesign.cli.main import main; main()"
    arguments = ("sweep", ACADEMIC, "--over", "jump.dwell_time[0]=0.5:1.5:2000", "--jobs", "2")
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as run:  # fmt: skip
        rows = tmp_path / "sweep.jsonl"
        while not (rows.exists() and rows.read_text().count("\n") > 2):
            assert run.poll() is None
            time.sleep(0.05)
        run.send_signal(signal.SIGTERM)
        complaints = run.communicate(timeout=60)[1]
    assert (run.returncode, complaints) == (143, "")
