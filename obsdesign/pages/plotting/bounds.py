"""Bounds of several observers of one plant, one over the other, each state in a panel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike

from lmi.arithmetic.arrays import Matrix
from obsdesign.pages.plotting.style import BLACK, BLUE, GREEN, VERMILION, check_output, picture

_COLOURS = (VERMILION, BLUE, GREEN)


_Bounds = Mapping[str, tuple[ArrayLike, ArrayLike]]


def plot_bounds(t: ArrayLike, x: ArrayLike, bounds: _Bounds, output: str) -> None:
    """Bounds by label, (lower, upper) each (rows, n), over the true state x, (rows, n).

    t: (rows,). At most three observers are told apart. InputError for another kind of picture.
    """
    check_output(output)
    times, truth = np.asarray(t), np.asarray(x)
    n = truth.shape[1]
    with picture(7.0, 1.0 + 1.7 * n, output) as figure:
        axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
        for i, axis in enumerate(axes):
            _panel(axis, times, truth[:, i], bounds, i)
            axis.set_ylabel(f"$x_{{{i + 1}}}$", rotation=0, ha="right", va="center", fontsize=11)
        axes[-1].set_xlabel("time")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)


def _panel(axis: Axes, t: Matrix, x: Matrix, bounds: _Bounds, i: int) -> None:
    for colour, (label, (lower, upper)) in zip(_COLOURS, bounds.items(), strict=False):
        low, high = np.asarray(lower)[:, i], np.asarray(upper)[:, i]
        axis.fill_between(t, low, high, color=colour, alpha=0.22, lw=0, label=label)
        for edge in (low, high):
            axis.plot(t, edge, color=colour, lw=0.8)
    axis.plot(t, x, color=BLACK, lw=1.0, label="true state")
    axis.margins(x=0.01)
