"""Functions of the command line from Python: the same numbers, as objects that show themselves."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

import obsdesign
from obsdesign.cli.commands import cli
from obsdesign.errors import InputError
from obsdesign.notebook import Comparison, Estimates

EXAMPLES = Path(__file__).parents[1] / "examples"
INITIAL = [0.0, 2.0, 0.0, 2.0]


@pytest.fixture(scope="module")
def problem() -> obsdesign.Problem:
    body = obsdesign.load_problem(EXAMPLES / "degue_4_1.toml").to_dict()
    names = {"states": ["hidden", "shown"], "outputs": ["gauge"], "units": {"hidden": "m"}}
    return obsdesign.Problem.from_dict(body | {"names": names})


@pytest.fixture(scope="module")
def design(problem: obsdesign.Problem) -> obsdesign.Design:
    return obsdesign.design(problem)


@pytest.fixture(scope="module")
def estimates(design: obsdesign.Design) -> Estimates:
    record = obsdesign.simulate(design, seed=3, until=6, step=0.05)
    return obsdesign.run(design, record, initial=INITIAL)


def test_every_function_of_the_commands_is_public_and_has_a_docstring() -> None:
    names = ("check", "compare", "design", "load_design", "load_problem", "plot", "report", "run",
             "search", "simulate", "sweep", "verify")  # fmt: skip
    assert set(names) < set(obsdesign.__all__)
    for name in names:
        function = getattr(obsdesign, name)
        assert inspect.getdoc(function)
        assert inspect.signature(function).return_annotation != inspect.Signature.empty


def test_a_run_is_that_of_the_command_line(
    design: obsdesign.Design, estimates: Estimates, tmp_path: Path
) -> None:
    design.save(tmp_path / "d.json")
    files = {name: str(tmp_path / name) for name in ("d.json", "data.csv", "e.csv")}
    for words in (
        ["simulate", files["d.json"], "--seed", "3", "--until", "6", "--step", "0.05", "-o",
         files["data.csv"]],
        ["run", files["d.json"], files["data.csv"], "--initial", "0,2,0,2", "-o", files["e.csv"]],
    ):  # fmt: skip
        assert CliRunner().invoke(cli, words, standalone_mode=False).return_value == 0
    again = obsdesign.run(files["d.json"], files["data.csv"], initial=INITIAL)
    assert np.array_equal(again.lower, estimates.lower)
    assert np.array_equal(again.upper, estimates.upper)
    header = Path(files["e.csv"]).read_text().splitlines()[0]
    assert ",".join([*estimates.columns, "status"]) == header


def test_estimates_are_named_arrays(estimates: Estimates) -> None:
    n = len(estimates.t)
    assert estimates.lower is not None
    assert estimates.upper is not None
    assert estimates.lower.shape == estimates.upper.shape == (n, 2)
    assert (estimates.lower <= estimates.upper).all()
    assert estimates.x is estimates.d is None
    assert estimates.status == ["ok"] * n
    assert repr(estimates) == f"Estimates(interval, {n} rows: {n} ok)"


def test_columns_may_be_a_mapping_with_the_names(design: obsdesign.Design) -> None:
    columns: dict[str, Any] = {"t": [0, 0.1], "gauge": [1.0, 0.9], "jump": [0, 0]}
    assert obsdesign.run(design, columns, initial=INITIAL).status == ["ok", "ok"]
    raw = {"t": [0, 0.1], "raw": [1.0, 0.9], "jump": [0, 0]}
    renamed = obsdesign.run(design, raw, initial=INITIAL, rename={"raw": "gauge"})
    assert renamed.status == ["ok", "ok"]
    with pytest.raises(InputError, match="column 'y1' or 'gauge' is required"):
        obsdesign.run(design, raw, initial=INITIAL)


def test_pictures_are_figures_with_names_and_units(estimates: Estimates) -> None:
    figure = obsdesign.plot(estimates)
    assert isinstance(figure, Figure)
    assert {axis.get_ylabel() for axis in figure.axes} >= {"hidden [m]", "shown"}
    own = Figure()
    axis = own.subplots()
    assert obsdesign.plot(estimates, state="hidden", ax=axis) is own
    assert axis.get_ylabel() == "hidden [m]"
    with pytest.raises(InputError, match="'height' is no signal of the estimate"):
        obsdesign.plot(estimates, state="height", ax=axis)
    with pytest.raises(InputError, match="state and ax are given together"):
        obsdesign.plot(estimates, state="hidden")


def test_answers_show_themselves(
    problem: obsdesign.Problem, design: obsdesign.Design, estimates: Estimates
) -> None:
    outcome = obsdesign.verify(design)
    assert repr(design).endswith("interval, 8 of 8 claims proved)")
    assert repr(outcome) == "Outcome(interval: proved, 9 of 9 claims proved)"
    for answer in (problem, design, outcome):
        assert "<table>" in answer._repr_html_()
        assert len(repr(answer)) < 120
    assert estimates._repr_html_().lstrip().startswith("<?xml")
    evil = obsdesign.Problem.from_dict(problem.to_dict() | {"name": "<script>"})
    assert "<script>" not in evil._repr_html_()


def test_check_search_compare_and_sweep_answer_as_the_commands(problem: obsdesign.Problem) -> None:
    answers = obsdesign.check(problem)
    assert (answers.verdict, answers["interval"].verdict) == ("proved", "proved")
    assert "finite_time: does_not_apply" in repr(answers)
    assert "does not apply" in answers._repr_html_()
    limit = obsdesign.search(problem, "shortest_dwell", accuracy=1e-3).result
    assert limit["proved"] == pytest.approx(np.log(2), rel=2e-3)
    comparison = obsdesign.compare(problem, kinds=["interval"])
    assert isinstance(comparison, Comparison)
    assert [row.kind for row in comparison.rows][0::len(comparison.rows) - 1] == [
        "interval", "Kalman filter",
    ]  # fmt: skip
    assert "Kalman filter" in repr(comparison)
    swept = obsdesign.sweep(problem, ["jump.dwell_time[0]=0.68:0.72:3"], jobs=1)
    assert swept.columns["verdict"] == ["refuted", "proved", "proved"]
    assert "<td>0.68</td>" in swept._repr_html_()


def test_tables_of_pandas(estimates: Estimates) -> None:
    pytest.importorskip("pandas", reason="the extra `interop` is not installed")
    frame = estimates.to_pandas()
    assert list(frame.columns) == ["t", "x1_lo", "x1_hi", "x2_lo", "x2_hi", "status"]
    assert obsdesign.run(estimates.design, frame.assign(gauge=1.0, jump=0), initial=INITIAL).status


def test_a_page_of_a_design(design: obsdesign.Design, tmp_path: Path) -> None:
    out = tmp_path / "r.html"
    assert obsdesign.report(design, str(out)).verdict == "proved"
    assert "hidden [m]" in out.read_text("utf-8")
