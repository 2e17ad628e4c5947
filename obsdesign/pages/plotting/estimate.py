"""Pictures of an estimate against data.

One panel per state: the bounds as a band or the estimate as a line, the true state where the
data has it, jump instants as vertical ticks, rows without guarantee marked on the time axis.
Bounds that are compared, with another observer or with the sensor, have a panel of widths beside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lmi.arithmetic.arrays import Array, Entries, Matrix, Value
from obsdesign.data.csv_lines import all_titles
from obsdesign.errors import InputError
from obsdesign.pages.plotting.bounds import draw_bounds, draw_widths
from obsdesign.pages.plotting.estimate_record import (
    ONE_JUMP,
    ClockColumns,
    EstimateRecord,
    Table,
)
from obsdesign.pages.plotting.row_lines import RowLines
from obsdesign.pages.plotting.stays import draw_stays
from obsdesign.pages.plotting.strips import Strip, strips_of
from obsdesign.pages.plotting.style import (
    BLACK,
    BLUE,
    PURPLE,
    SKY,
    VERMILION,
    check_output,
    picture,
)
from obsdesign.problem.clocks import CONTINUOUS
from obsdesign.problem.problem import Problem
from obsdesign.problem.signal_names import SignalNames

_STACKED = 4  # with more panels there are two columns of them
_LEGEND_WIDTH = 1.2  # inches of an entry
_LABELLED = 12  # impulses whose times fit above their bars
_EXPECTED = ("unresolved", "provisional: the record ends inside its window")
_TRUTH, _BAND, _ESTIMATE, _ALARM = BLACK, BLUE, BLUE, VERMILION
# of events, in their order
_EVENTS = ("0.55", PURPLE, SKY)
_SYMBOL: Entries = {"rotation": 0, "ha": "right", "va": "center", "fontsize": 11}


@dataclass(frozen=True)
class Comparison:
    """What is drawn with an estimate: another estimate file, and what is known of the plant.

    problem: its sensor strips, events, names and units; titles: column of the data by another
    title of it.
    """

    other: str | None = None
    problem: Problem | None = None
    titles: Mapping[str, str] = field(default_factory=dict)

    def strips(self, data: Table) -> Mapping[str, Strip]:
        """Sensor strips by state; none without a plant or data."""
        return {} if self.problem is None else strips_of(self.problem.plant, data)

    @property
    def has_widths(self) -> bool:
        """Is there anything that widths are drawn beside?"""
        return self.other is not None or self.problem is not None

    @property
    def names(self) -> SignalNames:
        """Names and units of the signals."""
        return SignalNames() if self.problem is None else self.problem.names

    @property
    def columns(self) -> Mapping[str, str]:
        """Column of the data by every other title of it."""
        return all_titles(self.names.columns, self.titles)

    @property
    def clocks(self) -> ClockColumns:
        """Columns of the plant's events and sampled outputs in data; of jumps without a plant."""
        if self.problem is None:
            return ONE_JUMP
        plant = self.problem.plant
        events = {event.name: event.columns for event in plant.events}
        # samples at events are marked by these
        sampled = [x for x in plant.sensors if x.measured not in (CONTINUOUS, "at_jumps")]
        return ClockColumns(events, [title for sensor in sampled for title in sensor.columns],
                            plant.flow.dt or 0.0)  # fmt: skip


NOTHING = Comparison()


def plot_estimate(
    estimate: str, data: str | None, output: str, events: str | None = None,
    compared: Comparison = NOTHING,
) -> None:  # fmt: skip
    """Draw an estimate file, with the truth and the jumps of a data file, into a PNG, SVG
    or PDF.

    events: an event file; its impulses become bands of two deviations and a panel of weights, with
    the measurements of the data above. compared: what bounds are drawn beside, with their widths.

    InputError for files that cannot be read, hold no states, or another kind of picture.
    """
    check_output(output)
    record = EstimateRecord.from_files(
        estimate, data, events, compared.other, clocks=compared.clocks, titles=compared.columns
    )
    draw_record(record, compared, output)


