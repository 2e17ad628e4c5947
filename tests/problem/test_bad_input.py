"""Problem files that cannot be read: the exact line, exit code 2, nothing written."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

import obsdesign
from obsdesign.errors import InputError
from tests.systems.command_line import command

GOOD: dict[str, Any] = {
    "name": "good",
    "flow": {"A": [[-1, 0], [1, -2]], "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
    "jump": {"G": [[2, 1], [1, 3]], "dwell_time": [0.7, "inf"]},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval", "gains": {"L": [[0], [1]], "M": [[1], [2.8]]}},
}

REMOVE = object()


def changed(path: str, value: Any) -> dict[str, Any]:
    """The good file with one entry replaced or removed."""
    body = copy.deepcopy(GOOD)
    *blocks, key = path.split(".")
    place = body
    for block in blocks:
        place = place.setdefault(block, {})
    if value is REMOVE:
        del place[key]
    else:
        place[key] = value
    return body


FAULTS: list[tuple[str, Any, str]] = [
    # structure
    ("flwo", {"A": [[1]]}, "unknown key 'flwo': did you mean 'flow'?"),
    ("flow.AA", [[1]], "unknown key 'AA' in [flow]: did you mean 'A'?"),
    ("jump.dwel_time", [1, 2], "unknown key 'dwel_time' in [jump]: did you mean 'dwell_time'?"),
    ("output.noise", [1], "unknown key 'noise' in [output]: did you mean 'noise_bound' or 'noise_std' or 'noise_cv'?"),
    ("flow.disturbance.low", [0, 0], "unknown key 'low' in [flow.disturbance]: did you mean 'lower'?"),
    ("flow.disturbance.min", [0, 0], "unknown key 'min' in [flow.disturbance]: did you mean 'lower'?"),
    ("observer.from", "split", "unknown key 'from' in [observer]: did you mean 'form'?"),
    ("observer.gains.N", [[1]], "unknown key 'N' in [observer.gains]: did you mean 'Gn'?"),
    ("observer.alpha", 2, "observer.alpha is an option of kind 'impulsive', not of 'interval'; drop it, or choose that kind with --kind."),
    ("observer.gains.K", [[1]], "observer.gains.K is a gain of kind 'impulsive_input', not of 'interval'."),
    ("observer.kind", "intervall", "observer.kind must be one of interval, set_membership, luenberger, impulsive, finite_time, impulsive_input, unknown_input; got 'intervall'. Did you mean 'interval'?"),
    ("observer.form", "nice", "observer.form must be one of cooperative, split, coordinates, two_coordinates, auto; got 'nice'."),
    ("flow", REMOVE, "flow is required; it is missing."),
    ("flow.A", REMOVE, "flow.A is required; it is missing."),
    ("output.C", REMOVE, "output.C is required; it is missing."),
    ("flow.disturbance.upper", REMOVE, "flow.disturbance.upper is required; it is missing."),
    ("flow", 3, "flow must be a table [flow]; got 3."),
    ("flow.A", 3, "flow.A must be a matrix: a list of rows of numbers; got 3."),
    ("flow.A", [1, 2], "flow.A, row 1 must be a row: a list of numbers; got 1. One row is written [[1, 2]], one column [[1], [2]]."),
    ("flow.A", [["1", 0], [1, 2]], "flow.A, row 1, column 1 must be a number; got '1'. Numbers are written without quotes."),
    ("flow.A", [[True, 0], [1, 2]], "flow.A, row 1, column 1 must be a number; got True."),
    ("flow.A", [[1, 0], [1]], "flow.A must be a matrix: a list of rows of numbers, all equally long; got [[1, 0], [1]]."),
    ("flow.A", [[10**400, 0], [1, 1]], "flow.A must hold binary64 numbers; one is too large."),
    ("jump.dwell_time", 3, "jump.dwell_time must be a pair [shortest, longest] of numbers; the longest may be inf; got 3."),
    ("jump.dwell_time", [1, 2, 3], "jump.dwell_time must be a pair [shortest, longest] of numbers; the longest may be inf; got [1, 2, 3]."),
    ("jump.dwell_time", ["inf", "inf"], "jump.dwell_time must be a pair [shortest, longest] of numbers; the longest may be inf; got ['inf', 'inf']."),
    # meaning
    ("flow.A", [[1, 0, 0], [1, 2, 0]], "flow.A must be square; got 2x3."),
    ("flow.B", [[1]], "flow.B must have 2 rows, one per state of flow.A (2x2); got 1x1."),
    ("jump.G", [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "jump.G must have 2 rows, one per state of flow.A (2x2); got 3x3."),
    ("output.C", [[0, 1, 0]], "output.C must have 2 columns, one per state of flow.A (2x2); got 1x3."),
    ("output.noise_bound", [0.1, 0.1], "output.noise_bound must have 1 entry, one per row of output.C (1x2); got 2."),
    ("output.noise_bound", [-0.1], "output.noise_bound must be >= 0; got -0.1 for output 1."),
    ("output.noise_std", [-1], "output.noise_std must be >= 0; got -1 for output 1."),
    ("flow.disturbance.lower", [0.2, 0], "flow.disturbance: lower must not exceed upper; got lower 0.2 > upper 0.1 for state 1. Are they swapped?"),
    ("flow.disturbance.lower", [0], "flow.disturbance.lower must have 2 entries, one per state; got 1."),
    ("jump.dwell_time", [2, 1], "jump.dwell_time must be [shortest, longest]; got [2, 1]. Is it reversed?"),
    ("jump.dwell_time", [-1, 1], "jump.dwell_time: the shortest dwell time must be >= 0; got [-1, 1]."),
    ("jump.dwell_time", [0, 0], "jump.dwell_time: the longest dwell time must be > 0; got [0, 0]."),
    ("jump.dwell_jitter", -1, "jump.dwell_jitter must be a number >= 0 or inf; got -1.0."),
    ("output.measured", "periodic", "output.period is required by output.measured = 'periodic'; it is missing."),
    ("output.period", 0, "output.period must be a positive number; got 0."),
    ("observer.gains.L", [[0, 1]], "observer.gains.L must be 2x1 (n x p, n states, p outputs); got 1x2. Is it transposed?"),
    ("observer.kind", REMOVE, "observer.kind is required; it is missing. It is one of interval, set_membership, luenberger, impulsive, finite_time, impulsive_input, unknown_input; `obsdesign check` lists which of them fit this plant."),
    ("jump.dwell_time", REMOVE, "jump.dwell_time = [shortest, longest] is required by kind 'interval'; it is missing."),
    ("flow.D", [[1], [0]], "flow.D is refused by kind 'interval': an unknown input without bounds leaves no bounds on the state. Give bounds as flow.d_bounds."),
    ("jump.H", [[1], [0]], "jump.H is refused by kind 'interval': impulses of unknown weight leave no bounds on the state. Give bounds as jump.disturbance."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("path", "value", "line"), FAULTS, ids=[f"{i}-{p}" for i, (p, _, _) in enumerate(FAULTS)]
)
def test_each_fault_has_its_line(path: str, value: Any, line: str) -> None:
    with pytest.raises(InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(changed(path, value)))
    assert str(error.value) == line


def test_measured_that_the_kind_cannot_use() -> None:
    body = changed("output.measured", "periodic")
    body["output"]["period"] = 0.1
    body["observer"] = {"kind": "luenberger", "gains": body["observer"]["gains"]}
    with pytest.raises(InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert str(error.value) == (
        "output.measured must be continuous or at_jumps for kind 'luenberger'; got 'periodic'."
    )
    body["observer"] = {"kind": "interval", "objective": "shortest_dwell"}
    with pytest.raises(InputError) as error:
        obsdesign.investigate(obsdesign.Problem.from_dict(body))
    assert str(error.value) == (
        "observer.objective = 'shortest_dwell' is not available with measured = 'periodic'; "
        "it must be feasible or narrowest."
    )


TEXTS = {
    "p.toml": [
        ("flow = [", "p.toml: not valid TOML: "),
        ("flow.A = [[nan, 0], [0, 1]]\noutput.C = [[1, 0]]\n",
         "p.toml: flow.A must hold finite numbers; got nan at row 1, column 1."),
        ("flow.A = [[-1, inf], [0, 1]]\noutput.C = [[1, 0]]\n",
         "p.toml: flow.A must hold finite numbers; got inf at row 1, column 2."),
        ("flow.A = [[-1]]\noutput.C = [[1]]\njump.dwell_time = [inf, inf]\n",
         "p.toml: jump.dwell_time: the shortest dwell time must be finite; got [inf, inf]."),
        ("", "p.toml: a problem is required; the file is empty."),
        ("flow.A = [[1]]\nflow.A = [[2]]\n", "p.toml: not valid TOML: Cannot overwrite a value"),
    ],
    "p.json": [
        ("{", "p.json: not valid JSON: "),
        ("[1]", "p.json: a problem must be a table with [flow] and [output]; got [1]."),
        ('{"flow": {}, "flow": {}}', "p.json: not valid JSON: key 'flow' stands 2 times."),
        ('{"flow": {"A": [[Infinity]]}}',
         'p.json: not valid JSON: Infinity is not allowed; infinity is written "inf".'),
        ('{"flow": {"A": [[1e999]]}, "output": {"C": [[1]]}}',
         "p.json: flow.A must hold finite numbers; got inf at row 1, column 1."),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [(name, text, line) for name, cases in TEXTS.items() for text, line in cases],
)
def test_files_that_are_no_problem(tmp_path: Path, name: str, text: str, line: str) -> None:
    (tmp_path / name).write_text(text)
    done = command("design", name, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"obsdesign: {line}"), done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_files_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.toml").mkdir()
    lines = {
        "p.toml": "obsdesign: p.toml: UTF-8 text is required; it is not. Is it a binary file?\n",
        "folder.toml": "obsdesign: folder.toml: cannot be read: Is a directory.\n",
        "absent.toml": "obsdesign: absent.toml: cannot be read: No such file or directory.\n",
    }
    for name, line in lines.items():
        done = command("design", name, cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (2, "", line)


def test_kind_on_the_command_line(tmp_path: Path) -> None:
    body = changed("observer", {"kind": "impulsive", "alpha": 2.0, "window": 3})
    (tmp_path / "p.json").write_text(json.dumps(body))
    done = command("design", "p.json", "--kind", "interval", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == "obsdesign: dropped for kind interval: alpha, window\n"
    done = command("design", "p.json", "--kind", "intervals", cwd=tmp_path)
    assert done.stderr.startswith("obsdesign: kind must be one of interval, ")
