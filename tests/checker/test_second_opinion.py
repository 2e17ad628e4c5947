"""`verify --paranoid` and `design --bundle`: the checker as a second opinion, and as a gift."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

import obsdesign
from obsdesign.bundle import write_bundle
from obsdesign.cli.commands import cli
from obsdesign.design_file import from_dict, load_design
from obsdesign.errors import InputError
from obsdesign.verification import second_opinion
from tests.systems.checked import PROBLEMS, body, changed, evidence
from tests.systems.designs import designed

ROOT = Path(__file__).parents[2]


def checker_claim(document: dict, *, paranoid: bool = True) -> obsdesign.Claim | None:
    outcome = obsdesign.verify(from_dict(document), paranoid=paranoid)
    return {claim.id: claim for claim in outcome.claims}.get("checker")


def test_a_paranoid_verification_asks_the_checker() -> None:
    claim = checker_claim(body("cooperative"))
    assert claim is not None
    assert claim.verdict == "proved"
    assert claim.evidence["answers"][-2].startswith("confirmed: the stored gains")
    assert checker_claim(body("cooperative"), paranoid=False) is None


def test_what_it_does_not_confirm_is_undecided(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The twin: a program that says no."""
    program = tmp_path / "check_design.py"
    program.write_text("print('not proved: it fails')\nraise SystemExit(1)\n", "utf-8")
    monkeypatch.setattr(second_opinion, "PROGRAMS", (program, second_opinion.PROGRAMS[1]))
    outcome = obsdesign.verify(from_dict(body("cooperative")), paranoid=True)
    assert outcome.verdict == "undecided"
    claim = {claim.id: claim for claim in outcome.claims}["checker"]
    assert claim.evidence["reason"] == "check_design.py does not confirm it: not proved: it fails"


@pytest.mark.parametrize("name", ["cooperative", "point, no jumps"])
def test_designs_without_tails_have_no_second_opinion(name: str) -> None:
    claims = [claim["id"] for claim in body(name)["claims"] if "tails" in claim["evidence"]]
    older = changed(body(name), lambda d: [evidence(d, claim).pop("tails") for claim in claims])
    assert checker_claim(body(name)) is not None
    assert checker_claim(older) is None
    assert obsdesign.verify(from_dict(older), paranoid=True).verdict == "proved"


def test_plants_that_it_does_not_read_have_none() -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / "two_rates.toml")
    outcome = obsdesign.verify(obsdesign.design(problem), paranoid=True)
    assert outcome.verdict == "proved"
    assert "checker" not in {claim.id for claim in outcome.claims}


def test_clocks_of_their_own_have_one(tmp_path: Path) -> None:
    problem = obsdesign.load_problem(ROOT / "examples" / "motor_encoders.toml")
    design = obsdesign.design(problem)
    claim = {x.id: x for x in obsdesign.verify(design, paranoid=True).claims}["checker"]
    assert claim.verdict == "proved"
    assert [answer.program.name for answer in write_bundle(design, tmp_path)] == ["check_events.py"]
    assert "check_events.py     proves" in (tmp_path / "README.txt").read_text("utf-8")


def test_a_bundle_is_checked_by_its_own_command(tmp_path: Path) -> None:
    folder, design = tmp_path / "a" / "b", designed(PROBLEMS["cooperative"])
    codes = [answer.code for answer in write_bundle(design, folder)]
    assert codes == [0, 0, 0]
    names = ["README.txt", "check_design.py", "check_gains.py", "check_widths.py", "design.json"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert load_design(folder / "design.json").digest == design.digest
    text = (folder / "README.txt").read_text("utf-8")
    assert design.digest in text
    command = next(line for line in text.splitlines() if line.startswith("    python3 -I -S"))
    command = command.strip().replace("python3", sys.executable)
    done = subprocess.run(
        command, shell=True, cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    for line in done.stdout.splitlines():
        assert f"    {line}\n" in text


def test_a_bundle_from_the_command_line(tmp_path: Path) -> None:
    problem = str(ROOT / "examples" / "two_rates.toml")
    arguments = ["design", problem, "-o", str(tmp_path / "d.json"), "--bundle", str(tmp_path / "f")]
    answer = CliRunner().invoke(cli, arguments)
    assert answer.exit_code == 0
    assert "check_design.py: not read: a block is not known" in answer.stderr
    assert (tmp_path / "f" / "design.json").read_text() == (tmp_path / "d.json").read_text()


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "utf-8")
    with pytest.raises(InputError, match="cannot be written"):
        write_bundle(designed(PROBLEMS["cooperative"]), tmp_path / "file")