def draw_record(
    record: EstimateRecord, compared: Comparison = NOTHING, output: str | None = None
) -> Figure:
    """The figure of a record; written to a file where one is given."""
    record = replace(record, names=compared.names)
    strips = compared.strips(record.data)
    if "x1_lo" in record.estimate and not record.has_impulses and compared.has_widths:
        return _with_widths(record, strips, output)
    panels = record.panels
    columns = 1 if record.has_impulses or len(panels) <= _STACKED else 2
    rows = -(-len(panels) // columns)
    with picture(7.0 + 3.5 * (columns - 1), 1.2 + 1.7 * rows, output) as figure:
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        axes = grid.ravel()[: len(panels)]
        for axis in grid.ravel()[len(panels) :]:
            axis.set_axis_off()
        for axis, name in zip(axes, panels, strict=True):
            _panel(axis, name, record)
        _finish(figure, axes, axes[-columns:], record)
    return figure


def draw_panel(
    axis: Axes, name: str, record: EstimateRecord, compared: Comparison = NOTHING
) -> None:
    """One panel of a record on axes of one's own; name: x1, ..., of a state, d1, ... or y1, ...."""
    record = replace(record, names=compared.names)
    if name not in (*record.estimate.states, *record.data.measurements):
        raise InputError(f"{name!r} is no signal of the estimate: {', '.join(record.panels)}.")
    if name in record.data.measurements:
        _measurements(axis, name, record)
    else:
        _state(axis, name, record, compared.strips(record.data).get(name))
    _mark_status(axis, record)
    _time_axis(axis, record)
    axis.legend(fontsize=8, frameon=False)


def _with_widths(record: EstimateRecord, strips: Mapping[str, Strip], output: str | None) -> Figure:
    """A row for each state: its bounds, and their width on a logarithmic axis."""
    names = record.panels
    with picture(8.4, 1.0 + 1.7 * len(names), output) as figure:
        axes = figure.subplots(len(names), 2, sharex=True, squeeze=False, width_ratios=(3, 2))
        for (left, right), name in zip(axes, names, strict=True):
            _state(left, name, record, strips.get(name))
            draw_stays(right, record.stays)
            draw_widths(right, name, record, strips.get(name))
        axes[0, 0].set_title("bounds", fontsize=9)
        axes[0, 1].set_title("width of the bounds (logarithmic)", fontsize=9)
        _finish(figure, axes[:, 0], axes[-1], record)
    return figure


def _finish(figure: Figure, axes: Array, lowest: Array, record: EstimateRecord) -> None:
    """Label the time, mark the rows without guarantee, add the legend."""
    for axis in lowest:
        _time_axis(axis, record)
        axis.tick_params(labelbottom=True)
        _mark_status(axis, record)
    _legend(figure, axes)


def _time_axis(axis: Axes, record: EstimateRecord) -> None:
    unit = record.names.time_unit
    axis.set_xlabel(f"time [{unit}]" if unit else "time")


def _legend(figure: Figure, axes: Array) -> None:
    """One legend for all panels: what the first shows, then what the others add."""
    handles, labels = axes[0].get_legend_handles_labels()
    for axis in axes[1:]:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    columns = min(len(labels), int(figure.get_figwidth() / _LEGEND_WIDTH))
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False)


def _panel(axis: Axes, name: str, record: EstimateRecord) -> None:
    if name == "weight":
        _weights(axis, record.impulses)
    elif name in record.data.measurements:
        _measurements(axis, name, record)
    else:
        _state(axis, name, record)
    if record.has_impulses:
        if name != "weight":
            _bands(axis, record.impulses)
        _open_end(axis, record)


def _state(axis: Axes, name: str, record: EstimateRecord, strip: Strip | None = None) -> None:
    """Bounds, estimate and truth of one state, with the jumps."""
    # where every row is an event its dot says so; lines would hide it
    happened = {} if record.has_events_only else record.happened
    for colour, (event, instants) in zip(cycle(_EVENTS), happened.items(), strict=False):
        for k, instant in enumerate(instants):
            axis.axvline(instant, lw=0.7, ls=(0, (2, 2)), zorder=0, color=colour,
                         label=event if k == 0 else None)  # fmt: skip
    draw_stays(axis, record.stays)
    estimate, data = record.estimate, record.data
    if f"{name}_lo" in estimate:
        draw_bounds(axis, name, record, strip)
    if name in estimate:
        _curve(axis, record.lines(record.t), estimate.drawable(name), record.jumps,
               "o", color=_ESTIMATE, lw=1.4, label="estimate")  # fmt: skip
    if name in data:
        _curve(axis, record.lines(record.data_t), data.numbers(name), record.jumps,
               ".", color=_TRUTH, lw=0.9 if strip else 1.1, label="true state")  # fmt: skip
    _label(axis, name, record.names)
    axis.margins(x=0.02 if record.lines(record.t).alone.any() else 0.01)


def _curve(
    axis: Axes, rows: RowLines, values: Matrix, steps: Matrix, dot: str, **style: Value
) -> None:
    """A line through the rows that are joined, dots at the others."""
    split, (line,) = rows.pieces([values], steps)
    alone = np.where(rows.alone, values, np.nan)
    if not rows.alone.all():
        axis.plot(split, line, "-", **style)
        style["label"] = None
    axis.plot(rows.t, alone, dot, ms=4, **{**style, "lw": 0})


