"""Stays in modes as the background of a panel: a colour for each mode."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from obsdesign.pages.plotting.style import BLACK, BLUE, GREEN, ORANGE, VERMILION

# the first mode has none
_COLOURS = (None, ORANGE, GREEN, VERMILION, BLUE, BLACK)
_FAINT = 0.13


def draw_stays(axis: Axes, stays: Sequence[tuple[float, float, str]]) -> None:
    """Shade the stays (start, end, mode), by the order in which modes come first."""
    names = list(dict.fromkeys(name for _, _, name in stays))
    labelled = set[str]()
    for start, end, name in stays:
        colour = _COLOURS[names.index(name) % len(_COLOURS)]
        if colour is None:
            continue
        axis.axvspan(start, end, color=colour, alpha=_FAINT, lw=0, zorder=0,
                     label=None if name in labelled else f"mode {name}")  # fmt: skip
        labelled.add(name)
