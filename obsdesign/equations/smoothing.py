"""Noise-aware smoothing of a record: the smoothest signal that agrees with noisy samples.

    minimise  |third derivative of f|^2   subject to   sum_i (f_i - y_i)^2 <= allowance(N) s^2

which is min |D2 g|^2 under the same bound on |P g + f(0) - y| for the averages g of f' over equal
cells (`equations.block_pulse`), with f(0) free. The only number it needs is the standard deviation
s of the noise. Its minimiser is f = (I + lam A'A)^-1 y for the lam >= 0 that makes the constraint
an equality (Morozov's principle), so that one SVD and a scalar equation solve it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# records are smoothed in windows of this many samples, half overlapping, which fade into each other
WINDOW = 200
_BISECTIONS = 100


def smoothed(t: Array, y: Array, deviation: Array) -> Array:
    """Smooth each column of y, (rows, p), to its noise of standard deviation (p,).

    t, (rows,), may be irregular. Records longer than a window are smoothed in overlapping windows.
    """
    rows, half = len(t), WINDOW // 2
    if rows <= WINDOW:
        return _window(t, y, deviation)
    total, weights = np.zeros_like(y), np.zeros((rows, 1))
    fade = np.minimum(np.arange(1, WINDOW + 1), np.arange(WINDOW, 0, -1))[:, None] / half
    for start in [*range(0, rows - WINDOW, half), rows - WINDOW]:
        part = slice(start, start + WINDOW)
        total[part] += fade * _window(t[part], y[part], deviation)
        weights[part] += fade
    return np.asarray(total / weights)


def allowance(rows: int) -> float:
    """What the squares of `rows` samples of unit white noise sum to: mean plus two deviations."""
    return float(rows + 2 * np.sqrt(2 * rows))


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
    columns = []
    for j, s in enumerate(deviation):
        weight = _weight(squares, parts[:, j] ** 2, allowance(rows) * s**2)
        columns.append(V.T @ (parts[:, j] / (1 + weight * squares)))
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
