"""Noise of measurements from a record: deviations and bounds.

Around each sample a parabola is fitted to its neighbours; what is left of the sample is noise, as
far as the signal is a parabola there. Its size follows from the least-squares residual r and the
leverage h: the standard deviation of r is sigma sqrt(1 - h).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmi.arithmetic.arrays import Matrix
from obsdesign.data.csv_lines import OWN_TITLES, column_numbers, read_columns
from obsdesign.errors import InputError

# samples of a parabola, and its degree
_WINDOW, _DEGREE = 7, 2
# a gap of more than so many usual intervals, or an event, ends a run of samples
_GAP = 3.0
# the median of |normal noise| in standard deviations
_MEDIAN = 0.6744897501960817
_FEWEST = 20
# bounds are so much above the largest residual: a record rarely shows the worst case
_MARGIN = 1.25
# rank correlation of |residual| and |y| from which on noise grows with the signal
_GROWS = 0.3
# correlation of the residuals of neighbours: -0.49 for noise alone, near 1 for a smooth signal;
# from this one on a fifth of their power is a signal
_LARGEST_CORRELATION = -0.2


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of a column.

    samples: residuals that were used; std: robust standard deviation; bound: largest residual with
    a margin; resolution: smallest step between two values, 0 where none is seen; cv: deviation as a
    part of |y|, 0 unless the noise grows with |y|; is_smooth: are residuals like noise, and not
    like a signal that is no parabola over the window?
    """

    column: str
    samples: int
    std: float
    bound: float
    resolution: float
    cv: float
    is_smooth: bool


def estimate_noise(
    path: str, titles: Mapping[str, str] = OWN_TITLES, columns: tuple[str, ...] = ()
) -> list[NoiseEstimate]:
    """Noise of each measured column of a CSV file with column t.

    titles: column by another title of it; columns: their names, those named y1, y2, ... where none
    are given. Runs of samples end at rows with an entry other than 0 in `jump` or in a column
    `event`. InputError where there are no such columns, or too few samples in a row.
    """
    table = read_columns(path, titles)
    listed = columns or tuple(x for x in table if x[0] == "y" and x[1:].isdigit())
    if "t" not in table or not listed:
        raise InputError(f"{path}: columns t and y1, ... are required; it has {', '.join(table)}.")
    t, events = column_numbers(table, "t", path), _events(table)
    estimates = []
    for name in listed:
        if name not in table:
            raise InputError(f"{path}: column {name!r} is required; it has {', '.join(table)}.")
        estimates.append(_estimate(name, t, column_numbers(table, name, path), events, path))
    return estimates


def _events(table: Mapping[str, list[str]]) -> NDArray[np.bool_]:
    """Rows after which the signal may have jumped."""
    marks = [table[name] for name in ("jump", "event", "mode") if name in table]
    rows = zip(*marks, strict=True) if marks else ([] for _ in table["t"])
    return np.array([any(cell not in ("", "0", "0.0") for cell in row) for row in rows], bool)


def _estimate(
    name: str, t: Matrix, y: Matrix, events: NDArray[np.bool_], path: str
) -> NoiseEstimate:
    parts = [_residuals(*run) for run in _runs(t, y, events)]
    residual = np.concatenate([part[0] for part in parts]) if parts else np.zeros(0)
    middle = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0)
    if len(residual) < _FEWEST:
        raise InputError(
            f"{path}: {name}: at least {_FEWEST} samples with {_WINDOW // 2} neighbours on each "
            f"side are required, without a gap or an event between them; it has {len(residual)}."
        )
    steps = np.diff(np.unique(y[np.isfinite(y)]))
    resolution = float(steps.min()) if len(steps) and np.ptp(y[np.isfinite(y)]) > 0 else 0.0
    resolution = resolution if _is_grid(y, resolution) else 0.0
    std = float(np.median(np.abs(residual))) / _MEDIAN
    std = max(std, resolution / math.sqrt(12))
    bound = max(_MARGIN * float(np.abs(residual).max()), resolution / 2)
    grows = _rank_correlation(np.abs(residual), np.abs(middle)) > _GROWS
    ratios = np.abs(residual) / np.maximum(np.abs(middle), 1e-300)
    cv = float(np.median(ratios)) / _MEDIAN if grows else 0.0
    return NoiseEstimate(name, len(residual), std, bound, resolution, cv, _is_noise(residual))


def _runs(t: Matrix, y: Matrix, events: NDArray[np.bool_]) -> Iterator[tuple[Matrix, Matrix]]:
    """Samples in a row, without a gap or an event between them."""
    known = np.flatnonzero(np.isfinite(y) & np.isfinite(t))
    if len(known) < _WINDOW:
        return
    spacing = np.diff(t[known])
    # a measurement may see the state before the event of its row, or after it
    counted = np.cumsum(events + np.concatenate([[False], events[:-1]]).astype(int))
    ends = (spacing > _GAP * np.median(spacing)) | (np.diff(counted[known]) > 0)
    for run in np.split(known, np.flatnonzero(ends) + 1):
        if len(run) >= _WINDOW:
            yield t[run], y[run]


def _residuals(t: Matrix, y: Matrix) -> tuple[Matrix, Matrix]:
    """Residuals of the middle samples of all windows, scaled to the noise, and fitted values."""
    half = _WINDOW // 2
    left, fitted = [], []
    for k in range(half, len(t) - half):
        window = slice(k - half, k + half + 1)
        scaled = (t[window] - t[k]) / (t[window][-1] - t[window][0])
        basis = np.linalg.qr(np.vander(scaled, _DEGREE + 1, increasing=True))[0]
        middle = float(basis[half] @ (basis.T @ y[window]))
        left.append((y[k] - middle) / math.sqrt(1 - float(basis[half] @ basis[half])))
        fitted.append(middle)
    return np.array(left), np.array(fitted)


def _is_grid(y: Matrix, step: float) -> bool:
    """Are all values whole steps from each other, and few of them?"""
    values = np.unique(y[np.isfinite(y)])
    if step <= 0 or len(values) > np.isfinite(y).sum() / 2:
        return False
    counts = (values - values[0]) / step
    return bool(np.abs(counts - np.round(counts)).max() < 1e-3)


def _rank_correlation(first: Matrix, second: Matrix) -> float:
    ranks = [np.argsort(np.argsort(values)).astype(float) for values in (first, second)]
    return float(np.corrcoef(ranks)[0, 1]) if np.ptp(second) > 0 else 0.0


def _is_noise(residual: Matrix) -> bool:
    """Are residuals of neighbours correlated as those of noise are?"""
    if not np.ptp(residual) > 0:
        return True
    return bool(np.corrcoef(residual[1:], residual[:-1])[0, 1] < _LARGEST_CORRELATION)
