"""Block-pulse functions: phi_i = 1 on cell i = [(i-1)h, ih), 0 elsewhere, i = 1..m.

A signal stands for its averages over the cells (its coefficients). Shapes: samples (m + 1,) or
(m + 1, k), coefficients (m,) or (m, k); h the length of a cell.
Source: P. Ahn (2002), (1)-(15), where h = tf/m; (5), (6), (14), (15). (8) is misprinted there: the
factor is m/tf, phi_(i+1) is missing, and i begins at 0.

The derivative (14) is the inverse of the integral (6). It has a pole at -1: whatever excites that
never dies out. Trapezoid averages with y(0) equal to the first sample do not excite it, and then
(14) is the plain difference quotient over the cell (`cell_derivative`). An error e of y(0) stays as
+-2e/h for ever; exact averages instead of trapezoid ones leave an alternating error; noise that is
independent from cell to cell grows without bound, with variance (2/h)^2 s^2 (4i - 3).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def coefficients(samples: ArrayLike) -> Array:
    """Averages over the cells by the trapezoid rule, (5) right: (f_i + f_{i-1})/2."""
    f = np.asarray(samples, dtype=np.float64)
    return np.asarray((f[1:] + f[:-1]) / 2)


def exact_coefficients(antiderivative: ArrayLike, h: float) -> Array:
    """Averages over the cells from samples of an antiderivative, (5) left: exact."""
    return np.diff(np.asarray(antiderivative, dtype=np.float64), axis=0) / h


def integration_matrix(m: int, h: float) -> Array:
    """P, (m, m): coefficients of the integral from 0 are P times those of f, (6)."""
    return h * (np.tril(np.ones((m, m)), -1) + np.eye(m) / 2)


def derivative(F: ArrayLike, f0: ArrayLike, h: float) -> Array:
    """Coefficients of f' from those of f and f(0), recursively, (14); pole at -1, see above."""
    return damped_derivative(F, f0, h, damping=1.0)


def derivative_sum(F: ArrayLike, f0: ArrayLike, h: float) -> Array:
    """The same by the closed form (15)."""
    values = np.asarray(F, dtype=np.float64)
    sign = ((-1.0) ** np.arange(1, len(values) + 1)).reshape(-1, *([1] * (values.ndim - 1)))
    before = np.cumsum(sign * values, axis=0) - sign * values  # sum over j < i
    return np.asarray(2 / h * (values + 2 * sign * before + sign * np.asarray(f0)))


def damped_derivative(F: ArrayLike, f0: ArrayLike, h: float, damping: float) -> Array:
    """The pole moved to -damping: D_{i+1} = (1 + r)/h (F_{i+1} - F_i) - r D_i, 0 <= r <= 1.

    Exact for ramps; for r < 1 late by h (1 - r)/(2 (1 + r)). Noise of variance s^2 per cell leaves
    2 (1 + r)^2 s^2 / (h^2 (1 - r)).
    """
    values = np.asarray(F, dtype=np.float64)
    result = np.empty_like(values)
    result[0] = 2 / h * (values[0] - np.asarray(f0))
    for i in range(1, len(values)):
        result[i] = (1 + damping) / h * (values[i] - values[i - 1]) - damping * result[i - 1]
    return result


def cell_derivative(samples: ArrayLike, t: ArrayLike) -> Array:
    """(y_i - y_{i-1})/h_i: the exact average of y' over each cell, cells of any length.

    Equal to `derivative(coefficients(y), y[0], h)` for equal cells. White noise of variance s^2 on
    the samples leaves 2 s^2/h^2, in every cell the same.
    """
    y: Any = np.asarray(samples, dtype=np.float64)
    steps = np.diff(np.asarray(t, dtype=np.float64))
    return np.asarray(np.diff(y, axis=0) / steps.reshape(-1, *([1] * (y.ndim - 1))))


def node_derivative(F: ArrayLike, h: float) -> Array:
    """(F_{i+1} - F_i)/h at the nodes between cells, (m - 1,): for averages without samples.

    Second order in h, noise 2 s^2/h^2, no pole.
    """
    return np.asarray(np.diff(np.asarray(F, dtype=np.float64), axis=0) / h)
