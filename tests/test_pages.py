"""Every command and every line of Python on these pages runs."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from tests.test_cli import ROOT, command

PAGES = ("sweep", "interop")


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / "docs" / f"{page}.md").read_text("utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


@pytest.mark.parametrize("page", PAGES)
def test_commands(page: str, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    lines = re.findall(r"^\$ obsdesign (.*)$", "\n".join(blocks(page, "console")), re.MULTILINE)
    assert lines
    for line in lines:
        done = command(*shlex.split(line), cwd=tmp_path)
        assert done.returncode == 0, (line, done.stderr)


@pytest.mark.parametrize("page", PAGES)
def test_python(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page == "interop":
        for package in ("control", "pandas"):
            pytest.importorskip(package, reason="the extra `interop` is not installed")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    code = "\n".join(blocks(page, "python"))
    assert "assert" in code
    exec(compile(code, f"{page}.md", "exec"), {})
