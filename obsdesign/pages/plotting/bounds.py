"""Bounds of a state, beside those of another observer and the sensor strip; their widths."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullLocator

from lmi.arithmetic.arrays import Entries, Matrix
from obsdesign.pages.plotting.estimate_record import EstimateRecord, Table
from obsdesign.pages.plotting.strips import Strip
from obsdesign.pages.plotting.style import BLUE, GREEN, ORANGE

_BAND, _OTHER, _STRIP = BLUE, ORANGE, GREEN
_BEHIND, _BETWEEN, _FRONT = 1.0, 1.3, 1.6
# bounds of another observer are shown up to so many heights of the estimate's own bounds beyond
_MOST_BEYOND = 1.5
# more samples than these are too close for dots
_MOST_DOTS = 150
# an axis of widths shows at least so many decades, and more than so many by powers of ten alone
_LEAST_DECADES, _FEW_DECADES = 1.2, 2.5
# and at most so many: what is narrower is nothing to anybody
_MOST_DECADES = 6.0


def draw_bounds(
    axis: Axes, name: str, record: EstimateRecord, strip: Strip | None, rows_only: bool
) -> None:
    """The other observer's bounds, the strip over them, and the estimate's own in front."""
    compared = bool(record.other.columns)
    own = _ends(record.estimate, name)
    if compared and f"{name}_lo" in record.other:
        _band(axis, record, record.other, name, rows_only)
    if strip is not None:
        _draw_strip(axis, strip)
    _band(axis, record, record.estimate, name, rows_only)
    if compared:
        axis.set_ylim(*_limits(own, axis.get_ylim()))


def draw_widths(
    axis: Axes, name: str, record: EstimateRecord, strip: Strip | None, rows_only: bool
) -> None:
    """Width of the bounds over time, on a logarithmic axis; the strip's as a level."""
    level = strip.width if strip is not None else 0.0  # 0 without noise: not on such an axis
    drawn = [np.array([level])] if level else []
    for table in (record.other, record.estimate):
        if f"{name}_lo" not in table:
            continue
        lower, upper = _ends(table, name)
        t, width = table.numbers("t"), np.where(upper > lower, upper - lower, np.nan)
        if not rows_only:
            t, (width,) = with_gaps(t, [width], record.jumps)
        drawn.append(width[np.isfinite(width) & (width > 0)])
        axis.plot(t, width, "." if rows_only else "-", color=_style(record, table)["color"], lw=1.3)
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


def with_gaps(t: Matrix, series: Sequence[Matrix], jumps: Matrix) -> tuple[Matrix, list[Matrix]]:
    """Break the lines at jumps: the last value is held up to the jump, which is a step."""
    at = np.flatnonzero(np.isin(t, jumps) & (np.arange(len(t)) > 0))
    return np.insert(t, at, t[at]), [np.insert(s, at, s[at - 1]) for s in series]


def _ends(table: Table, name: str) -> tuple[Matrix, Matrix]:
    return table.drawable(f"{name}_lo"), table.drawable(f"{name}_hi")


def _style(record: EstimateRecord, table: Table) -> Entries:
    """Colour and label of a table's bounds; files name them where there are two."""
    colour = _OTHER if table is record.other else _BAND
    label = Path(table.path).stem if record.other.columns else "bounds"
    return {"color": colour, "label": label.replace("_", " ")}


def _band(axis: Axes, record: EstimateRecord, table: Table, name: str, rows_only: bool) -> None:
    """Bounds of a table; those in front hide what is behind them."""
    low, high = _ends(table, name)
    style, order = _style(record, table), _BEHIND if table is record.other else _FRONT
    t = table.numbers("t")
    if rows_only:
        wide = 5.0 if table is record.other else 2.5
        axis.vlines(t, low, high, lw=wide, alpha=0.6, zorder=order, **style)
        return
    split, (low, high) = with_gaps(t, [low, high], record.jumps)
    if order == _FRONT:
        axis.fill_between(split, low, high, color="white", alpha=0.7, lw=0, zorder=order)
    axis.fill_between(split, low, high, alpha=0.3, lw=0, zorder=order, **style)
    for edge in (low, high):
        axis.plot(split, edge, color=style["color"], lw=0.9, zorder=order + 0.1)


def _draw_strip(axis: Axes, strip: Strip) -> None:
    """A bar at each sample, with a dot where they are few; nothing between samples."""
    rows = strip.t.repeat(3)
    bars = np.column_stack([strip.lower, strip.upper, np.full(len(strip.t), np.nan)]).ravel()
    wide = float(np.clip(300 / len(strip.t), 1.0, 4.0))
    axis.plot(rows, bars, color=_STRIP, alpha=0.5, lw=wide, zorder=_BETWEEN,
              solid_capstyle="butt")  # fmt: skip
    axis.fill_between([], [], color=_STRIP, alpha=0.5, lw=0, label="sensor strip")
    middles = (strip.lower + strip.upper) / 2
    if 0 < np.isfinite(middles).sum() <= _MOST_DOTS:
        axis.plot(strip.t, middles, ".", color=_STRIP, ms=4, zorder=_FRONT + 0.2, label="sample")


def _limits(own: tuple[Matrix, Matrix], drawn: tuple[float, float]) -> tuple[float, float]:
    """Limits of a panel that shows its own bounds whole and others where they are not far."""
    if np.isnan(own).all():
        return drawn
    low, high = float(np.nanmin(own)), float(np.nanmax(own))
    far = _MOST_BEYOND * (high - low)
    return max(drawn[0], low - far), min(drawn[1], high + far)
