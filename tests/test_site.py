"""The documentation as people meet it: every snippet runs, every page is built and reached."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from obsdesign.cli.commands import cli

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
FENCE = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```", re.MULTILINE | re.DOTALL)
WITH_CODE = [p for p in PAGES if re.search("^```(console|python)", p.read_text("utf-8"), re.M)]

# 1 and 3 are answers (refuted, undecided); anything else is a snippet that does not work
SHELL = """
set -u
obsdesign() {
    "$PYTHON" -c 'from obsdesign.cli.main import main; main()' "$@"
    case $? in 0|1|3) ;; *) exit 9 ;; esac
}
python() {
    "$PYTHON" "$@" || exit 9
}
"""


def run(folder: Path, command: list[str]) -> None:
    environment = os.environ | {"PYTHON": sys.executable, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=400
    )
    assert done.returncode == 0, (command[-1], done.stdout, done.stderr)


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda p: p.stem)
def test_every_snippet_of_a_page_runs_in_turn(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if page.stem == "interop":
        for package in ("control", "pandas"):
            pytest.importorskip(package, reason="the extra `interop` is not installed")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}  # later lines of Python know the earlier ones
    for language, title, text in FENCE.findall(page.read_text("utf-8")):
        if title:
            (tmp_path / title).write_text(text)
        elif language == "console":
            lines = re.findall(r"^\$ (?:\.venv/bin/)?(.*)$", text, flags=re.MULTILINE)
            assert lines
            run(tmp_path, ["bash", "-c", SHELL + "\n".join(lines)])
        elif language == "python":
            exec(compile(text, page.name, "exec"), names)


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
        assert f": {page.name}" in nav, f"{page.name} is not in the navigation"
        name = "index.html" if page.stem == "index" else f"{page.stem}/index.html"
        assert (tmp_path / "site" / name).exists()
    api = (tmp_path / "site" / "api" / "index.html").read_text("utf-8")
    assert "Read a problem file" in api
    assert 'src="http' not in api


def test_a_link_that_leads_nowhere_fails_the_site(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("[nothing](nowhere.md)\n")
    (tmp_path / "mkdocs.yml").write_text("site_name: x\nstrict: true\n")
    assert build(tmp_path / "mkdocs.yml", tmp_path / "site").returncode != 0
