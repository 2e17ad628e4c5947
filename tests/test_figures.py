"""Every script of `docs/figures` draws its pictures, into the folder that it is given."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
SCRIPTS = [
    path.stem
    for path in sorted((DOCS / "figures").glob("*.py"))
    if "__main__" in path.read_text("utf-8")
]


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_draws_pictures_of_the_pages(script: str, tmp_path: Path) -> None:
    importlib.import_module(f"docs.figures.{script}").draw(tmp_path)
    pictures = sorted(path.name for path in tmp_path.iterdir())
    assert pictures
    assert [name for name in pictures if not (DOCS / name).exists()] == []
    for name in pictures:
        assert (tmp_path / name).stat().st_size > 10_000, name
