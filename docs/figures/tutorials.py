"""The pictures of the tutorials, as the code of their pages draws them.

python -m docs.figures.tutorials [FOLDER]        draws tutorials/*.png
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from pathlib import Path

import matplotlib as mpl

from docs.figures.folder import chosen
from docs.notebooks import BLOCK, TUTORIALS


def draw(folder: Path) -> None:
    mpl.use("Agg")
    for page in sorted(TUTORIALS.glob("*.md")):
        with tempfile.TemporaryDirectory() as scratch:
            names: dict[str, object] = {}
            with contextlib.chdir(scratch):
                for language, file, text in BLOCK.findall(page.read_text("utf-8")):
                    if file:
                        Path(file).write_text(text, encoding="utf-8")
                    elif language == "python":
                        exec(compile(text, page.name, "exec"), names)
            shutil.copy(Path(scratch, f"{page.stem}.png"), folder / f"{page.stem}.png")
        print(f"written: {folder / page.stem}.png")


if __name__ == "__main__":
    draw(chosen() / "tutorials")
