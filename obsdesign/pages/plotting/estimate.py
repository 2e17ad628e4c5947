"""Pictures of an estimate against data.

One panel per state: the bounds as a band or the estimate as a line, the true state where the
data has it, jump instants as vertical ticks, rows without guarantee marked on the time axis.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.records import read_columns
from obsdesign.errors import InputError
from obsdesign.pages.plotting.style import BLACK, BLUE, VERMILION, check_output, picture

# beyond, the drawing library overflows
_DRAWABLE = 1e100
# with more jumps than this part of the rows, nothing is known between them: no lines are drawn
_ROWS_ONLY = 0.9
_STACKED = 4  # with more panels there are two columns of them
_LABELLED = 12  # impulses whose times fit above their bars
_EXPECTED = ("unresolved", "provisional: the record ends inside its window")
_TRUTH, _BAND, _ESTIMATE, _ALARM = BLACK, BLUE, BLUE, VERMILION


def plot_estimate(estimate: str, data: str | None, output: str, events: str | None = None) -> None:
    """Draw an estimate file, with the truth and the jumps of a data file, into a PNG or SVG.

    events: an event file; its impulses become bands of two deviations and a panel of weights, with
    the measurements of the data above.

    InputError for files that cannot be read, hold no states, or another kind of picture.
    """
    check_output(output)
    estimates = read_columns(estimate)
    truth = {} if data is None else read_columns(data)
    t = _numbers(estimates, "t", estimate)
    names = _states(estimates)
    if not names or not len(t):
        raise InputError(
            f"{estimate}: columns x1_lo, x1_hi or x1 and at least one row are required."
        )
    _same_plant(names, estimate, truth, str(data))
    times = _numbers(truth, "t", str(data)) if truth else np.zeros(0)
    jumps = times[_numbers(truth, "jump", str(data)) == 1] if "jump" in truth else np.zeros(0)
    impulses = {} if events is None else read_columns(events)
    measured = [name for name in truth if name[0] == "y" and name[1:].isdigit()]
    measured = measured if impulses else []
    panels = [*measured, *names, *(["weight"] if impulses else [])]
    columns = 1 if impulses or len(panels) <= _STACKED else 2
    rows = -(-len(panels) // columns)
    with picture(7.0 + 3.5 * (columns - 1), 1.2 + 1.7 * rows, output) as figure:
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        axes = grid.ravel()[: len(panels)]
        bottom = axes[-columns:]
        for axis in grid.ravel()[len(panels) :]:
            axis.set_axis_off()
        for axis, name in zip(axes, panels, strict=True):
            if name == "weight":
                _weights(axis, impulses, str(events))
            elif name in measured:
                _measurements(axis, name, times, truth, str(data))
            else:
                _panel(axis, name, t, estimates, estimate, times, truth, str(data), jumps)
            if impulses:
                if name != "weight":
                    _bands(axis, impulses, str(events))
                _open_end(axis, t, estimates.get("status", []))
        for axis in bottom:
            axis.set_xlabel("time")
            axis.tick_params(labelbottom=True)
        statuses = estimates.get("status", [])
        if impulses:  # the open end is shaded
            statuses = ["; ".join(w for w in s.split("; ") if w not in _EXPECTED) for s in statuses]
        for axis in bottom:
            _mark_status(axis, t, statuses)
        handles, labels = axes[0].get_legend_handles_labels()
        for axis in axes[1:]:
            for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
                if label not in labels:
                    handles.append(handle)
                    labels.append(label)
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)


def _same_plant(names: list[str], estimate: str, truth: dict[str, list[str]], data: str) -> None:
    """InputError if the true states of the data are more or fewer than those of the estimate."""
    mine, theirs = (sum(name[0] == "x" for name in some) for some in (names, _states(truth)))
    if theirs and mine != theirs:
        raise InputError(
            f"{data}: {mine} states are required, as in {estimate}; it has {theirs}. "
            "Is it the data of another plant?"
        )


def _states(columns: dict[str, list[str]]) -> list[str]:
    """x1, x2, ... (and unknown inputs d1, ...) in an estimate file."""
    names = []
    for letter in "xd":
        i = 1
        while f"{letter}{i}" in columns or f"{letter}{i}_lo" in columns:
            names.append(f"{letter}{i}")
            i += 1
    return names


def _numbers(columns: dict[str, list[str]], name: str, path: str) -> Matrix:
    if name not in columns:
        raise InputError(f"{path}: column {name!r} is required; it has {', '.join(columns)}.")
    try:
        return np.array([float(cell) if cell else np.nan for cell in columns[name]])
    except ValueError as error:
        raise InputError(f"{path}: column {name!r} must hold numbers; {error}.") from None


def _panel(
    axis: Any,
    name: str,
    t: Matrix,
    estimates: dict[str, list[str]],
    path: str,
    times: Matrix,
    truth: dict[str, list[str]],
    truth_path: str,
    jumps: Matrix,
) -> None:
    for k, instant in enumerate(jumps):
        axis.axvline(instant, color="0.55", lw=0.7, ls=(0, (2, 2)), zorder=0,
                     label="jump" if k == 0 else None)  # fmt: skip
    rows_only = len(t) > 0 and float(np.isin(t, jumps).mean()) > _ROWS_ONLY
    if f"{name}_lo" in estimates and rows_only:
        low, high = (_finite(_numbers(estimates, f"{name}_{end}", path)) for end in ("lo", "hi"))
        axis.vlines(t, low, high, color=_BAND, lw=2.5, alpha=0.6, label="bounds")
    elif f"{name}_lo" in estimates:
        low = _finite(_numbers(estimates, f"{name}_lo", path))
        high = _finite(_numbers(estimates, f"{name}_hi", path))
        split, pieces = _with_gaps(t, [low, high], jumps)
        axis.fill_between(
            split, pieces[0], pieces[1], color=_BAND, alpha=0.25, lw=0, label="bounds"
        )
        for edge in pieces:
            axis.plot(split, edge, color=_BAND, lw=0.9)
    if name in estimates:
        values = _finite(_numbers(estimates, name, path))
        axis.plot(t, values, "o" if rows_only else "-", ms=4, color=_ESTIMATE, lw=1.4,
                  label="estimate")  # fmt: skip
    if name in truth and rows_only:
        axis.plot(times, _numbers(truth, name, truth_path), ".", color=_TRUTH, ms=4,
                  label="true state")  # fmt: skip
    elif name in truth:
        split, pieces = _with_gaps(times, [_numbers(truth, name, truth_path)], jumps)
        axis.plot(split, pieces[0], color=_TRUTH, lw=1.1, label="true state")
    subscript = f"${name[0]}_{{{name[1:]}}}$"
    axis.set_ylabel(subscript, rotation=0, ha="right", va="center", fontsize=11)
    axis.margins(x=0.01)


def _measurements(axis: Any, name: str, t: Matrix, data: dict[str, list[str]], path: str) -> None:
    values = _finite(_numbers(data, name, path))
    few = len(t) <= 200
    axis.plot(t, values, "o-" if few else "-", color="0.45", ms=3, lw=0.6, label="measured")
    axis.set_ylabel(f"$y_{{{name[1:]}}}$", rotation=0, ha="right", va="center", fontsize=11)


def _bands(axis: Any, events: dict[str, list[str]], path: str) -> None:
    """Each impulse as a line, with two deviations of its time where they are known."""
    spread = np.nan_to_num(_numbers(events, "t_std", path))
    for k, (t, std) in enumerate(zip(_numbers(events, "t", path), spread, strict=True)):
        axis.axvspan(t - 2 * std, t + 2 * std, color=_ALARM, alpha=0.18, lw=0, zorder=0)
        axis.axvline(t, color=_ALARM, lw=0.9, zorder=1, label="impulse" if k == 0 else None)


def _weights(axis: Any, events: dict[str, list[str]], path: str) -> None:
    """Bars with two deviations, and the time of each impulse above its bar."""
    names = [name for name in events if name.startswith("weight") and not name.endswith("_std")]
    t = _numbers(events, "t", path)
    tops = np.zeros(len(t))
    for k, name in enumerate(names):
        weights, spread = (_numbers(events, n, path) for n in (name, f"{name}_std"))
        spread = np.nan_to_num(spread)
        axis.vlines(t, 0, weights, color=_BAND, lw=4, alpha=0.9 - 0.3 * k)
        axis.errorbar(
            t, weights, yerr=2 * spread, fmt="none", ecolor="0.2", elinewidth=1, capsize=3
        )
        tops = np.maximum(tops, weights + 2 * spread)
    if len(t) <= _LABELLED:
        for text, moment, top in zip(_moments(t, events, path), t, tops, strict=True):
            axis.annotate(text, (moment, top), (0, 3), textcoords="offset points",
                          ha="center", fontsize=8)  # fmt: skip
    axis.axhline(0, color="0.3", lw=0.6)
    axis.margins(y=0.25)
    if len(t) and tops.min() > 0:
        axis.set_ylim(bottom=0)
    axis.set_ylabel("weight", rotation=0, ha="right", va="center")


def _moments(t: Matrix, events: dict[str, list[str]], path: str) -> list[str]:
    """Times with the decimals that their deviations leave, doubtful ones with a question mark."""
    labels = []
    spread = np.nan_to_num(_numbers(events, "t_std", path))
    for moment, std, status in zip(t, spread, events.get("status", ["ok"] * len(t)), strict=True):
        decimals = max(0, math.ceil(-math.log10(2 * std))) if std > 0 else 6
        text = f"{moment:.{min(decimals, 6)}f}" if std > 0 else f"{moment:.4g}"
        labels.append(text + ("" if status in ("ok", *_EXPECTED) else " ?"))
    return labels


def _open_end(axis: Any, t: Matrix, statuses: list[str]) -> None:
    """Shade the rows at the end whose window is not complete."""
    last = len(statuses)
    while last and "unresolved" in statuses[last - 1]:
        last -= 1
    if last < len(statuses):
        axis.axvspan(
            t[last], t[-1], color="0.5", alpha=0.15, lw=0, zorder=0, label="window incomplete"
        )


def _with_gaps(t: Matrix, series: list[Matrix], jumps: Matrix) -> tuple[Matrix, list[Matrix]]:
    """Break the lines at jumps: the last value is held up to the jump, which is a step."""
    at = np.flatnonzero(np.isin(t, jumps) & (np.arange(len(t)) > 0))
    return np.insert(t, at, t[at]), [np.insert(s, at, s[at - 1]) for s in series]


def _finite(values: Matrix) -> Matrix:
    drawable = np.isfinite(values) & (np.abs(np.nan_to_num(values)) < _DRAWABLE)
    return np.where(drawable, values, np.nan)


def _mark_status(axis: Any, t: Matrix, statuses: list[str]) -> None:
    bad = [k for k, status in enumerate(statuses) if status and status != "ok"]
    if bad:
        axis.plot(t[bad], np.zeros(len(bad)), "|", color=_ALARM, ms=7, clip_on=False,
                  transform=axis.get_xaxis_transform(), label="no guarantee here")  # fmt: skip
