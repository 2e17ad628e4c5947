"""Dwell times from a file, and the replay of a witness."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from obsdesign.cli.commands import cli
from obsdesign.data.dwell_file import read_dwell_times
from obsdesign.errors import InputError

# alternating dwell times destabilise it, no constant one does (Briat's sampled-data benchmark)
ALTERNATING = {
    "flow": {"A": [[0, 1, 0], [-2, 0.1, 1], [0, 0, 0]]},
    "jump": {"G": [[1, 0, 0], [0, 1, 0], [1, 0, 0]], "dwell_time": [0.4, 1.889]},
    "output": {"C": [[1, 0, 0]]},
    "observer": {"kind": "luenberger", "gains": {"L": [[0]] * 3, "M": [[0]] * 3}},
}


def written(folder: Path, text: str) -> str:
    path = folder / "dwell.txt"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.5\n1.25\n\n0.5\n", [0.5, 1.25, 0.5]),
        ("dwell\n0.5\n1e-1\n", [0.5, 0.1]),
        ("[1, 2.5]", [1.0, 2.5]),
        (json.dumps({"claims": [{"evidence": {"witness": {"thetas": [0.4, 1.9]}}}]}), [0.4, 1.9]),
        (json.dumps({"claims": [{"evidence": {"witness": {"theta": 0.4}}}]}), [0.4]),
        (
            json.dumps([{"evidence": {"witness": {"mode": 2}}}]).replace("[{", '{"claims": [{')
            + ', "x": {"witness": {"thetas": [3]}}}',
            [3.0],
        ),
    ],
)
def test_what_may_stand_in_the_file(tmp_path: Path, text: str, expected: list[float]) -> None:
    assert read_dwell_times(written(tmp_path, text)) == expected


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "at least one dwell time is required; the file holds none."),
        ("dwell\n", "at least one dwell time is required; the file holds none."),
        ("0.5\n-1\n", " line 2: a dwell time must be a positive finite number; got '-1'."),
        ("nan\n", " line 1: a dwell time must be a positive finite number; got 'nan'."),
        ("0.5\nlong\n", " line 2: a dwell time must be a positive finite number; got 'long'."),
        ("{", "not valid JSON ("),
        ('{"claims": []}', "a list of positive dwell times, or an answer with a witness"),
        ("[1, true, null]", "a list of positive dwell times, or an answer with a witness"),
    ],
)
def test_what_may_not(tmp_path: Path, text: str, line: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_dwell_times(path)
    assert str(caught.value).startswith(path)
    assert line in str(caught.value)


def test_the_witness_of_a_search(tmp_path: Path) -> None:
    problem, answer = tmp_path / "problem.json", tmp_path / "answer.json"
    problem.write_text(json.dumps(ALTERNATING))
    options = ["--for", "longest_dwell", "--accuracy", "1e-3", "--json"]
    answer.write_text(CliRunner().invoke(cli, ["search", str(problem), *options]).stdout)
    thetas = read_dwell_times(str(answer))
    assert max(thetas) == json.loads(answer.read_text())["result"]["not_proved"]


def test_a_witness_replayed_makes_the_state_grow(tmp_path: Path) -> None:
    problem, answer = tmp_path / "problem.json", tmp_path / "answer.json"
    problem.write_text(json.dumps(ALTERNATING))
    done = CliRunner().invoke(cli, ["design", str(problem), "-o", str(tmp_path / "d"), "--json"])
    answer.write_text(done.stdout)
    thetas = read_dwell_times(str(answer))
    assert len(thetas) == 2
    data = tmp_path / "data.csv"
    replay = ["simulate", str(problem), "--dwell", str(answer), "--disturbance", "zero"]
    done = CliRunner().invoke(cli, [*replay, "--until", "1500", "--step", "50", "-o", str(data)])
    assert done.exit_code == 0, done.output
    rows = np.genfromtxt(data, delimiter=",", names=True)
    jumps = rows["t"][rows["jump"] == 1]
    np.testing.assert_allclose(np.diff(np.append(0, jumps)), np.resize(thetas, len(jumps)))
    # just above the limit it grows by 5e-5 per pair, and does not die out as it does below
    size = np.abs(rows["x1"])
    assert size[-100:].max() > 0.5 * size[:100].max()
    constant = ["--dwell", "1.0", "--until", "1500", "--step", "50", "-o", str(data)]
    CliRunner().invoke(cli, ["simulate", str(problem), "--disturbance", "zero", *constant])
    rows = np.genfromtxt(data, delimiter=",", names=True)
    assert np.abs(rows["x1"])[-100:].max() < 1e-6 * np.abs(rows["x1"])[:100].max()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"witness": {"theta": 1.0}, "witness": {"theta": 2.0}}', "key 'witness' stands 2 times"),
        ("[1.0, NaN]", "NaN is not allowed"),
    ],
)
def test_json_has_one_meaning(tmp_path: Path, text: str, reason: str) -> None:
    """As in problem and design files; the twin has each key once, and numbers."""
    with pytest.raises(InputError, match=reason):
        read_dwell_times(written(tmp_path, text))
    assert read_dwell_times(written(tmp_path, '{"witness": {"theta": 1.0}}')) == [1.0]
