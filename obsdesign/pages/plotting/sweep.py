"""A sweep as a picture: a curve over one entry, a map over two.

Points with a number show it. Points without differ by their colour: refuted, undecided, an
error; proved without a number (for a verdict), or without a limit (infinity); what a
sweep that was interrupted has not reached yet stays white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import FigureBase
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator

from lmi.arithmetic.arrays import Array, Matrix
from obsdesign.pages.plotting.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    check_output,
    picture,
)
from obsdesign.studies.sweep.axes import Axis
from obsdesign.studies.sweep.point import SweepPoint
from obsdesign.studies.sweep.record import SweepFile, read_sweep

_COLOURS = {
    "proved": GREEN,
    "no limit": GREEN,
    "refuted": VERMILION,
    "undecided": GREY,
    "error": BLACK,
}
_FAINT = 0.75  # as in the other pictures: colours at three quarters of their strength
_LOGARITHMIC = 10.0  # numbers of one sign whose largest is so many times the smallest


@dataclass(frozen=True)
class _Grid:
    """Numbers by point (NaN: none), and a word for each point without one."""

    axes: tuple[Axis, ...]
    numbers: Matrix
    words: Array

    @property
    def logarithmic(self) -> bool:
        finite = self.numbers[np.isfinite(self.numbers)]
        if not finite.size:
            return False
        return bool(finite.min() > 0 and finite.max() > _LOGARITHMIC * finite.min())


def plot_sweep(path: str, output: str) -> None:
    """Draw a sweep file into a PNG or SVG; InputError when it is none."""
    check_output(output)
    sweep = read_sweep(path)
    grid = _grid(sweep)
    quantity = sweep.header.quantity.replace("_", " ").replace("dwell", "dwell time")
    label = f"proved {quantity}"
    with picture(6.4, 3.4 if len(grid.axes) == 1 else 4.6, output) as figure:
        axis = figure.subplots()
        draw = _curve if len(grid.axes) == 1 else _map
        handles = draw(figure, axis, grid, label)
        axis.set_xlabel(grid.axes[0].key)
        if handles:
            figure.legend(handles=handles, loc="outside upper center", ncols=5, frameon=False)


def _grid(sweep: SweepFile) -> _Grid:
    axes = sweep.header.over
    numbers, words = np.full(sweep.count, np.nan), np.full(sweep.count, "", dtype=object)
    for index, point in sweep.points.items():
        numbers[index], words[index] = _number_or_word(point)
    shape = [axis.count for axis in axes]
    # the first entry goes to the right
    return _Grid(axes, numbers.reshape(shape).T, words.reshape(shape).T)


def _number_or_word(point: SweepPoint) -> tuple[float, str]:
    value = point.value
    if value == "inf":
        return math.nan, "no limit"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value), ""
    return math.nan, point.verdict if point.verdict in _COLOURS else "error"


def _curve(figure: FigureBase, axis: Axes, grid: _Grid, label: str) -> list[Patch]:
    """The numbers as a curve; a strip below it, or the whole panel, shows the other points."""
    values, handles = np.array(grid.axes[0].values), list[Patch]()
    numbers = bool(np.isfinite(grid.numbers).any())
    if numbers:
        axis.plot(values, grid.numbers, color=BLUE, lw=1.2, marker="o", ms=3)
        axis.set_yscale("log" if grid.logarithmic else "linear")
        axis.set_ylabel(label)
    else:
        axis.set_yticks([])
    edges = _edges(values)
    for word, colour in _COLOURS.items():
        for i in np.flatnonzero(grid.words == word):
            low, high = sorted(edges[i : i + 2])
            axis.axvspan(low, high, ymax=0.05 if numbers else 1.0, color=colour, alpha=_FAINT, lw=0)
        if (grid.words == word).any():
            handles.append(Patch(facecolor=colour, alpha=_FAINT, label=word))
    axis.set_xlim(min(edges), max(edges))
    return handles


def _map(figure: FigureBase, axis: Axes, grid: _Grid, label: str) -> list[Patch]:
    """The numbers as colours of cells, the other points in the colours of their words."""
    across, up = (_edges(np.array(a.values)) for a in grid.axes)
    if np.isfinite(grid.numbers).any():
        norm = LogNorm() if grid.logarithmic else None
        masked = np.ma.masked_invalid(grid.numbers)
        mesh = axis.pcolormesh(across, up, masked, cmap="viridis", norm=norm, rasterized=True)
        bar = figure.colorbar(mesh, ax=axis, label=label, format="%g")
        if grid.logarithmic:
            bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            bar.ax.yaxis.set_minor_locator(NullLocator())
    handles = []
    for word, colour in _COLOURS.items():
        there = np.ma.masked_where(grid.words != word, np.ones(grid.words.shape))
        if there.count():
            cells = ListedColormap([colour])
            axis.pcolormesh(across, up, there, cmap=cells, alpha=_FAINT, lw=0, rasterized=True)
            handles.append(Patch(facecolor=colour, alpha=_FAINT, label=word))
    axis.grid(visible=False)
    axis.set_ylabel(grid.axes[1].key)
    return handles


def _edges(values: Matrix) -> Matrix:
    """Cells of equal width around equally spaced values."""
    if len(values) == 1 or values[0] == values[-1]:
        half = 0.5 * max(abs(values[0]), 1.0) / len(values)
        return np.asarray(values[0] + half * np.arange(-1, 2 * len(values), 2), dtype=np.float64)
    half = 0.5 * (values[1] - values[0])
    return np.append(values - half, values[-1] + half)
