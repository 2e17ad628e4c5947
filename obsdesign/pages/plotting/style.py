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
    """InputError unless a PNG, SVG or PDF file can be written there."""
    if Path(output).suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"{output}: a picture must end in .png, .svg or .pdf.")
    if not Path(output).absolute().parent.is_dir():
        raise InputError(f"{output}: cannot be written: no such folder.")


@contextmanager
def picture(width: float, height: float, output: str | io.BytesIO | None) -> Iterator[Figure]:
    """A figure of so many inches, written when all of it was drawn: to a file, or as SVG.

    output: None where the figure itself is what is wanted.
    """
    suffix = Path(output).suffix.lower() if isinstance(output, str) else ".svg"
    drawn = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        if output is None:
            return
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix)
        figure.savefig(drawn, dpi=200, metadata=metadata, format=suffix.removeprefix("."))
    if isinstance(output, str):
        write_bytes(output, drawn.getvalue())
    else:
        output.write(drawn.getvalue())
