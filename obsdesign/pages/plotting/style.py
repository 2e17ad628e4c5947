"""Style of pictures, and the checks of their files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lmi.arithmetic.arrays import Value
from obsdesign.errors import InputError
from obsdesign.output_files import write_bytes

# Okabe-Ito: distinct in print and for colour-blind readers
BLACK, BLUE, GREEN, VERMILION, GREY = "#000000", "#0072B2", "#009E73", "#D55E00", "#BBBBBB"
ORANGE, PURPLE, SKY = "#E69F00", "#CC79A7", "#56B4E9"

_STYLE: Value = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "svg.hashsalt": "obsdesign",
}


def check_output(output: str) -> None:
    """InputError unless a PNG or SVG file can be written there."""
    if Path(output).suffix.lower() not in (".png", ".svg"):
        raise InputError(f"{output}: a picture must end in .png or .svg.")
    if not Path(output).absolute().parent.is_dir():
        raise InputError(f"{output}: cannot be written: no such folder.")


@contextmanager
def picture(width: float, height: float, output: str | io.BytesIO) -> Iterator[Figure]:
    """A figure of so many inches, written when all of it was drawn: to a file, or as SVG."""
    svg, drawn = not isinstance(output, str) or output.lower().endswith("svg"), io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        same, kind = ({"Date": None}, "svg") if svg else (None, "png")
        figure.savefig(drawn, dpi=200, metadata=same, format=kind)
    if isinstance(output, str):
        write_bytes(output, drawn.getvalue())
    else:
        output.write(drawn.getvalue())
