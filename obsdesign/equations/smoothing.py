"""Noise-aware smoothing of a record: the smoothest signal that agrees with noisy samples.

    minimise  |third derivative of f|^2   subject to   sum_i (f_i - y_i)^2 <= (N + 1) s^2

which is min |D2 g|^2 s.t. |P g + f(0) - F| <= s sqrt(N) for the averages g of f' over equal cells
(`equations.block_pulse`), with f(0) free. The only number it needs is the standard deviation s of
the noise. Its minimiser is f = (I + lam A'A)^-1 y for the lam >= 0 that makes the constraint an
equality (Morozov's principle), so that one SVD and a scalar equation solve it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# records are smoothed in windows of this many samples, of which the middle half is kept
WINDOW = 200
_BISECTIONS = 100


def smoothed(t: Array, y: Array, deviation: Array) -> Array:
    """Smooth each column of y, (rows, p), to its noise of standard deviation (p,).

    t, (rows,), may be irregular. Records longer than a window are smoothed in overlapping windows.
    """
    rows, half = len(t), WINDOW // 2
    if rows <= WINDOW:
        return _window(t, y, deviation)
    result = np.empty_like(y)
    starts = [*range(0, rows - WINDOW, half), rows - WINDOW]
    for start in starts:
        found = _window(t[start : start + WINDOW], y[start : start + WINDOW], deviation)
        first = 0 if start == 0 else half // 2
        result[start + first : start + WINDOW] = found[first:]  # the next window replaces its end
    return result


def roughness(t: Array) -> Array:
    """A, (rows - 3, rows): |A f|^2 approximates the integral of f'''^2, by divided differences."""
    operator, nodes = np.eye(len(t)), t
    for order in (1, 2, 3):
        spans = nodes[1:] - nodes[:-1]
        operator = np.diff(operator, axis=0) / spans[:, None]
        nodes = (nodes[1:] + nodes[:-1]) / 2
        if order == 3:
            operator = operator * np.sqrt(spans)[:, None]
    return np.asarray(operator)


def _window(t: Array, y: Array, deviation: Array) -> Array:
    rows = len(t)
    if rows < 4:  # a parabola goes through them
        return y
    scale = (t[-1] - t[0]) / (rows - 1)
    _, values, V = np.linalg.svd(roughness((t - t[0]) / scale))
    squares = np.concatenate([values**2, np.zeros(rows - len(values))])
    parts = V @ y
    columns = [
        V.T @ (parts[:, j] / (1 + _weight(squares, parts[:, j] ** 2, rows * s**2) * squares))
        for j, s in enumerate(deviation)
    ]
    return np.column_stack(columns)


def _weight(squares: Array, energy: Array, room: float) -> float:
    """lam with sum (lam s^2/(1 + lam s^2))^2 energy = room, by bisection of log lam."""

    def misfit(lam: float) -> float:
        return float((lam * squares / (1 + lam * squares)) ** 2 @ energy)

    positive = squares[squares > 0]
    low, high = 1e-8 / positive.max(), 1e12 / positive.min()
    if misfit(high) <= room:
        return float(high)  # a parabola agrees with the samples
    if misfit(low) >= room:
        return 0.0
    for _ in range(_BISECTIONS):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if misfit(middle) > room else (middle, high)
    return float(low)
