"""Names and units of signals: what they may be, where they are used, and that no claim changes."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import obsdesign
from obsdesign.column_names import combination
from obsdesign.data.execution import execute
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem

BODY: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "B": [[1], [0]],
             "disturbance": {"lower": [-0.1, -0.1], "upper": [0.1, 0.1]}},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "observer": {"kind": "interval"},
    "names": {"states": ["position", "speed"], "outputs": ["encoder"], "inputs": ["voltage"],
              "units": {"position": "m", "x2": "m/s", "encoder": "m/s"}, "time_unit": "s"},
}  # fmt: skip


def body(**names: Any) -> dict[str, Any]:
    changed = copy.deepcopy(BODY)
    changed["names"] |= names
    return changed


def test_names_and_units_of_signals_by_their_columns() -> None:
    names = Problem.from_dict(BODY).names
    assert names.columns == {"position": "x1", "speed": "x2", "encoder": "y1", "voltage": "u1"}
    assert names.label("x1") == "position [m]"
    assert (names.unit("x2"), names.unit("u1"), names.name_of("d1")) == ("m/s", None, "d1")


def test_names_survive_a_round_trip_and_are_absent_where_none_are_given() -> None:
    problem = Problem.from_dict(BODY)
    assert problem.to_dict()["names"] == BODY["names"]
    assert Problem.from_dict(problem.to_dict()) == problem
    bare = {key: entry for key, entry in BODY.items() if key != "names"}
    assert "names" not in Problem.from_dict(bare).to_dict()
    assert Problem.from_dict(bare) != problem


def test_no_claim_depends_on_names() -> None:
    bare = {key: entry for key, entry in BODY.items() if key != "names"}
    named, plain = (obsdesign.investigate(Problem.from_dict(each)) for each in (BODY, bare))
    assert named.claims == plain.claims
    assert named.guarantees == plain.guarantees


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"states": ["position"]}, "names.states must be 2 names, one per state; got 1."),
        ({"outputs": ["a", "b"]}, "names.outputs must be 1 names, one per row of output.C; got 2."),
        ({"inputs": ["encoder"]}, "names: 'encoder' stands 2 times; states, outputs and inputs need"
         " different names, since they may be titles of columns of one file."),
        ({"states": ["position", "y1"]}, "names.states: 'y1' is kept for another column."),
        ({"states": ["position", "b1_lo"]}, "names.states: 'b1_lo' is kept for another column."),
        ({"states": ["position", ""]}, "names.states: a name may not be empty."),
        ({"states": ["position", "a,b"]}, "names.states must be at most 40 printable characters "
         "without commas, quotes and blanks at its ends; got 'a,b'."),
        ({"units": {"spead": "m"}}, "names.units.spead: no signal is called so; signals are "
         "position, speed, encoder, voltage, x1, x2, y1, u1."),
        ({"time_unit": 5}, "names.time_unit must be a unit; got 5."),
        ({"states": [1, 2]}, "names.states, entry 1 must be a name; got 1."),
    ],
)  # fmt: skip
def test_other_names_are_refused_in_a_line(names: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        Problem.from_dict(body(**names))
    assert str(refused.value) == message


def test_v_and_i_of_a_circuit_are_names() -> None:
    assert Problem.from_dict(body(states=["v1", "i1"], units={})).names.states == ("v1", "i1")


def test_sensors_have_names_of_their_own() -> None:
    changed = body()
    changed["sensor"] = [changed.pop("output") | {"name": "gps", "every": [0.1, 0.2]}]
    with pytest.raises(InputError, match=r"outputs of \[\[sensor\]\] are called as their sensor"):
        Problem.from_dict(changed)
    del changed["names"]["outputs"]
    changed["names"]["units"] = {"gps": "m"}
    assert Problem.from_dict(changed).names.unit("gps") == "m"


def _record(path: Path, *titles: str, last: str = "more") -> str:
    rows = ("0,0.1,1,9", "0.1,0.2,1,9", "0.2,0.15,0,9")
    path.write_text("\n".join([",".join([*titles, last]), *rows]) + "\n")
    return str(path)


def test_columns_of_data_may_have_the_names_or_be_renamed(tmp_path: Path) -> None:
    design = str(tmp_path / "d.json")
    obsdesign.design(Problem.from_dict(BODY)).save(design)
    initial, texts = [0.0, 1.0, 0.0, 1.0], []
    for k, (titles, renamed) in enumerate([
        (("t", "y1", "u1"), {}),
        (("t", "encoder", "voltage"), {}),
        (("t", "raw", "u1"), {"raw": "y1"}),
        (("t", "raw", "voltage"), {"raw": "encoder"}),
    ]):  # fmt: skip
        out = tmp_path / f"{k}.csv"
        record = _record(tmp_path / f"data{k}.csv", *titles)
        execute(design, record, str(out), initial, None, titles=renamed)
        texts.append(out.read_text())
    assert len(set(texts)) == 1
    other = _record(tmp_path / "other.csv", "t", "y", "u1")
    with pytest.raises(
        InputError, match=r"column 'y1' or 'encoder' is required; the header has t, y, u1, more\."
    ):
        execute(design, other, None, initial, None)
    twice = _record(tmp_path / "twice.csv", "t", "y1", "u1", last="voltage")
    with pytest.raises(InputError, match="column 'u1' stands 2 times in the header"):
        execute(design, twice, str(tmp_path / "no.csv"), initial, None)


def test_a_combination_reads_as_in_a_paper() -> None:
    assert combination([1.0, -2.0, 1e-9], ["a", "b", "c"]) == "a - 2 b"
    assert combination([0.0, -3.0, 3.0], ["a", "b", "c"]) == "b - c"
    assert combination(np.array([0.0, -3.0]).tolist(), ["a", "b"]) == "b"


def test_an_undetectable_direction_is_called_by_the_names() -> None:
    blind = body()
    blind["flow"]["A"] = [[0, 0], [0, -1]]
    outcome = obsdesign.investigate(Problem.from_dict(blind))
    (claim,) = [claim for claim in outcome.claims if claim.id == "attainable"]
    assert "no output shows the direction position," in claim.evidence["witness"]["reason"]
