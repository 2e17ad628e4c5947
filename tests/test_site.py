"""The documentation as people meet it: every snippet runs, every page is built and reached."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import nbformat
import pytest
from click.testing import CliRunner

from docs.notebooks import BLOCK as FENCE
from docs.notebooks import TUTORIALS, notebook
from obsdesign.cli.commands import cli
from tests.systems.command_line import command
from tests.systems.compiled import require
from tests.test_figures import is_same_picture

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").rglob("*.md"))
WITH_CODE = [p for p in PAGES if re.search("^```(console|python)", p.read_text("utf-8"), re.M)]

# 1 and 3 are answers (refuted, undecided); anything else is a snippet that does not work
SHELL = """
set -u -o pipefail
obsdesign() {
    "$PYTHON" -c 'from obsdesign.cli.main import main; main()' "$@"
    case $? in 0|1|3) ;; *) return 9 ;; esac
}
python() {
    "$PYTHON" "$@" || exit 9
}
"""


SPECIAL = re.compile(r"[|<>;&$`*(){}]")  # what is more to a shell than words


def outputs(folder: Path, lines: list[str]) -> list[str]:
    """What each of the commands prints, on either stream.

    Commands of obsdesign without pipes run in this process, all others in a shell.
    """
    return [
        in_process(folder, line)
        if line.startswith("obsdesign ") and not SPECIAL.search(line)
        else in_shell(folder, line)
        for line in lines
    ]


def in_process(folder: Path, line: str) -> str:
    done = command(*shlex.split(line)[1:], cwd=folder)
    assert done.returncode in (0, 1, 3), (line, done.stderr)
    return done.stdout + done.stderr


def in_shell(folder: Path, line: str) -> str:
    environment = os.environ | {"PYTHON": sys.executable, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", f"{SHELL}{line} || exit 9"], cwd=folder, env=environment, timeout=400, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, (line, done.stdout)
    return done.stdout


def steps(block: str) -> list[tuple[str, str]]:
    """(command, what the page says that it prints) of each line that begins with $."""
    parts = re.split(r"^\$ ", block.replace(".venv/bin/", ""), flags=re.MULTILINE)[1:]
    return [(command, said) for command, _, said in (part.partition("\n") for part in parts)]


def missing_line(said: str, output: str) -> str | None:
    """The first line of a page that the output does not have, in the page's order.

    A line is whole words, wherever the output breaks its lines; `…` stands for any text.
    """
    shown = " ".join(output.split())
    for line in filter(None, map(str.strip, said.splitlines())):
        words = re.escape(" ".join(line.split())).replace("…", ".*?")
        match = re.search(rf"(?<!\S){words}" + ("" if line.endswith("…") else r"(?!\S)"), shown)
        if match is None:
            return line
        shown = shown[match.end() :]
    return None


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda p: p.stem)
def test_every_snippet_of_a_page_runs_in_turn(page: Path, tmp_path: Path) -> None:
    if page.stem == "interop":
        for package in ("control", "pandas"):
            pytest.importorskip(package, reason="the extra `interop` is not installed")
    if page.stem == "embedded":
        require("cc")
        pytest.importorskip("fmpy", reason="the extra `fmu` is not installed")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")  # a page may write there
    names: dict[str, object] = {}  # later lines of Python know the earlier ones
    with chdir(tmp_path):
        for language, title, text in FENCE.findall(page.read_text("utf-8")):
            if title:
                (tmp_path / title).write_text(text)
            elif language == "console":
                pairs = steps(text)
                assert pairs
                shown = outputs(tmp_path, [line for line, _ in pairs])
                for (typed, said), output in zip(pairs, shown, strict=True):
                    assert (line := missing_line(said, output)) is None, (typed, line, output)
            elif language == "python":
                exec(compile(text, page.name, "exec"), names)
    if page.parent == TUTORIALS:  # its picture is the one that it draws
        picture = f"{page.stem}.png"
        assert is_same_picture(tmp_path / picture, TUTORIALS / picture), "out of date"


OUTPUT = """shortest dwell: proved at 0.6931474578188175
  refuted at 0.6931469033010731, where the map has
  spectral radius 1.00000028 >= 1
"""


@pytest.mark.parametrize(
    ("said", "missing"),
    [
        ("", None),
        ("proved at 0.693147…\nspectral radius 1.00000028 >= 1", None),
        ("refuted at … spectral radius 1.0000…", None),
        ("proved at 0.6580…", "proved at 0.6580…"),
        ("proved at 0.693147", "proved at 0.693147"),  # its last digits are missing
        ("radius 1.00000028 >= 1\nproved at 0.693147…", "proved at 0.693147…"),  # out of order
    ],
)
def test_what_a_page_says_of_a_command_is_what_it_prints(said: str, missing: str | None) -> None:
    assert missing_line(said, OUTPUT) == missing


def test_commands_are_documented_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    from docs.command_reference import page

    monkeypatch.setenv("COLUMNS", "80")
    assert (ROOT / "docs" / "commands.md").read_text("utf-8") == page()


def test_the_help_of_a_command_is_on_the_page() -> None:
    """What the page is compared with is what people see."""
    shown = CliRunner().invoke(cli, ["verify", "--help"]).stdout
    written = (ROOT / "docs" / "commands.md").read_text("utf-8")
    assert "Prove a second time by an independent method" in shown
    assert "Prove a second time by an independent method" in written


def build(source: Path, site: Path) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("material", reason="mkdocs-material is not installed: no site is built")
    pytest.importorskip("mkdocstrings")
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(source), "-d", site],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    done = build(ROOT / "mkdocs.yml", tmp_path / "site")
    assert done.returncode == 0, done.stdout + done.stderr
    nav = (ROOT / "mkdocs.yml").read_text("utf-8")
    for page in PAGES:
        place = page.relative_to(ROOT / "docs")
        assert f": {place}" in nav, f"{place} is not in the navigation"
        name = "index.html" if page.stem == "index" else f"{place.with_suffix('')}/index.html"
        assert (tmp_path / "site" / name).exists()
    theory = (tmp_path / "site" / "theory" / "index.html").read_text("utf-8")
    assert "<math" in theory
    assert "arithmatex" not in theory
    api = (tmp_path / "site" / "api" / "index.html").read_text("utf-8")
    assert "Read a problem file" in api
    assert 'src="http' not in api
    for page in TUTORIALS.glob("*.md"):
        assert (tmp_path / "site" / "tutorials" / f"{page.stem}.ipynb").exists()


def test_the_notebook_of_a_page_does_what_the_page_does() -> None:
    page = (TUTORIALS / "tank.md").read_text("utf-8")
    cells = nbformat.reads(notebook(page), as_version=4).cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    blocks = FENCE.findall(page)
    assert [
        text.split("\n", 1)[1] if text.startswith("%%writefile") else text for text in code
    ] == [text.rstrip() for _, _, text in blocks]
    assert code[0].startswith("%%writefile tank.toml\nname")
    assert not any("](tank.png)" in cell.source for cell in cells)


def test_a_link_that_leads_nowhere_fails_the_site(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("[nothing](nowhere.md)\n")
    (tmp_path / "mkdocs.yml").write_text("site_name: x\nstrict: true\n")
    assert build(tmp_path / "mkdocs.yml", tmp_path / "site").returncode != 0
