"""A curve of a design as a picture."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes

from obsdesign.pages.curves import Curve
from obsdesign.pages.plotting.style import BLACK, BLUE, GREEN, VERMILION, picture

_COLOURS = (BLUE, VERMILION, GREEN, BLACK, "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
# values that differ more than so much are drawn on a logarithmic axis
_WIDE = 1e3


def curve_svg(curve: Curve) -> str:
    """The picture as SVG text."""
    out = io.BytesIO()
    with picture(7.0, 3.0, out) as figure:
        axis = figure.subplots()
        _draw(axis, curve)
        if len(curve.series) <= len(_COLOURS):
            figure.legend(loc="outside upper center", ncols=min(4, len(curve.series) + 2),
                          frameon=False)  # fmt: skip
    return out.getvalue().decode("utf-8")


def _draw(axis: Axes, curve: Curve) -> None:
    if curve.proved is not None and curve.proved[0] == curve.proved[1]:
        axis.axvline(curve.proved[0], color=GREEN, alpha=0.4, lw=4, label="as designed")
    elif curve.proved is not None:
        axis.axvspan(*curve.proved, color=GREEN, alpha=0.13, lw=0, label="proved range")
    style = "steps-post" if curve.steps else "default"
    for k, (name, values) in enumerate(curve.series.items()):
        # equal curves are both seen
        line: str | tuple[float, tuple[float, float]] = "-" if k % 2 == 0 else (0, (5, 2))
        colour = _COLOURS[k % len(_COLOURS)]
        axis.plot(curve.x, values, color=colour, ls=line, lw=1.5, label=name, drawstyle=style)
    if curve.level is not None:
        axis.axhline(curve.level, color="0.35", lw=0.9, ls=(0, (4, 3)))
    y = np.concatenate([np.ravel(values) for values in curve.series.values()])
    y = y[np.isfinite(y)]
    if (y > 0).all() and len(y) and y.max() > _WIDE * y.min():
        axis.set_yscale("log")
    axis.set_xlabel(curve.x_label)
    axis.set_ylabel(curve.y_label)
    axis.margins(x=0.01)
