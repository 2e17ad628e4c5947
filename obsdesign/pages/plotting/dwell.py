"""Proved and refuted dwell times of a search, and the windows of a proof.

Above, the searched end of the range of dwell times: what one common P proves, what windows of dwell
times prove beyond it, what is open and what is refuted, once whole and once close to the limit.
Below, the windows: each row is one matrix P, each column one dwell time of the sequence it may
depend on, the bar the interval in which that dwell time lies.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from lmi.arithmetic.arrays import Entries
from obsdesign.errors import InputError
from obsdesign.pages.plotting.style import BLUE, GREEN, GREY, VERMILION, check_output, picture

_COLOURS = (("one common P", GREEN), ("windows of dwell times", BLUE), ("open", GREY),
            ("refuted", VERMILION))  # fmt: skip
_MOST_ROWS = 60


# dwell intervals by offset: of dwell times since (negative) or after the jump
_Window = dict[int, tuple[float, float]]


@dataclass(frozen=True)
class _Range:
    """The kept end, and what one P and windows prove from there; the nearest end not proved."""

    kept: float
    common: float
    proved: float
    not_proved: float
    refuted: bool

    @property
    def ends(self) -> tuple[float, ...]:
        return self.kept, self.common, self.proved, self.not_proved

    def far(self) -> float:
        """End of the picture beyond the limit."""
        outward = 1.0 if self.not_proved >= self.proved else -1.0
        return min(max(self.not_proved + outward * 0.25 * self._size, 0.0), self.edge)

    @property
    def edge(self) -> float:
        """The largest dwell time that is drawn; an infinite end goes on to there."""
        finite = [end for end in self.ends if math.isfinite(end)]
        return max(finite) + (0.25 if len(finite) == len(self.ends) else 0.5) * self._size

    @property
    def _size(self) -> float:
        finite = [end for end in self.ends if math.isfinite(end)]
        return max(finite) - min(finite) or abs(finite[0]) or 1.0


def plot_dwell(answer: Entries, output: str, name: str) -> None:
    """Draw the answer of a search for dwell times, or the windows of a design, to PNG or SVG.

    answer: what `search --json` prints, or a design file. InputError when it holds neither.
    """
    check_output(output)
    span, windows = _range(answer), _windows(answer)
    if span is None and not windows:
        raise InputError(
            f"{name}: the answer of a search for dwell times, or a design with windows of dwell "
            "times, is required; it is neither."
        )
    shown = windows[:_MOST_ROWS]
    tall = 0.0 if not shown else 0.9 + 0.13 * len(shown)
    with picture(7.0, (2.6 if span else 0.3) + tall, output) as figure:
        parts = [part for part, there in (("span", span), ("tree", shown)) if there]
        heights = {"span": 2.3, "tree": max(tall, 0.5)}
        rows = figure.subfigures(len(parts), 1, height_ratios=[heights[part] for part in parts],
                                 squeeze=False)[:, 0]  # fmt: skip
        for part, row in zip(parts, rows, strict=True):
            if part == "span" and span is not None:
                _draw_range(row, span)
            else:
                _draw_windows(row, shown, len(windows))


def _range(answer: Entries) -> _Range | None:
    result = answer.get("result")
    if not isinstance(result, Mapping) or result.get("proved") is None:
        return None
    try:
        kept, proved = _end(result["kept"]), _end(result["proved"])
        outside = result.get("not_proved")
        not_proved = proved if outside is None else _end(outside)
        common = result.get("common_P")
        reached = proved if common is None else _end(common)
    except (KeyError, TypeError, ValueError):
        return None
    return _Range(kept, reached, proved, not_proved, result.get("not_proved_verdict") == "refuted")


def _end(value: float | str) -> float:
    return math.inf if value == "inf" else float(value)


def _windows(answer: Entries) -> list[_Window]:
    """Dwell intervals of the first certificate with windows; none where they cannot be read."""
    for claim in answer.get("claims", ()):
        evidence = claim.get("evidence", {}) if isinstance(claim, Mapping) else {}
        if isinstance(evidence, Mapping) and isinstance(evidence.get("windows"), list):
            try:
                return [
                    {int(offset): (_end(a), _end(b)) for offset, (a, b) in window["dwell"].items()}
                    for window in evidence["windows"]
                ]
            except (AttributeError, KeyError, TypeError, ValueError):
                return []
    return []


def _draw_range(figure: FigureBase, span: _Range) -> None:
    limited = math.isfinite(span.proved)
    axes = figure.subplots(2 if limited else 1, 1, squeeze=False)[:, 0]
    whole, near = axes[0], axes[-1]
    far, edge = span.far(), span.edge
    _bars(whole, span, far, edge)
    low, high = sorted((min(span.kept, edge), far))
    whole.set_xlim(low - 0.01 * (high - low), max(high, low + 1e-9))
    near.set_xlabel("dwell time")
    whole.set_ylabel("all", rotation=0, ha="right", va="center")
    handles, labels = whole.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)
    if not limited:
        return
    gap = abs(span.not_proved - span.common)
    if gap == 0:
        gap = 1e-3 * abs(span.proved) or 1.0
    close = sorted((span.common, span.not_proved))
    _bars(near, span, far, edge)
    near.set_xlim(close[0] - 0.35 * gap, close[1] + 0.35 * gap)
    near.set_ylabel("near the\nlimit", rotation=0, ha="right", va="center")


def _bars(axis: Axes, span: _Range, far: float, edge: float) -> None:
    pieces = [(span.kept, span.common), (span.common, span.proved), (span.proved, span.not_proved),
              (span.not_proved, far)]  # fmt: skip
    if not span.refuted:
        pieces[2:] = [(span.proved, far)]
    for (label, colour), piece in zip(_COLOURS, pieces, strict=False):
        low, high = sorted(min(end, edge) for end in piece)
        if high > low:
            hatch = "///" if label == "open" else None
            axis.barh(0, high - low, left=low, height=0.8, color=colour, alpha=0.75, label=label,
                      hatch=hatch, edgecolor="white", lw=0)  # fmt: skip
    axis.set_yticks([])
    axis.set_ylim(-0.6, 0.6)
    axis.spines["left"].set_visible(False)
    axis.grid(visible=False)


def _draw_windows(figure: FigureBase, windows: list[_Window], count: int) -> None:
    offsets = sorted({offset for window in windows for offset in window}) or [0]
    ends = [end for window in windows for pair in window.values() for end in pair]
    finite = [end for end in ends if math.isfinite(end)] or [0.0, 1.0]
    low, high = min(finite), max(finite)
    beyond = high + 0.08 * (high - low or 1.0)
    panels = figure.subplots(1, len(offsets), sharey=True, squeeze=False)[0]
    order = sorted(windows, key=lambda window: _key(window, offsets, low))
    for offset, panel in zip(offsets, panels, strict=True):
        for row, window in enumerate(order):
            a, b = window.get(offset, (low, beyond))
            colour, alpha = (BLUE, 0.75) if offset in window else (GREY, 0.3)
            panel.barh(row, min(b, beyond) - a, left=a, height=0.72, color=colour, alpha=alpha)
        panel.set_title(_title(offset), fontsize=8)
        panel.set_xlim(low, high if all(map(math.isfinite, ends)) else beyond)
        panel.set_yticks([])
        panel.tick_params(labelsize=7)
        panel.grid(visible=False)
    panels[-1].invert_yaxis()
    more = f" ({len(windows)} of {count})" if count > len(windows) else ""
    panels[0].set_ylabel(f"{count} windows{more}")
    figure.supxlabel("dwell time", fontsize=8)


def _key(window: _Window, offsets: list[int], low: float) -> list[float]:
    """Neighbours in the tree stand side by side: by the dwell times nearest to the jump first."""
    nearest = sorted(offsets, key=lambda offset: abs(offset + 0.5))
    return [window[offset][0] if offset in window else low for offset in nearest]


def _title(offset: int) -> str:
    words = {-1: "last dwell", 0: "next dwell"}
    if offset in words:
        return words[offset]
    return f"{-offset} dwells ago" if offset < 0 else f"{offset + 1} dwells ahead"
