"""The picture of the README: what `obsdesign demo` draws, and the widths that its caption names.

python -m docs.figures.demo [FOLDER]        draws demo.png
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np

from docs.figures.folder import chosen
from obsdesign.cli.demo import run_demo
from obsdesign.pages.plotting.estimate_record import Table

STRIP = 0.06  # twice the noise bound of x2


def widths(folder: Path, kind: str) -> np.ndarray:
    """Widths (rows, 2) of the bounds of a kind in the folder of a demo."""
    table = Table.from_file(str(folder / f"{kind}.csv"))
    ends = [[table.numbers(f"x{i}_{end}") for i in (1, 2)] for end in ("lo", "hi")]
    return np.transpose(np.subtract(ends[1], ends[0]))


def numbers(folder: Path) -> tuple[float, float, float]:
    """Mean width of the interval bounds over that of the others, of x1 and x2; share below STRIP.

    The share is that of the rows whose bounds of x2 are narrower than one sample alone allows.
    """
    own, other = widths(folder, "set_membership"), widths(folder, "interval")
    ratios = other.mean(axis=0) / own.mean(axis=0)
    return float(ratios[0]), float(ratios[1]), float((own[:, 1] < 0.999 * STRIP).mean())


def draw(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        run_demo(Path(scratch))
        shutil.copy(Path(scratch, "bounds.png"), folder / "demo.png")
        ratio_1, ratio_2, share = numbers(Path(scratch))
    print(f"written: {folder / 'demo.png'}; x1 {ratio_1:.2f} and x2 {ratio_2:.2f} times narrower,")
    print(f"x2 narrower than its sensor strip on {100 * share:.1f} % of the rows")


if __name__ == "__main__":
    draw(chosen())