def _label(axis: Axes, name: str, names: SignalNames) -> None:
    """Name and unit of a signal at its axis; the symbol of formulas where it has no name."""
    unit, symbol = names.unit(name), f"${name[0]}_{{{name[1:]}}}$"
    if names.name_of(name) != name:
        axis.set_ylabel(names.label(name), fontsize=9)
        return
    if name[0] == "l":  # a further direction, l'x
        symbol = rf"$\ell_{{{name[1:]}}}'x$"
    axis.set_ylabel(f"{symbol} [{unit}]" if unit else symbol, **_SYMBOL)


def _measurements(axis: Axes, name: str, record: EstimateRecord) -> None:
    few = len(record.data_t) <= 200
    axis.plot(record.data_t, record.data.drawable(name), "o-" if few else "-", color="0.45", ms=3,
              lw=0.6, label="measured")  # fmt: skip
    _label(axis, name, record.names)


def _bands(axis: Axes, impulses: Table) -> None:
    """Each impulse as a line, with two deviations of its time where they are known."""
    spread = impulses.deviations("t")
    for k, (t, std) in enumerate(zip(impulses.numbers("t"), spread, strict=True)):
        axis.axvspan(t - 2 * std, t + 2 * std, color=_ALARM, alpha=0.18, lw=0, zorder=0)
        axis.axvline(t, color=_ALARM, lw=0.9, zorder=1, label="impulse" if k == 0 else None)


def _weights(axis: Axes, impulses: Table) -> None:
    """Bars with two deviations, and the time of each impulse above its bar."""
    columns = [x for x in impulses.columns if x.startswith("weight") and not x.endswith("_std")]
    t = impulses.numbers("t")
    tops = np.zeros(len(t))
    for k, name in enumerate(columns):
        weights, spread = impulses.numbers(name), impulses.deviations(name)
        axis.vlines(t, 0, weights, color=_BAND, lw=4, alpha=0.9 - 0.3 * k)
        axis.errorbar(
            t, weights, yerr=2 * spread, fmt="none", ecolor="0.2", elinewidth=1, capsize=3
        )
        tops = np.maximum(tops, weights + 2 * spread)
    if len(t) <= _LABELLED:
        for text, moment, top in zip(_moments(t, impulses), t, tops, strict=True):
            axis.annotate(text, (moment, top), (0, 3), textcoords="offset points",
                          ha="center", fontsize=8)  # fmt: skip
    axis.axhline(0, color="0.3", lw=0.6)
    axis.margins(y=0.25)
    if len(t) and tops.min() > 0:
        axis.set_ylim(bottom=0)
    axis.set_ylabel("weight", rotation=0, ha="right", va="center")


def _moments(t: Matrix, impulses: Table) -> list[str]:
    """Times with the decimals that their deviations leave, doubtful ones with a question mark."""
    labels = []
    statuses = impulses.statuses or ["ok"] * len(t)
    for moment, std, status in zip(t, impulses.deviations("t"), statuses, strict=True):
        decimals = max(0, math.ceil(-math.log10(2 * std))) if std > 0 else 6
        text = f"{moment:.{min(decimals, 6)}f}" if std > 0 else f"{moment:.4g}"
        labels.append(text + ("" if status in ("ok", *_EXPECTED) else " ?"))
    return labels


def _open_end(axis: Axes, record: EstimateRecord) -> None:
    """Shade the rows at the end whose window is not complete."""
    t, statuses = record.t, record.estimate.statuses
    last = len(statuses)
    while last and "unresolved" in statuses[last - 1]:
        last -= 1
    if last < len(statuses):
        axis.axvspan(
            t[last], t[-1], color="0.5", alpha=0.15, lw=0, zorder=0, label="window incomplete"
        )


def _mark_status(axis: Axes, record: EstimateRecord) -> None:
    """Mark the rows without guarantee; a window that is not complete is shaded instead."""
    statuses = record.estimate.statuses
    if record.has_impulses:
        statuses = ["; ".join(w for w in s.split("; ") if w not in _EXPECTED) for s in statuses]
    bad = [k for k, status in enumerate(statuses) if status and status != "ok"]
    if bad:
        axis.plot(record.t[bad], np.zeros(len(bad)), "|", color=_ALARM, ms=7, clip_on=False,
                  transform=axis.get_xaxis_transform(), label="status not ok")  # fmt: skip
