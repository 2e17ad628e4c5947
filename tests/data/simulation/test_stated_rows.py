"""Simulations of rows that a file states: what is given stays, what is not is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmi.arithmetic.exponential import expm
from obsdesign.data.csv_text import table_text
from obsdesign.data.simulation import simulate
from obsdesign.data.simulation.stated_rows import StatedRows
from obsdesign.errors import InputError
from obsdesign.problem.problem import Problem, load_problem

EXAMPLES = Path(__file__).parents[3] / "examples"
PLAIN: dict[str, Any] = {
    "flow": {"A": [[-1, 0], [1, -2]], "B": [[1], [0]]},
    "jump": {"G": [[0.5, 0], [0, 1]], "E": [[0], [1]], "dwell_time": [0.5, 5]},
    "output": {"C": [[0, 1]], "noise_bound": [0.03]},
    "names": {"outputs": ["level"], "inputs": ["pump"]},
}


def stated(folder: Path, text: str, body: Any = PLAIN, **titles: str) -> StatedRows:
    path = folder / "rows.csv"
    path.write_text(text)
    return StatedRows.from_file(str(path), Problem.from_dict(body), titles)


def test_inputs_jumps_and_missing_samples_are_those_of_the_file(tmp_path: Path) -> None:
    text = "t,pump,level,jump,w1\n5,2,1,0,\n6,,,0,\n6.5,-1,1,1,3\n8,0,1,0,\n"
    record = simulate(
        Problem.from_dict(PLAIN).plant, rows=stated(tmp_path, text), initial=[1.0, 0.5],
        disturbance="zero",
    )  # fmt: skip
    assert record.t.tolist() == [5, 6, 6.5, 8]
    assert record.block("u")[:, 0].tolist() == [2, 2, -1, 0]
    assert np.isnan(record.block("y")[:, 0]).tolist() == [False, True, False, False]
    A, B, x = np.array([[-1.0, 0], [1, -2]]), np.array([1.0, 0]), np.array([1.0, 0.5])
    expected = [x]
    for h, u, jump in ((1, 2, None), (0.5, 2, 3), (1.5, -1, None)):
        grown = expm(np.block([[A, (B * u)[:, None]], [np.zeros((1, 3))]]) * h)
        x = grown[:2, :2] @ x + grown[:2, 2]
        x = x if jump is None else np.array([0.5 * x[0], x[1] + jump])
        expected.append(x)
    assert record.block("x") == pytest.approx(np.array(expected), rel=1e-12)


@pytest.mark.parametrize("name", ["degue_4_1", "doses_and_samples", "valve", "two_rates"])
def test_a_record_is_repeated_from_its_own_file(name: str, tmp_path: Path) -> None:
    problem = load_problem(EXAMPLES / f"{name}.toml")
    first = simulate(problem.plant, rng=np.random.default_rng(3), disturbance="zero")
    path = tmp_path / "first.csv"
    path.write_text(table_text(first.columns))
    rows = StatedRows.from_file(str(path), problem)
    again = simulate(problem.plant, rows=rows, rng=np.random.default_rng(4), disturbance="zero")
    assert set(again.columns) == set(first.columns)
    assert again.block("x") == pytest.approx(first.block("x"), rel=1e-9, abs=1e-12)
    assert (np.isnan(again.block("y")) == np.isnan(first.block("y"))).all()


def test_what_is_not_given_is_drawn_within_its_bounds(tmp_path: Path) -> None:
    rows = stated(tmp_path, "t,jump\n0,0\n1,0\n2,1\n3,0\n")
    assert rows.u is rows.w is rows.d is None
    record = simulate(Problem.from_dict(PLAIN).plant, rows=rows)
    noise = record.block("y")[:, 0] - record.block("x")[:, 1]
    assert np.abs(noise[[0, 1, 3]]).max() <= 0.03  # what jumps is measured before it
    assert np.ptp(record.block("u")) > 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,pump\n0,1\n1,1\n", "column 'jump' is required; the header has t, u1."),
        ("t,jump\n0,0\n0,0\n", "t must be finite and increase from row to row."),
        ("t,jump\n", "at least one row is required; there is only a header."),
        ("t,jump,u1\n0,0,\n1,0,2\n", "inputs u are required in the first row."),
        ("t,jump,u1\n0,0,x\n", "column 'u1' must hold numbers; "),
        ("jump\n0\n", "column 't' is required; the header has jump."),
    ],
)
def test_files_without_what_is_needed_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        stated(tmp_path, text)
    assert message in str(refused.value)


@pytest.mark.parametrize("D", [None, [[1], [0]]])
def test_a_simulation_may_end_before_its_first_row(D: Any) -> None:
    """Measured at jumps alone, none of which comes in time."""
    body = {"flow": {"A": [[-1, 0], [1, -2]]} | ({} if D is None else {"D": D}),
            "jump": {"dwell_time": [5, 6]},
            "output": {"C": [[0, 1]], "measured": "at_jumps"}}  # fmt: skip
    record = simulate(Problem.from_dict(body).plant, until=2.0)
    assert len(record.t) == 0
    assert record.block("d").shape == (0, 0 if D is None else 1)
