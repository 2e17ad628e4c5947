"""Bounds of a state, beside those of another observer and the sensor strip; their widths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator

from lmi.arithmetic.arrays import Entries, Matrix, Value
from obsdesign.pages.plotting.estimate_record import EstimateRecord, Table
from obsdesign.pages.plotting.row_lines import MOST_DOTS
from obsdesign.pages.plotting.strips import Strip
from obsdesign.pages.plotting.style import BLUE, GREEN, ORANGE

_BAND, _OTHER, _STRIP = BLUE, ORANGE, GREEN
_BEHIND, _BETWEEN, _FRONT = 1.0, 1.3, 1.6
# bounds of another observer are shown up to so many heights of the estimate's own bounds beyond
_MOST_BEYOND = 1.5
# an axis of widths shows at least so many decades, and more than so many by powers of ten alone
_LEAST_DECADES, _FEW_DECADES = 1.2, 2.5
# and at most so many: what is narrower is nothing to anybody
_MOST_DECADES = 6.0


def draw_bounds(axis: Axes, name: str, record: EstimateRecord, strip: Strip | None) -> None:
    """The wider of two observers' bounds, the strip over them, and the narrower in front."""
    compared = bool(record.other.columns)
    own = _ends(record.estimate, name)
    tables = [t for t in (record.other, record.estimate) if f"{name}_lo" in t]
    back, *front = sorted(tables, key=lambda table: -_mean_width(table, name))
    if front:
        _band(axis, record, back, name, _BEHIND)
    if strip is not None:
        _draw_strip(axis, strip)
    _band(axis, record, front[0] if front else back, name, _FRONT)
    if compared:
        axis.set_ylim(*_limits(own, axis.get_ylim()))


def draw_widths(axis: Axes, name: str, record: EstimateRecord, strip: Strip | None) -> None:
    """Width of the bounds over time, on a logarithmic axis; the strip's as a level."""
    level = strip.width if strip is not None else 0.0  # 0 without noise: not on such an axis
    drawn = [np.array([level])] if level else []
    for table in (record.other, record.estimate):
        if f"{name}_lo" not in table:
            continue
        lower, upper = _ends(table, name)
        t, width = table.numbers("t"), np.where(upper > lower, upper - lower, np.nan)
        drawn.append(width[np.isfinite(width) & (width > 0)])
        rows, colour = record.lines(t), _style(record, table)["color"]
        split, (line,) = rows.pieces([width], record.steps)
        axis.plot(split, line, color=colour, lw=1.3)
        axis.plot(t[rows.alone], width[rows.alone], ".", color=colour)
    if level:
        axis.axhline(level, color=_STRIP, lw=1.4, ls=(0, (4, 2)))
    axis.set_yscale("log")
    low, high = _decades(np.concatenate([np.ones(0), *drawn]))
    missing = max(0.0, _LEAST_DECADES - (high - low)) / 2
    axis.set_ylim(10 ** (low - missing), 10 ** (high + missing))
    if high - low < _FEW_DECADES:
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_formatter("{x:g}")
    axis.margins(x=0.01)


def _decades(widths: Matrix) -> tuple[float, float]:
    """Powers of ten between which widths are drawn, with a margin of a twentieth."""
    if not widths.size:
        return -1.0, 0.0
    low, high = np.log10(widths.min()), np.log10(widths.max())
    low = max(low, high - _MOST_DECADES)
    return float(low - (high - low) / 20), float(high + (high - low) / 20)


def _ends(table: Table, name: str) -> tuple[Matrix, Matrix]:
    return table.drawable(f"{name}_lo"), table.drawable(f"{name}_hi")


def _style(record: EstimateRecord, table: Table) -> Entries:
    """Colour and label of a table's bounds; files name them where there are two."""
    colour = _OTHER if table is record.other else _BAND
    label = Path(table.path).stem if record.other.columns else "bounds"
    return {"color": colour, "label": label.replace("_", " ")}


def _mean_width(table: Table, name: str) -> float:
    low, high = _ends(table, name)
    known = np.isfinite(high - low)
    return float((high - low)[known].mean()) if known.any() else math.inf


def _band(axis: Axes, record: EstimateRecord, table: Table, name: str, order: float) -> None:
    """Bounds of a table, bars at rows that are joined with none; what is in front hides others."""
    t, ends = table.numbers("t"), _ends(table, name)
    rows, style = record.lines(t), _style(record, table)
    split, (low, high) = rows.pieces(ends, record.steps)
    if order == _FRONT:
        axis.fill_between(split, low, high, color="white", alpha=0.7, lw=0, zorder=order)
    axis.fill_between(split, low, high, alpha=0.3, lw=0, zorder=order, **style)
    for edge in (low, high):
        axis.plot(split, edge, color=style["color"], lw=0.9, zorder=order + 0.1)
    wide, own = 4.0 if order == _FRONT else 7.0, [end[rows.alone] for end in ends]
    if order == _FRONT:
        _bars(axis, t[rows.alone], own, lw=wide, zorder=order, color="white")
    _bars(axis, t[rows.alone], own, lw=wide, zorder=order, color=style["color"])
    for end in own:  # what is narrower than a line has two ends as well
        axis.plot(t[rows.alone], end, "_", ms=wide, mew=0.9, zorder=order + 0.1,
                  color=style["color"])  # fmt: skip


def _bars(axis: Axes, t: Matrix, ends: Sequence[Matrix], **style: Value) -> None:
    """A bar from end to end at each time; as one path, so that they do not darken each other."""
    path = np.column_stack([*ends, np.full(len(t), np.nan)]).ravel()
    axis.plot(t.repeat(3), path, alpha=0.6, solid_capstyle="butt", **style)


def _draw_strip(axis: Axes, strip: Strip) -> None:
    """A bar at each sample, with a dot where they are few; nothing between samples."""
    wide = float(np.clip(300 / len(strip.t), 1.0, 5.5))
    _bars(axis, strip.t, [strip.lower, strip.upper], color=_STRIP, lw=wide, zorder=_BETWEEN)
    axis.fill_between([], [], color=_STRIP, alpha=0.5, lw=0, label="sensor strip")
    middles = (strip.lower + strip.upper) / 2
    if 0 < np.isfinite(middles).sum() <= MOST_DOTS:
        axis.plot(strip.t, middles, ".", color=_STRIP, ms=4, zorder=_FRONT + 0.2, label="sample")


def _limits(own: tuple[Matrix, Matrix], drawn: tuple[float, float]) -> tuple[float, float]:
    """Limits of a panel that shows its own bounds whole and others where they are not far."""
    if np.isnan(own).all():
        return drawn
    low, high = float(np.nanmin(own)), float(np.nanmax(own))
    far = _MOST_BEYOND * (high - low)
    return max(drawn[0], low - far), min(drawn[1], high + far)
