"""What guarantees assume of parameters is printed once, before the sentences under it."""

from __future__ import annotations

import json
from pathlib import Path

from click.testing import CliRunner

from obsdesign.cli.commands import cli
from tests.verification.luenberger.test_error_bound import spring


def test_an_assumption_is_printed_once(tmp_path: Path) -> None:
    problem, design = tmp_path / "problem.json", tmp_path / "design.json"
    problem.write_text(json.dumps(spring((2.0, -1.0))), "utf-8")
    arguments = ["--verbose", "design", str(problem), "-o", str(design)]
    done = CliRunner().invoke(cli, arguments)
    text = " ".join(done.stdout.split())
    assert done.exit_code == 0
    # with the box of the state, and without it
    assert text.count("Assumed: stiffness") == 2
    assert text.count("guaranteed: ") > 3
    assert "guaranteed: Assumed" not in text
    # each sentence of the file stands by itself
    stated = json.loads(design.read_text("utf-8"))["guarantees"]
    assert sum(entry["statement"].startswith("Assumed: stiffness") for entry in stated) > 2


def test_nothing_is_assumed_of_a_plant_without_parameters(tmp_path: Path) -> None:
    problem = tmp_path / "problem.json"
    body = spring((2.0, 0.0))
    del body["parameter"], body["state"]
    problem.write_text(json.dumps(body), "utf-8")
    arguments = ["--verbose", "design", str(problem), "-o", str(tmp_path / "design.json")]
    done = CliRunner().invoke(cli, arguments)
    assert "guaranteed: " in done.stdout
    assert "Assumed" not in done.stdout
