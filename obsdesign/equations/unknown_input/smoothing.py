"""Noise-aware smoothing of a record: the smoothest signal that agrees with noisy samples.

    minimise  |third derivative of f|^2   subject to   sum_i (f_i - y_i)^2 <= allowance(N) s^2

which is min |D2 g|^2 under the same bound on |P g + f(0) - y| for the averages g of f' over equal
cells, with f(0) free. The only number it needs is the standard deviation
s of the noise. Its minimiser is f = (I + lam A'A)^-1 y for the lam >= 0 that makes the constraint
an equality (Morozov's principle), so that one SVD and a scalar equation solve it.
"""

from __future__ import annotations

import numpy as np

from lmi.arithmetic.arrays import Matrix

# records are smoothed in windows of this many nodes, half overlapping, which fade into each other
WINDOW = 200
# nodes are means of several samples as long as a window bends in no more ways than this
_BENDS = 40
# how much the noise of neighbouring samples may differ from that of the record
_NOISIER = 1.1
_BISECTIONS = 100


def smoothed(t: Matrix, y: Matrix, deviation: Matrix) -> Matrix:
    """Smooth each column of y, (rows, p), to its noise of standard deviation (p,).

    t, (rows,), may be irregular. Where a record has more samples than a window has nodes, a node is
    the mean of so many that one window sees the signal bend: a finer sampling of the same signal
    does not shorten what the noise is averaged over.
    """
    rows, nodes = len(t), len(t)
    while nodes > WINDOW:
        nodes = -(-nodes // 2)
    while nodes < rows:
        smooth, bends = _from_means(t, y, deviation, nodes)
        if bends <= _BENDS and _lost_noise_alone(y, smooth, deviation):
            return smooth
        nodes = min(2 * nodes, rows)
    return _in_windows(t, y, deviation)[0]


def _from_means(t: Matrix, y: Matrix, deviation: Matrix, nodes: int) -> tuple[Matrix, float]:
    """(smoothed y, bends) from means of about rows/nodes samples each."""
    starts = np.arange(nodes) * len(t) // nodes
    counts = np.diff(starts, append=len(t))

    def mean(values: Matrix) -> Matrix:
        return np.asarray((np.add.reduceat(values, starts, axis=0).T / counts).T)

    origin = t[0]
    centres = mean(t - origin)
    spread = mean((t - origin - np.repeat(centres, counts)) ** 2)
    noise, means = deviation / np.sqrt(counts.mean()), mean(y)
    smooth, bends = _in_windows(centres, means, noise)
    if bends > _BENDS:
        return y, bends
    # the mean of a curve lies beside the curve, by half its bend times the spread of the samples
    bend = np.gradient(np.gradient(smooth, centres, axis=0), centres, axis=0)
    bend[:2], bend[-2:] = bend[2], bend[-3]
    smooth, bends = _in_windows(centres, means - bend * spread[:, None] / 2, noise)
    return _between(centres, smooth, t - origin), bends


def _lost_noise_alone(y: Matrix, smooth: Matrix, deviation: Matrix) -> bool:
    """Whether residuals are no larger than the given noise, or than that of third differences.

    Third differences of white noise have 20 times its variance; those of a signal that means of
    neighbours remove have less of it.
    """
    residual = np.mean((y - smooth) ** 2, axis=0)
    given = allowance(len(y)) / len(y) * deviation**2
    local = np.mean(np.diff(y, 3, axis=0) ** 2, axis=0) / 20
    return bool(np.all(residual <= np.maximum(given, _NOISIER * local)))


def _between(nodes: Matrix, values: Matrix, t: Matrix) -> Matrix:
    """Cubic through the four nodes around each t; through the last four beyond them."""
    first = np.clip(np.searchsorted(nodes, t) - 2, 0, len(nodes) - 4)
    near = [nodes[first + i] for i in range(4)]
    result = np.zeros((len(t), values.shape[1]))
    for i in range(4):
        weight = np.ones(len(t))
        for j in {0, 1, 2, 3} - {i}:
            weight *= (t - near[j]) / (near[i] - near[j])
        result += weight[:, None] * values[first + i]
    return result


def smoothed_window(t: Matrix, y: Matrix, deviation: Matrix) -> Matrix:
    """Smooth each column of y, (rows, p), to its noise, (p,), as one window without means."""
    return _window(t, y, deviation)[0]


def _in_windows(t: Matrix, y: Matrix, deviation: Matrix) -> tuple[Matrix, float]:
    """(smoothed y, the most ways in which a window bends)."""
    rows, half = len(t), WINDOW // 2
    if rows <= WINDOW:
        return _window(t, y, deviation)
    total, weights, most = np.zeros_like(y), np.zeros((rows, 1)), 0.0
    fade = np.minimum(np.arange(1, WINDOW + 1), np.arange(WINDOW, 0, -1))[:, None] / half
    for start in [*range(0, rows - WINDOW, half), rows - WINDOW]:
        part = slice(start, start + WINDOW)
        smooth, bends = _window(t[part], y[part], deviation)
        total[part] += fade * smooth
        weights[part] += fade
        most = max(most, bends)
    return np.asarray(total / weights), most


def allowance(rows: int) -> float:
    """Sum of squares of `rows` samples of unit white noise: mean plus two deviations."""
    return float(rows + 2 * np.sqrt(2 * rows))


def roughness(t: Matrix) -> Matrix:
    """A, (rows - 3, rows): |A f|^2 approximates the integral of f'''^2, by divided differences."""
    operator, nodes = np.eye(len(t)), t
    for order in (1, 2, 3):
        spans = nodes[1:] - nodes[:-1]
        operator = np.diff(operator, axis=0) / spans[:, None]
        nodes = (nodes[1:] + nodes[:-1]) / 2
        if order == 3:
            operator = operator * np.sqrt(spans)[:, None]
    return np.asarray(operator)


def _window(t: Matrix, y: Matrix, deviation: Matrix) -> tuple[Matrix, float]:
    """(smoothed y, trace of y -> smoothed y: in how many ways it bends, 3 for a parabola)."""
    rows = len(t)
    if rows < 4:  # a parabola goes through them
        return y, 3.0
    scale = (t[-1] - t[0]) / (rows - 1)
    with np.errstate(over="ignore", invalid="ignore"):
        rough = roughness((t - t[0]) / scale)
        usable = np.isfinite(np.sum(rough**2))
    if not usable:  # steps so different do not show how smooth the signal is
        return y, float(rows)
    _, values, V = np.linalg.svd(rough)
    squares = np.concatenate([values**2, np.zeros(rows - len(values))])
    parts = V @ y
    columns, bends = [], 0.0
    for j, s in enumerate(deviation):
        weight = _weight(squares, parts[:, j] ** 2, allowance(rows) * s**2)
        columns.append(V.T @ (parts[:, j] / (1 + weight * squares)))
        bends = max(bends, float((1 / (1 + weight * squares)).sum()))
    return np.column_stack(columns), bends


def _weight(squares: Matrix, energy: Matrix, room: float) -> float:
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
