"""A plant with modes on the command line, from its file to a page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from obsdesign.cli.commands import cli
from obsdesign.errors import InputError
from tests.systems.switched import VALVE

PLAIN = VALVE.parent / "degue_4_1.toml"


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A design of the valve and simulated data."""
    path = tmp_path_factory.mktemp("valve")
    assert invoke("design", VALVE, "-o", path / "valve.json").exit_code == 0
    how = ("--until", 60, "--step", 0.1, "-o", path / "data.csv")
    assert invoke("simulate", VALVE, *how).exit_code == 0
    return path


def test_check_names_the_kinds_that_take_modes() -> None:
    result = invoke("check", VALVE, "--json")
    assert result.exit_code == 0
    verdicts = {kind: one["verdict"] for kind, one in json.loads(result.stdout)["result"].items()}
    assert [kind for kind in verdicts if verdicts[kind] == "proved"] == ["interval", "luenberger"]
    assert {*verdicts.values()} == {"proved", "does_not_apply"}


def test_from_a_file_to_a_page(folder: Path) -> None:
    design, data, estimate = (folder / x for x in ("valve.json", "data.csv", "estimate.csv"))
    assert invoke("verify", design, "--paranoid").exit_code == 0
    result = invoke("run", design, data, "-o", estimate, "--initial=-2,2,-2,2", "--strict",
                    "--events", folder / "events.csv")  # fmt: skip
    assert result.exit_code == 0
    assert ",mode closed" in (folder / "events.csv").read_text()
    page = folder / "page.html"
    assert (
        invoke("report", design, "--data", data, "--initial=-2,2,-2,2", "-o", page).exit_code == 0
    )
    text = page.read_text("utf-8")
    assert "2 modes (open, closed)" in text
    assert "L (closed)" in text
    picture = folder / "picture.svg"
    assert invoke("plot", estimate, data, "--design", design, "-o", picture).exit_code == 0
    assert invoke("export", design, "-o", folder / "gains.mat").exit_code == 0


def test_compare_runs_both_kinds_and_the_filter(folder: Path) -> None:
    result = invoke("compare", VALVE, "--data", folder / "data.csv", "--json")
    assert result.exit_code == 0
    rows = json.loads(result.stdout)["result"]["rows"]
    ran = {row["kind"]: row for row in rows if row["seconds"] is not None}
    assert {"interval", "luenberger", "Kalman filter"} <= set(ran)
    assert all(row["error"] < 0.2 for row in ran.values())


def test_search_names_the_mode() -> None:
    result = invoke("search", VALVE, "--for", "longest_dwell", "--of", "closed", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["result"]["proved"] == pytest.approx(24, rel=1e-5)
    other = invoke("search", VALVE, "--for", "longest_dwell", "--of", "stroke")
    assert "--of must be a mode, one of open, closed" in str(other.exception)
    none = invoke("search", PLAIN, "--for", "shortest_dwell", "--of", "closed")
    assert "--of names a mode; the plant has none" in str(none.exception)


def test_data_without_modes_are_refused(folder: Path) -> None:
    lines = (folder / "data.csv").read_text().splitlines()
    bare = folder / "bare.csv"
    bare.write_text("\n".join(line.rsplit(",", 1)[0] for line in lines) + "\n")
    result = invoke("run", folder / "valve.json", bare, "--initial=-2,2,-2,2")
    assert isinstance(result.exception, InputError)
    assert "column 'mode' is required" in str(result.exception)
    assert result.stdout == ""
