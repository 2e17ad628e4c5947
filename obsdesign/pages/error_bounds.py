"""Bounds of the error along a record, on a page: their numbers and their picture."""

from __future__ import annotations

from obsdesign.pages.curves import Curve
from obsdesign.studies.error_bounds import ErrorBounds


def error_table(bounds: ErrorBounds) -> tuple[list[str], list[list[str]]]:
    """Titles, and a line for each bound: at the first full window, least, largest."""
    titles = ["|x̂ − x|", f"at t = {bounds.t[0]:.6g}", "least", "largest"]
    lines = [
        [name, *(f"{value:.6g}" for value in (values[0], values.min(), values.max()))]
        for name, values in bounds.series.items()
    ]
    return titles, lines


def error_curve(bounds: ErrorBounds) -> Curve:
    """All bounds and errors over time."""
    return Curve(
        "Bounds of the error along the record", "time", "norm of the error", bounds.t,
        bounds.series, "",
    )  # fmt: skip
