"""Every script of `docs/figures` draws its pictures, those that the pages show."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

DOCS = Path(__file__).parents[1] / "docs"
SCRIPTS = [
    path.stem
    for path in sorted((DOCS / "figures").glob("*.py"))
    if "__main__" in path.read_text("utf-8")
    # drawn in test_readme.py and test_site.py
    and path.stem not in ("demo", "tutorials")
]
SQUARE, FAINT, MOST = 16, 0.05, 0.05  # pixels; a difference of grey; share of other squares


def grey_squares(path: Path) -> np.ndarray:
    """Mean grey, 0 to 1, of the squares of a picture: where a line runs, whatever its edges."""
    grey = imread(path)[..., :3].mean(axis=2)
    rows, columns = (size // SQUARE for size in grey.shape)
    squares = grey[: rows * SQUARE, : columns * SQUARE].reshape(rows, SQUARE, columns, SQUARE)
    means: np.ndarray = squares.mean(axis=(1, 3))
    return means


def is_same_picture(one: Path, other: Path) -> bool:
    """Alike but for rounding and letters, which differ between machines."""
    a, b = grey_squares(one), grey_squares(other)
    return a.shape == b.shape and bool((np.abs(a - b) > FAINT).mean() < MOST)


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_draws_pictures_of_the_pages(script: str, tmp_path: Path) -> None:
    importlib.import_module(f"docs.figures.{script}").draw(tmp_path)
    pictures = sorted(path.name for path in tmp_path.iterdir())
    assert pictures
    assert [name for name in pictures if not (DOCS / name).exists()] == []
    for name in pictures:
        assert (tmp_path / name).stat().st_size > 10_000, name
        assert is_same_picture(tmp_path / name, DOCS / name), f"{DOCS / name} is out of date"


def test_pictures_of_other_data_differ() -> None:
    same, other = DOCS / "degue_1.png", DOCS / "degue_3.png"
    assert is_same_picture(same, same)
    assert not is_same_picture(same, other)
